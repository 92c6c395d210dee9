"""What hangs on the emulated drives: a simple leg without gravity, or the simulated exoskeleton with its wearer."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

from hal.joints.bus import TICK_HZ
from hal.joints.codecs.wire import SetPoint
from hal.joints.device import Exoskeleton, JointDevice
from hal.joints.joints import DriveFault, DriveState, JointArray, JointCommand, JointFeedback
from hal.joints.scene import Scene

if TYPE_CHECKING:
    from hal.joints.body import Body

ROOM_C = 25.0
_SUBSTEPS = 4
_STEP_S = 1.0 / TICK_HZ / _SUBSTEPS
# A leg's inertia about hip and knee, roughly (Winter, 75 kg: leg 2.6 kgm² about the hip, shank and foot 0.35)
_LEG_INERTIA_KGM2 = (2.6, 0.35, 2.6, 0.35)


class Plant(Protocol):
    """The two methods of the Joints Protocol that a body needs: a set-point moves it by one tick, `read` tells."""

    def write(self, command: JointCommand, now_ns: int) -> None:
        """Advance by one tick under this impedance law."""
        ...

    def read(self, now_ns: int) -> JointFeedback:
        """Where it is now."""
        ...

    def stage(self, scene: Scene) -> None:
        """Put this around the feet."""
        ...


class _Leg:
    """One joint's inertia; plain floats, because arrays of four cost ten times as much."""

    def __init__(self, joint: JointDevice, leg_inertia_kgm2: float, start_rad: float) -> None:
        self.position_rad, self.velocity_rad_s, self.torque_nm = start_rad, 0.0, 0.0
        self.temperature_c = ROOM_C
        self._joint = joint
        self._inertia = leg_inertia_kgm2 + joint.rotor_inertia_kgm2
        self._low, self._high = math.radians(joint.min_deg), math.radians(joint.max_deg)

    def advance(self, target: SetPoint, step_s: float) -> None:
        """One semi-implicit step of τ = kp(q* − q) + kd(q̇* − q̇) + τ_ff, with friction and end stops."""
        largest = self._joint.max_torque_nm
        wish = (
            target.stiffness_nm_rad * (target.position_rad - self.position_rad)
            + target.damping_nm_s_rad * (target.velocity_rad_s - self.velocity_rad_s)
            + target.torque_nm
        )
        self.torque_nm = min(max(wish, -largest), largest)
        moved = self.velocity_rad_s + step_s * self.torque_nm / self._inertia
        slowed = max(abs(moved) - step_s * self._joint.friction_nm / self._inertia, 0.0)
        self.velocity_rad_s = math.copysign(slowed, moved)
        reached = self.position_rad + step_s * self.velocity_rad_s
        self.position_rad = min(max(reached, self._low), self._high)
        if self.position_rad != reached:
            self.velocity_rad_s = 0.0

    def warm_up(self, step_s: float) -> None:
        """Copper loss in, heat to the room out."""
        joint = self._joint
        heat_w = joint.torque_constant_loss_w_nm2 * self.torque_nm**2
        heat_w -= (self.temperature_c - ROOM_C) / joint.thermal_resistance_k_w
        self.temperature_c += heat_w / joint.thermal_capacity_j_k * step_s


class FreeLegs:
    """Four independent inertias with friction, end stops and a winding that warms up; no gravity, no floor."""

    def __init__(self, device: Exoskeleton, start_rad: JointArray | None = None) -> None:
        start = [0.0] * 4 if start_rad is None else start_rad.tolist()
        self._legs = [_Leg(*row) for row in zip(device.joints, _LEG_INERTIA_KGM2, start, strict=True)]

    def write(self, command: JointCommand, now_ns: int) -> None:  # noqa: ARG002 (the Protocol's)
        """One tick, in small steps."""
        columns = (
            command.position_rad.tolist(),
            command.velocity_rad_s.tolist(),
            command.stiffness_nm_rad.tolist(),
            command.damping_nm_s_rad.tolist(),
            command.torque_nm.tolist(),
        )
        for leg, row in zip(self._legs, zip(*columns, strict=True), strict=True):
            for _ in range(_SUBSTEPS):
                leg.advance(SetPoint(*row), _STEP_S)
            leg.warm_up(_STEP_S * _SUBSTEPS)

    def stage(self, scene: Scene) -> None:
        """Legs in the air touch nothing."""

    def read(self, now_ns: int) -> JointFeedback:
        """Where the legs are."""
        legs = self._legs
        return JointFeedback(
            measured_ns=np.full(4, now_ns, dtype=np.int64),
            position_rad=np.array([leg.position_rad for leg in legs]),
            velocity_rad_s=np.array([leg.velocity_rad_s for leg in legs]),
            torque_nm=np.array([leg.torque_nm for leg in legs]),
            temperature_c=np.array([leg.temperature_c for leg in legs]),
            faults=(DriveFault.NONE,) * 4,
            state=DriveState.ENABLED,
        )


def make_plant(device: Exoskeleton, body: Body | None = None) -> Plant:
    """The simulated exoskeleton with this wearer, or free legs without one."""
    if body is None:
        return FreeLegs(device)
    from hal.joints.simulated import SimulatedJoints

    wearer = SimulatedJoints(device, body, quantised=False)  # the wire does that
    wearer.open(0)
    wearer.enable(0)
    return wearer
