"""Simulated joints: the drives' impedance law on a simulated wearer, stepped by the control tick, never by a clock.

One write is one tick of 2 ms. Drives saturate, lose torque with speed, have friction, warm up, report with noise and
in the wire's quanta. Faults are the drive emulator's part.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, isfinite, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.errors import DrivesFault, HardwareError
from hal.joints.body import Body
from hal.joints.device import ROOM_C, Exoskeleton, JointDevice
from hal.joints.protocol import TICK_S, DriveFault, DriveState, JointArray, JointCommand, JointFeedback
from hal.joints.scene import Scene
from hal.joints.simulated.mjcf import TIMESTEP_S
from hal.joints.simulated.wearer import GroundTruth, ReferencePose, Wearer

SUBSTEPS = round(TICK_S / TIMESTEP_S)
THERMAL_TICKS = 25  # windings follow within seconds
FULL_TORQUE_SPEED = 0.5  # share of the no-load speed up to which a drive gives its full torque

# Quanta of the AK80-64's reply at a direct joint: 16 bit over ±12.5 rad, 12 bit over ±8 rad/s and ±144 Nm.
QUANTA = np.array([[25.0 / 65535], [16.0 / 4095], [288.0 / 4095]])
NOISE = np.array([[2e-4], [0.01], [0.2]])  # rad, rad/s, Nm; standard deviations


class SimulatedJoints:
    """Implements hal.joints.protocol.Joints on a simulated wearer.

    noisy False gives true values; quantised False leaves out the wire's quanta.
    """

    def __init__(self, device: Exoskeleton, body: Body, *, noisy: bool = True, quantised: bool = True) -> None:
        self.wearer = Wearer(device, body)
        self._device = device
        self._thermal = thermal_model(device)
        self._temperatures = at_rest(ROOM_C)
        self._random = np.random.default_rng(0)
        self._noisy, self._quantised = noisy, quantised
        self._state = DriveState.UNCONFIGURED
        self._torque = [0.0] * 4
        self._square, self._ticks = [0.0] * 4, 0
        # Times, angles, speeds, torques, temperatures as reported last; never changed, only replaced.
        self._last: tuple[NDArray[Any], ...] = (
            np.zeros(4, dtype=np.int64),
            *(np.zeros(4), np.zeros(4), np.zeros(4)),
            np.full(4, ROOM_C),
        )

    def open(self, now_ns: int) -> None:
        """Probe."""
        self._state = DriveState.PROBED
        self._measure(now_ns)

    def enable(self, now_ns: int) -> None:
        """Switch the drives on; raises HardwareError when they aren't open."""
        if self._state not in {DriveState.PROBED, DriveState.DISABLED}:
            raise HardwareError(DrivesFault.NOT_READY_TO_ENABLE, state=self._state)
        self._state = DriveState.ENABLED
        self._measure(now_ns)

    def write(self, command: JointCommand, now_ns: int) -> None:  # noqa: ARG002 - the tick is the time here
        """One tick of physics under this command; without power the wearer hangs in the harness."""
        powered = self._state is DriveState.ENABLED
        pose = None
        if powered and any(command.stiffness_nm_rad.tolist()) and all(map(isfinite, command.position_rad.tolist())):
            pose = ReferencePose(self.wearer.body, command.position_rad, command.velocity_rad_s)
        for _ in range(SUBSTEPS):
            self._torque = self._drives(command) if powered else [0.0] * 4
            self.wearer.advance(self._torque, pose)
            self._square = [square + torque * torque for square, torque in zip(self._square, self._torque, strict=True)]
        self._ticks += 1
        if self._ticks % THERMAL_TICKS == 0:
            square = np.array(self._square) / (THERMAL_TICKS * SUBSTEPS)
            self._temperatures = warm(self._thermal, self._temperatures, square, ROOM_C, THERMAL_TICKS * TICK_S)
            self._square = [0.0] * 4

    def read(self, now_ns: int) -> JointFeedback:
        """What the drives report now."""
        if self._state is not DriveState.UNCONFIGURED:
            self._measure(now_ns)
        measured_ns, position_rad, velocity_rad_s, torque_nm, temperature_c = self._last
        return JointFeedback(
            measured_ns=measured_ns,
            position_rad=position_rad,
            velocity_rad_s=velocity_rad_s,
            torque_nm=torque_nm,
            temperature_c=temperature_c,
            faults=(DriveFault.NONE,) * 4,
            state=self._state,
        )

    def close(self, now_ns: int) -> None:
        if self._state is not DriveState.UNCONFIGURED:
            self._state = DriveState.DISABLED
            self._torque = [0.0] * 4
            self._measure(now_ns)

    def stage(self, scene: Scene) -> None:
        """Put the scene of the coming action around the feet."""
        self.wearer.stage(scene)

    def place(self, joints_rad: JointArray) -> None:
        """Put the wearer at rest in a pose (4,), the harness tight."""
        self.wearer.place(joints_rad)

    def settle(self) -> None:
        """Let the wearer come to rest in the harness, without power, before the first tick."""
        self.wearer.settle()

    @property
    def torque_nm(self) -> JointArray:
        """What the drives really give, (4,)."""
        return np.array(self._torque)

    def contact_n(self) -> tuple[float, float]:
        """Vertical force on the left and the right foot."""
        return self.wearer.contact_n()

    def ground_truth(self) -> GroundTruth:
        """Where everything really is."""
        return self.wearer.ground_truth()

    def _drives(self, command: JointCommand) -> list[float]:
        """Motor torques of the impedance law, saturated, four; plain numbers, because arrays of four cost more."""
        rows = zip(
            command.rows(),
            self.wearer.joints_rad.tolist(),
            self.wearer.speeds_rad_s.tolist(),
            self._device.joints,
            strict=True,
        )
        return [
            _saturated(joint, kp * (target - at) + kd * (target_speed - speed) + forward, speed)
            for (target, target_speed, kp, kd, forward), at, speed, joint in rows
        ]

    def _measure(self, now_ns: int) -> None:
        values = np.empty((3, 4))
        values[0], values[1], values[2] = self.wearer.joints_rad, self.wearer.speeds_rad_s, self._torque
        if self._noisy:
            values += NOISE * self._random.standard_normal((3, 4))
        if self._state is not DriveState.ENABLED:
            values[2] = 0.0
        if self._quantised:
            values = np.rint(values / QUANTA) * QUANTA
        self._last = (np.array([now_ns] * 4), values[0], values[1], values[2], self._temperatures.winding_c)


