"""Simulated joints: the drives' impedance law on a simulated wearer, stepped by the control tick, never by a clock.

One write is one tick of 2 ms. Drives saturate, lose torque with speed, have friction, warm up, report with noise and
in the wire's quanta; each fault that real ones have can be injected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import copysign, isfinite, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.errors import DrivesFault, HardwareError
from hal.joints.body import Body
from hal.joints.device import Exoskeleton, JointDevice
from hal.joints.protocol import TICK_S, BusFault, DriveFault, DriveState, Joint, JointArray, JointCommand, JointFeedback
from hal.joints.scene import Scene
from hal.joints.simulated.mjcf import TIMESTEP_S
from hal.joints.simulated.thermal import at_rest, thermal_model, warm
from hal.joints.simulated.wearer import GroundTruth, ReferencePose, Wearer

SUBSTEPS = round(TICK_S / TIMESTEP_S)
THERMAL_TICKS = 25  # windings follow within seconds
ROOM_C = 25.0
FULL_TORQUE_SPEED = 0.5  # share of the no-load speed up to which a drive gives its full torque

# Quanta of the AK80-64's reply at a direct joint: 16 bit over ±12.5 rad, 12 bit over ±8 rad/s and ±144 Nm.
QUANTA = np.array([[25.0 / 65535], [16.0 / 4095], [288.0 / 4095]])
NOISE = np.array([[2e-4], [0.01], [0.2]])  # rad, rad/s, Nm; standard deviations


@dataclass(slots=True)
class Faults:
    """What has been injected, by joint; the methods of SimulatedJoints set it."""

    silent: set[Joint] = field(default_factory=set)
    stuck: set[Joint] = field(default_factory=set)
    lost_share: float = 0.0
    bits: list[DriveFault] | None = None
    bus: BusFault = BusFault.NONE
    temperature_c: JointArray | None = None
    drag_nm: JointArray | None = None


class SimulatedJoints:
    """Implements hal.joints.protocol.Joints on a simulated wearer.

    seed: of the sensors' noise; noisy False gives true values; quantised False leaves out the wire's quanta.
    """

    def __init__(
        self, device: Exoskeleton, body: Body, *, seed: int = 0, noisy: bool = True, quantised: bool = True
    ) -> None:
        self.wearer = Wearer(device, body)
        self._device = device
        self._thermal = thermal_model(device)
        self._temperatures = at_rest(ROOM_C)
        self._random = np.random.default_rng(seed)
        self._noisy, self._quantised = noisy, quantised
        self._state = DriveState.UNCONFIGURED
        self._torque = [0.0] * 4
        self._square, self._ticks = [0.0] * 4, 0
        self._stuck_at = np.zeros(4)
        # Times, angles, speeds, torques, temperatures as reported last; never changed, only replaced.
        self._last: tuple[NDArray[Any], ...] = (
            np.zeros(4, dtype=np.int64),
            *(np.zeros(4), np.zeros(4), np.zeros(4)),
            np.full(4, ROOM_C),
        )
        self.faults = Faults()

    def open(self, now_ns: int) -> None:
        """Probe: raises HardwareError naming the joints that are silent."""
        missing = tuple(sorted(self.faults.silent))
        if missing:
            can_ids = ", ".join(str(self._device.joints[joint].can_id) for joint in missing)
            raise HardwareError(DrivesFault.NO_REPLY, joints=missing, can_ids=can_ids)
        self._state = DriveState.PROBED
        self._measure(now_ns)

    def enable(self, now_ns: int) -> None:
        """Switch the drives on; raises HardwareError when they aren't open or a fault is present."""
        if self._state not in {DriveState.PROBED, DriveState.DISABLED}:
            raise HardwareError(DrivesFault.NOT_READY_TO_ENABLE, state=self._state)
        for joint, fault in zip(Joint, self.faults.bits or (), strict=False):
            if fault:
                device = self._device.joints[joint]
                identity = {"joint": joint, "can_id": device.can_id, "motor": device.motor}
                raise HardwareError(DrivesFault.FAULT_BEFORE_ENABLING, **identity, faults=tuple(fault))
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
            self.wearer.advance(self._at_joint(self._torque), pose)
            self._square = [square + torque * torque for square, torque in zip(self._square, self._torque, strict=True)]
        self._ticks += 1
        if self._ticks % THERMAL_TICKS == 0:
            square = np.array(self._square) / (THERMAL_TICKS * SUBSTEPS)
            self._temperatures = warm(self._thermal, self._temperatures, square, ROOM_C, THERMAL_TICKS * TICK_S)
            self._square = [0.0] * 4

    def read(self, now_ns: int) -> JointFeedback:
        """What the drives report now; silent ones keep their last report and its time."""
        if self._state is not DriveState.UNCONFIGURED:
            self._measure(now_ns)
        bus, self.faults.bus = self.faults.bus, BusFault.NONE
        measured_ns, position_rad, velocity_rad_s, torque_nm, temperature_c = self._last
        return JointFeedback(
            measured_ns=measured_ns,
            position_rad=position_rad,
            velocity_rad_s=velocity_rad_s,
            torque_nm=torque_nm,
            temperature_c=temperature_c,
            faults=_four(self.faults.bits),
            state=self._reported_state(),
            bus=bus,
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

    def warm_to(self, joint: Joint, temperature_c: float) -> None:
        """Fault: this winding has this temperature from now on, whatever it does."""
        temperature = np.full(4, np.nan) if self.faults.temperature_c is None else self.faults.temperature_c
        temperature[joint] = temperature_c
        self.faults.temperature_c = temperature

    def silence(self, joint: Joint) -> None:
        """Fault: this drive does not answer any more; it goes on with its last command."""
        self.faults.silent.add(joint)

    def raise_fault(self, joint: Joint, fault: DriveFault) -> None:
        """Fault: this drive reports a fault bit and gives no torque."""
        bits = list(_four(self.faults.bits))
        bits[joint] = fault
        self.faults.bits = bits

    def jam(self, joint: Joint) -> None:
        """Fault: this joint is stuck where it is."""
        self.faults.stuck.add(joint)
        self._stuck_at = np.where(_among(self.faults.stuck), self.wearer.joints_rad, self._stuck_at)

    def drag(self, joint: Joint, torque_nm: float) -> None:
        """Fault: something holds this joint back with this torque: its following error grows."""
        dragged = np.zeros(4) if self.faults.drag_nm is None else self.faults.drag_nm
        dragged[joint] = torque_nm
        self.faults.drag_nm = dragged

    def lose_frames(self, share: float) -> None:
        """Fault: this share of the drives' answers, 0 to 1, never arrives."""
        self.faults.lost_share = share

    def disturb_bus(self, fault: BusFault) -> None:
        """Fault: the next read reports this of the bus."""
        self.faults.bus |= fault

    def clear_faults(self) -> None:
        """All injected faults end."""
        self.faults = Faults()

    def _drives(self, command: JointCommand) -> list[float]:
        """Motor torques of the impedance law, saturated, four; plain numbers, because arrays of four cost more."""
        rows = zip(
            command.rows(),
            self.wearer.joints_rad.tolist(),
            self.wearer.speeds_rad_s.tolist(),
            self._device.joints,
            strict=True,
        )
        torques = [
            _saturated(joint, kp * (target - at) + kd * (target_speed - speed) + forward, speed)
            for (target, target_speed, kp, kd, forward), at, speed, joint in rows
        ]
        if self.faults.bits:
            return [0.0 if bit else torque for bit, torque in zip(self.faults.bits, torques, strict=True)]
        return torques

    def _at_joint(self, motor_nm: list[float]) -> Sequence[float]:
        faults = self.faults
        if faults.drag_nm is None and not faults.stuck:
            return motor_nm
        torque = np.array(motor_nm)
        speeds = self.wearer.speeds_rad_s
        if faults.drag_nm is not None:
            torque -= faults.drag_nm * np.tanh(speeds / 0.02)
        held = -10_000.0 * (self.wearer.joints_rad - self._stuck_at) - 100.0 * speeds
        blocked: list[float] = np.where(_among(faults.stuck), held, torque).tolist()
        return blocked

    def _measure(self, now_ns: int) -> None:
        values = np.empty((3, 4))
        values[0], values[1], values[2] = self.wearer.joints_rad, self.wearer.speeds_rad_s, self._torque
        if self._noisy:
            values += NOISE * self._random.standard_normal((3, 4))
        if self._state is not DriveState.ENABLED:
            values[2] = 0.0
        if self._quantised:
            values = np.rint(values / QUANTA) * QUANTA
        temperature = self._temperatures.winding_c
        if self.faults.temperature_c is not None:
            temperature = np.where(np.isnan(self.faults.temperature_c), temperature, self.faults.temperature_c)
        now: tuple[NDArray[Any], ...] = (np.array([now_ns] * 4), values[0], values[1], values[2], temperature)
        if self.faults.silent or self.faults.lost_share:
            arrived = ~_among(self.faults.silent) & (self._random.random(4) >= self.faults.lost_share)
            now = tuple(np.where(arrived, new, last) for new, last in zip(now, self._last, strict=True))
        self._last = now

    def _reported_state(self) -> DriveState:
        faulted = self.faults.bits is not None and any(self.faults.bits) and self._state is DriveState.ENABLED
        return DriveState.FAULTED if faulted else self._state


def _among(joints: set[Joint]) -> NDArray[np.bool_]:
    """(4,): which joints these are."""
    return np.array([joint in joints for joint in Joint])


def _saturated(joint: JointDevice, wanted_nm: float, speed_rad_s: float) -> float:
    """The drive's torque for a wanted one: less the faster it turns with it, all of it against it."""
    if not isfinite(wanted_nm):
        return 0.0
    with_torque = copysign(speed_rad_s, wanted_nm * speed_rad_s) / radians(joint.no_load_speed_deg_s)
    limit = joint.max_torque_nm * min(max((1 - with_torque) / (1 - FULL_TORQUE_SPEED), 0.0), 1.0)
    return min(max(wanted_nm, -limit), limit)


def _four(bits: list[DriveFault] | None) -> tuple[DriveFault, DriveFault, DriveFault, DriveFault]:
    if bits is None:
        return (DriveFault.NONE, DriveFault.NONE, DriveFault.NONE, DriveFault.NONE)
    return (bits[0], bits[1], bits[2], bits[3])
