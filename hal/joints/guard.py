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
# How far a measured value may be beyond its limit before control acts.
RANGE_MARGIN_RAD = radians(2.0)  # encoder noise and a soft stop
SPEED_MARGIN = 1.1
TORQUE_MARGIN = 1.05


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
_NONE = [0.0] * 4


class Guard:
    """Checks a command against the limits, and against the command before it.

    In plain numbers: it runs every tick, and of four joints NumPy's arithmetic takes longer to start than to do.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        within = [(-limits.low_rad).tolist(), limits.high_rad.tolist(), limits.speed_rad_s.tolist()]
        within += [limits.torque_nm.tolist(), _NONE, limits.stiffness_nm_rad.tolist()]
        within += [_NONE, limits.damping_nm_s_rad.tolist()]
        steps = [limits.position_step_rad.tolist(), [ENGAGE_RAD] * 4, limits.stiffness_step_nm_rad.tolist()]
        self._limits = [*within, *steps, limits.torque_step_nm.tolist()]
        # The first command of all must carry nothing: where the joints are is not known.
        self._first_limits = [*within, *[_NONE] * 4]

    def check(self, command: JointCommand, previous: JointCommand | None, measured_rad: JointArray) -> Refusal | None:
        """None when the command may pass, else the first reason why not.

        previous: the command that passed last, None before the first. measured_rad: (4,), NaN where unknown.
        """
        for values in command.fields:
            if values.shape != (4,):
                return Refusal(joint=Joint.LEFT_HIP, quantity=Quantity.SHAPE, value=float(values.size), limit=4.0)
        limits = self._first_limits if previous is None else self._limits
        rows = _rows(command, previous, measured_rad)
        for (quantity, sign), row, bounds in zip(ROWS, rows, limits, strict=True):
            for joint in range(4):
                if not row[joint] <= bounds[joint] + _SLACK:  # an unknown value is not within a limit
                    return _not_finite(command) or Refusal(
                        joint=Joint(joint),
                        quantity=quantity,
                        value=sign * row[joint] + 0.0,  # no minus zero
                        limit=sign * bounds[joint] + 0.0,
                    )
        return None


def _rows(command: JointCommand, previous: JointCommand | None, measured_rad: JointArray) -> list[list[float]]:
    """What `ROWS` compares, joint by joint."""
    position, velocity, stiffness, damping, torque = (values.tolist() for values in command.fields)
    least = [[-value for value in position], [-value for value in stiffness], [-value for value in damping]]
    speed, strength = [abs(value) for value in velocity], [abs(value) for value in torque]
    within = [least[0], position, speed, strength, least[1], stiffness, least[2], damping]
    if previous is None:
        return [*within, _NONE, _NONE, stiffness, strength]
    was_rad, was_stiff, was_nm = (
        values.tolist() for values in (previous.position_rad, previous.stiffness_nm_rad, previous.torque_nm)
    )
    step, grip = [0.0] * 4, [0.0] * 4
    for joint, measured in enumerate(measured_rad.tolist()):
        if was_stiff[joint] > 0:
            step[joint] = abs(position[joint] - was_rad[joint])
        elif stiffness[joint] > 0:
            grip[joint] = abs(position[joint] - measured)
    stiffening = [abs(value - was) for value, was in zip(stiffness, was_stiff, strict=True)]
    return [*within, step, grip, stiffening, [abs(value - was) for value, was in zip(torque, was_nm, strict=True)]]


def _not_finite(command: JointCommand) -> Refusal | None:
    for values in command.fields:
        finite = np.isfinite(values)
        if not finite.all():
            joint = int(np.argmin(finite))
            return Refusal(joint=Joint(joint), quantity=Quantity.NOT_FINITE, value=float(values[joint]), limit=inf)
    return None
