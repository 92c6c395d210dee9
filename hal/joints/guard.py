"""The last check before the drives: limits independent of plans, applied to every command of every tick.

The guard refuses and reports why; it never clamps, because a silent clamp hides a planner's error. Its limits come from
the device, and from the patient only where the patient's are narrower.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite, radians

import numpy as np

from hal.errors import DeviceFault, HardwareError
from hal.joints.device import Exoskeleton
from hal.joints.protocol import TICK_S, Joint, JointArray, JointCommand

STIFFNESS_RAMP_S = 0.05  # no faster from nothing to the device's full stiffness, nor back
TORQUE_RAMP_S = 0.05  # likewise for the feed-forward torque
ENGAGE_RAD = radians(3.0)  # a joint without stiffness gets it no farther from where it is than this


class Quantity(Enum):
    """What a command was refused for."""

    NOT_FINITE = "not a finite number"
    SHAPE = "not four numbers"
    POSITION = "position"
    SPEED = "speed"
    TORQUE = "torque"
    STIFFNESS = "stiffness"
    DAMPING = "damping"
    POSITION_STEP = "change of position in a tick"
    TORQUE_STEP = "change of torque in a tick"
    STIFFNESS_STEP = "change of stiffness in a tick"
    ENGAGEMENT = "distance from the joint when gripping it"  # stiffness begins too far from the joint


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why a command did not reach the drives; value and limit in SI at the joint."""

    joint: Joint
    quantity: Quantity
    value: float
    limit: float

    @property
    def code(self) -> Quantity:
        """The key of its message."""
        return self.quantity

    @property
    def values(self) -> dict[str, object]:
        """The values of its message."""
        numbers = {"value": self.value, "limit": self.limit}
        return {"joint": self.joint, **{name: number for name, number in numbers.items() if isfinite(number)}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What the guard lets pass, each (4,) in the order of Joint, SI at the joint."""

    low_rad: JointArray
    high_rad: JointArray
    speed_rad_s: JointArray
    torque_nm: JointArray
    stiffness_nm_rad: JointArray
    damping_nm_s_rad: JointArray

    @property
    def position_step_rad(self) -> JointArray:
        """How far a joint moves in a tick at its top speed."""
        return self.speed_rad_s * TICK_S

    @property
    def stiffness_step_nm_rad(self) -> JointArray:
        """Per tick."""
        return self.stiffness_nm_rad * (TICK_S / STIFFNESS_RAMP_S)

    @property
    def torque_step_nm(self) -> JointArray:
        """Per tick."""
        return self.torque_nm * (TICK_S / TORQUE_RAMP_S)


def limits_of(device: Exoskeleton, hip_max_rad: float | None = None, knee_max_rad: float | None = None) -> Limits:
    """The device's limits, with the patient's own flexion limits where they are narrower.

    Raises HardwareError when a patient's limit would loosen the device's.
    """
    own = np.array([hip_max_rad, knee_max_rad, hip_max_rad, knee_max_rad], dtype=float)  # None becomes NaN
    high = np.radians([joint.max_deg for joint in device.joints])
    if np.any(own > high):
        loosest = Joint(int(np.argmax(np.nan_to_num(own - high, nan=-inf))))
        limit_rad = radians(device.joints[loosest].max_deg)
        raise HardwareError(DeviceFault.LIMIT_LOOSENED, joint=loosest, limit_rad=limit_rad)
    return Limits(
        low_rad=np.radians([joint.min_deg for joint in device.joints]),
        high_rad=np.fmin(own, high),
        speed_rad_s=np.radians([joint.max_speed_deg_s for joint in device.joints]),
        torque_nm=np.array([joint.max_torque_nm for joint in device.joints]),
        stiffness_nm_rad=np.array([joint.max_stiffness_nm_rad for joint in device.joints]),
        damping_nm_s_rad=np.array([joint.max_damping_nm_s_rad for joint in device.joints]),
    )


# What is checked, in this order; -1: the value is bounded from below. The last four need the command before.
ROWS = (
    (Quantity.POSITION, -1),
    (Quantity.POSITION, 1),
    (Quantity.SPEED, 1),
    (Quantity.TORQUE, 1),
    (Quantity.STIFFNESS, -1),
    (Quantity.STIFFNESS, 1),
    (Quantity.DAMPING, -1),
    (Quantity.DAMPING, 1),
    (Quantity.POSITION_STEP, 1),
    (Quantity.ENGAGEMENT, 1),
    (Quantity.STIFFNESS_STEP, 1),
    (Quantity.TORQUE_STEP, 1),
)
_SLACK = 1e-9  # rounding of binary fractions is no reason to refuse
_NONE = np.zeros(4)


class Guard:
    """Checks a command against the limits, and against the command before it.

    One comparison of all rows at once: it runs every tick, and eleven one by one took a tenth of it.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        within = [-limits.low_rad, limits.high_rad, limits.speed_rad_s, limits.torque_nm]
        within += [_NONE, limits.stiffness_nm_rad, _NONE, limits.damping_nm_s_rad]
        steps = [limits.position_step_rad, np.full(4, ENGAGE_RAD), limits.stiffness_step_nm_rad, limits.torque_step_nm]
        self._limits = np.stack(within + steps)
        # The first command of all must carry nothing: where the joints are is not known.
        self._first_limits = np.stack(within + [_NONE] * 4)
        self._rows = np.zeros_like(self._limits)

    def check(self, command: JointCommand, previous: JointCommand | None, measured_rad: JointArray) -> Refusal | None:
        """None when the command may pass, else the first reason why not.

        previous: the command that passed last, None before the first. measured_rad: (4,), NaN where unknown.
        """
        for values in command.fields:
            if values.shape != (4,):
                return Refusal(joint=Joint.LEFT_HIP, quantity=Quantity.SHAPE, value=float(values.size), limit=4.0)
        limits = self._first_limits if previous is None else self._limits
        self._fill(command, previous, measured_rad)
        over = ~(self._rows <= limits + _SLACK)  # an unknown value is not within a limit
        if not over.any():
            return None
        row, joint = np.argwhere(over)[0]
        quantity, sign = ROWS[row]
        return _not_finite(command) or Refusal(
            joint=Joint(int(joint)),
            quantity=quantity,
            value=float(sign * self._rows[row, joint]) + 0.0,  # no minus zero
            limit=float(sign * limits[row, joint]) + 0.0,
        )

    def _fill(self, command: JointCommand, previous: JointCommand | None, measured_rad: JointArray) -> None:
        rows, stiffness, torque = self._rows, command.stiffness_nm_rad, np.abs(command.torque_nm)
        rows[0], rows[1] = -command.position_rad, command.position_rad
        rows[2], rows[3] = np.abs(command.velocity_rad_s), torque
        rows[4], rows[5] = -stiffness, stiffness
        rows[6], rows[7] = -command.damping_nm_s_rad, command.damping_nm_s_rad
        if previous is None:
            rows[8:] = (_NONE, _NONE, stiffness, torque)
            return
        was_stiff = previous.stiffness_nm_rad > 0
        gripping = (stiffness > 0) & ~was_stiff
        rows[8] = np.where(was_stiff, np.abs(command.position_rad - previous.position_rad), 0.0)
        rows[9] = np.where(gripping, np.abs(command.position_rad - measured_rad), 0.0)
        rows[10] = np.abs(stiffness - previous.stiffness_nm_rad)
        rows[11] = np.abs(command.torque_nm - previous.torque_nm)


def _not_finite(command: JointCommand) -> Refusal | None:
    for values in command.fields:
        finite = np.isfinite(values)
        if not finite.all():
            joint = int(np.argmin(finite))
            return Refusal(joint=Joint(joint), quantity=Quantity.NOT_FINITE, value=float(values[joint]), limit=inf)
    return None
