"""What hangs on the emulated drives: a simple leg without gravity, or the simulated exoskeleton with its wearer."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Protocol

from hal.joints.codecs.wire import SetPoint
from hal.joints.device import ROOM_C, Exoskeleton, JointDevice
from hal.joints.protocol import TICK_HZ, JointCommand
from hal.joints.scene import Scene

if TYPE_CHECKING:
    from hal.joints.body import Body
    from hal.joints.simulated.driver import SimulatedJoints

_SUBSTEPS = 4
_THERMAL_TICKS = 50  # windings warm in seconds
_STEP_S = 1.0 / TICK_HZ / _SUBSTEPS
# A leg's inertia about hip and knee, roughly (Winter, 75 kg: leg 2.6 kgm² about the hip, shank and foot 0.35)
_LEG_INERTIA_KGM2 = (2.6, 0.35, 2.6, 0.35)


class Motion(NamedTuple):
    """A joint, or a motor's output, as it is now."""

    position_rad: float
    velocity_rad_s: float
    torque_nm: float
    temperature_c: float


class Plant(Protocol):
    """What the emulated drives move."""

    def write(self, command: JointCommand, now_ns: int) -> None: ...

    def motions(self) -> list[Motion]:
        """Where the four joints are now; plain numbers, because arrays of four cost more."""

    def stage(self, scene: Scene) -> None: ...


class _Leg:
    """One joint's inertia; plain floats, because arrays of four cost ten times as much."""

    def __init__(self, joint: JointDevice, leg_inertia_kgm2: float) -> None:
        self.position_rad, self.velocity_rad_s, self.torque_nm = 0.0, 0.0, 0.0
        self.temperature_c = ROOM_C
        self._joint = joint
        self._inertia = leg_inertia_kgm2 + joint.rotor_inertia_kgm2
        self._low, self._high = math.radians(joint.min_deg), math.radians(joint.max_deg)

    def advance(self, target: SetPoint, step_s: float) -> None:
        """One semi-implicit step of τ = kp(q* − q) + kd(q̇* − q̇) + τ_ff, with friction and end stops."""
        largest = self._joint.max_torque_nm
        wanted = (
            target.stiffness_nm_rad * (target.position_rad - self.position_rad)
            + target.damping_nm_s_rad * (target.velocity_rad_s - self.velocity_rad_s)
            + target.torque_nm
        )
        self.torque_nm = min(max(wanted, -largest), largest)
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

    def __init__(self, device: Exoskeleton) -> None:
        self._legs = [_Leg(*row) for row in zip(device.joints, _LEG_INERTIA_KGM2, strict=True)]

    def write(self, command: JointCommand, now_ns: int) -> None:  # noqa: ARG002 (the Protocol's)
        for leg, row in zip(self._legs, command.rows(), strict=True):
            for _ in range(_SUBSTEPS):
                leg.advance(SetPoint(*row), _STEP_S)
            leg.warm_up(_STEP_S * _SUBSTEPS)

    def stage(self, scene: Scene) -> None:
        """Legs in the air touch nothing."""

    def motions(self) -> list[Motion]:
        return [Motion(leg.position_rad, leg.velocity_rad_s, leg.torque_nm, leg.temperature_c) for leg in self._legs]


class WornExoskeleton:
    """The simulated exoskeleton with its wearer; without its sensors' noise and quanta, the drives have their own."""

    def __init__(self, device: Exoskeleton, body: Body) -> None:
        from hal.joints.simulated.driver import SimulatedJoints

        self._joints: SimulatedJoints = SimulatedJoints(device, body, noisy=False, quantised=False)
        self._joints.settle()
        self._joints.open(0)
        self._joints.enable(0)
        self._ticks = 0
        self._temperature_c = [ROOM_C] * 4

    def write(self, command: JointCommand, now_ns: int) -> None:
        self._joints.write(command, now_ns)
        self._ticks += 1
        if self._ticks % _THERMAL_TICKS == 0:
            self._temperature_c = self._joints.read(now_ns).temperature_c.tolist()

    def stage(self, scene: Scene) -> None:
        self._joints.stage(scene)

    def motions(self) -> list[Motion]:
        wearer = self._joints.wearer
        angles, speeds = wearer.joints_rad.tolist(), wearer.speeds_rad_s.tolist()
        torques = self._joints.torque_nm.tolist()
        return list(map(Motion, angles, speeds, torques, self._temperature_c))