def _saturated(joint: JointDevice, wanted_nm: float, speed_rad_s: float) -> float:
    """The drive's torque for a wanted one: less the faster it turns with it, all of it against it."""
    if not isfinite(wanted_nm):
        return 0.0
    with_torque = copysign(speed_rad_s, wanted_nm * speed_rad_s) / radians(joint.no_load_speed_deg_s)
    limit = joint.max_torque_nm * min(max((1 - with_torque) / (1 - FULL_TORQUE_SPEED), 0.0), 1.0)
    return min(max(wanted_nm, -limit), limit)


WINDING_CAPACITY_SHARE = 0.12
WINDING_RESISTANCE_SHARE = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalModel:
    """Each (4,): heat capacities J/K, resistances K/W winding to housing and housing to room, loss W/Nm²."""

    winding_j_k: JointArray
    housing_j_k: JointArray
    winding_k_w: JointArray
    housing_k_w: JointArray
    loss_w_nm2: JointArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperatures:
    """Each (4,), °C."""

    winding_c: JointArray
    housing_c: JointArray


def thermal_model(device: Exoskeleton) -> ThermalModel:
    """The device's drives, each divided into winding and housing."""
    capacity = np.array([joint.thermal_capacity_j_k for joint in device.joints])
    resistance = np.array([joint.thermal_resistance_k_w for joint in device.joints])
    return ThermalModel(
        winding_j_k=WINDING_CAPACITY_SHARE * capacity,
        housing_j_k=(1 - WINDING_CAPACITY_SHARE) * capacity,
        winding_k_w=WINDING_RESISTANCE_SHARE * resistance,
        housing_k_w=(1 - WINDING_RESISTANCE_SHARE) * resistance,
        loss_w_nm2=np.array([joint.torque_constant_loss_w_nm2 for joint in device.joints]),
    )


def at_rest(room_c: float) -> Temperatures:
    """Drives that have long been off."""
    return Temperatures(winding_c=np.full(4, room_c), housing_c=np.full(4, room_c))


def warm(model: ThermalModel, now: Temperatures, square_nm2: JointArray, room_c: float, time_s: float) -> Temperatures:
    """Temperatures after a time short against seconds; square_nm2: (4,) mean square of the joint torque in it."""
    across = (now.winding_c - now.housing_c) / model.winding_k_w
    winding = now.winding_c + (model.loss_w_nm2 * square_nm2 - across) * (time_s / model.winding_j_k)
    away = (now.housing_c - room_c) / model.housing_k_w
    housing = now.housing_c + (across - away) * (time_s / model.housing_j_k)
    return Temperatures(winding_c=winding, housing_c=housing)
