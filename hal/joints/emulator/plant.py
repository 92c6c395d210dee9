"""What hangs on the emulated drives: a simple leg without gravity, or the simulated exoskeleton with its wearer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from hal.joints.bus import TICK_HZ
from hal.joints.device import Exoskeleton
from hal.joints.joints import DriveFault, DriveState, JointArray, JointCommand, JointFeedback

if TYPE_CHECKING:
    from hal.joints.body import Body

ROOM_C = 25.0
_SUBSTEPS = 4
# A leg's inertia about hip and knee, roughly (Winter, 75 kg: leg 2.6 kgm² about the hip, shank and foot 0.35)
_LEG_INERTIA_KGM2 = np.array([2.6, 0.35, 2.6, 0.35])


class Plant(Protocol):
    """The two methods of the Joints Protocol that a body needs: a set-point moves it by one tick, `read` tells."""

    def write(self, command: JointCommand, now_ns: int) -> None:
        """Advance by one tick under this impedance law."""
        ...

    def read(self, now_ns: int) -> JointFeedback:
        """Where it is now."""
        ...


class FreeLegs:
    """Four independent inertias with friction, end stops and a winding that warms up; no gravity, no floor."""

    def __init__(self, device: Exoskeleton, start_rad: JointArray | None = None) -> None:
        joints = device.joints
        self._position = np.zeros(4) if start_rad is None else start_rad.astype(np.float64)
        self._velocity = np.zeros(4)
        self._torque = np.zeros(4)
        self._temperature = np.full(4, ROOM_C)
        self._inertia = _LEG_INERTIA_KGM2 + np.array([joint.rotor_inertia_kgm2 for joint in joints])
        self._friction = np.array([joint.friction_nm for joint in joints])
        self._largest = np.array([joint.max_torque_nm for joint in joints])
        self._low = np.radians([joint.min_deg for joint in joints])
        self._high = np.radians([joint.max_deg for joint in joints])
        self._loss = np.array([joint.torque_constant_loss_w_nm2 for joint in joints])
        self._resistance = np.array([joint.thermal_resistance_k_w for joint in joints])
        self._capacity = np.array([joint.thermal_capacity_j_k for joint in joints])

    def write(self, command: JointCommand, now_ns: int) -> None:  # noqa: ARG002 (the Protocol's)
        """One tick of τ = kp(q* − q) + kd(q̇* − q̇) + τ_ff, semi-implicit in small steps."""
        step_s = 1.0 / TICK_HZ / _SUBSTEPS
        for _ in range(_SUBSTEPS):
            wish = (
                command.stiffness_nm_rad * (command.position_rad - self._position)
                + command.damping_nm_s_rad * (command.velocity_rad_s - self._velocity)
                + command.torque_nm
            )
            self._torque = np.clip(wish, -self._largest, self._largest)
            moved = self._velocity + step_s * self._torque / self._inertia
            slowed = np.maximum(np.abs(moved) - step_s * self._friction / self._inertia, 0.0)
            self._velocity = np.sign(moved) * slowed
            self._position = self._position + step_s * self._velocity
            stopped = (self._position < self._low) | (self._position > self._high)
            self._position = np.clip(self._position, self._low, self._high)
            self._velocity[stopped] = 0.0
        heat = self._loss * self._torque**2 - (self._temperature - ROOM_C) / self._resistance
        self._temperature = self._temperature + heat / self._capacity / TICK_HZ

    def read(self, now_ns: int) -> JointFeedback:
        """Where the legs are."""
        return JointFeedback(
            measured_ns=np.full(4, now_ns, dtype=np.int64),
            position_rad=self._position.copy(),
            velocity_rad_s=self._velocity.copy(),
            torque_nm=self._torque.copy(),
            temperature_c=self._temperature.copy(),
            faults=(DriveFault.NONE,) * 4,
            state=DriveState.ENABLED,
        )


def make_plant(device: Exoskeleton, body: Body | None = None) -> Plant:
    """The simulated exoskeleton with this wearer, or free legs without one."""
    if body is None:
        return FreeLegs(device)
    from hal.joints.simulated import SimulatedJoints

    wearer = SimulatedJoints(device, body)
    wearer.open(0)
    wearer.enable(0)
    return wearer
