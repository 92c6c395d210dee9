"""Simulated joints: the drives' impedance law on a simulated wearer, stepped by the control tick, never by a clock.

One write is one tick of 2 ms. Drives saturate, lose torque with speed, rub, warm up, report with noise and in the
wire's quanta; each fault that real ones have can be injected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.errors import HardwareError
from hal.joints.body import Body
from hal.joints.device import Exoskeleton
from hal.joints.joints import BusFault, DriveFault, DriveState, Joint, JointArray, JointCommand, JointFeedback
from hal.joints.mjcf import TIMESTEP_S
from hal.joints.scene import Scene
from hal.joints.thermal import at_rest, thermal_model, warm
from hal.joints.wearer import Truth, Wearer

TICK_S = 0.002
SUBSTEPS = round(TICK_S / TIMESTEP_S)
ROOM_C = 25.0
FULL_TORQUE_SPEED = 0.5  # share of the no-load speed up to which a drive gives its full torque

# Quanta of the AK80-64's reply at a direct joint: 16 bit over ±12.5 rad, 12 bit over ±8 rad/s and ±144 Nm.
POSITION_QUANTUM_RAD = 25.0 / 65535
SPEED_QUANTUM_RAD_S = 16.0 / 4095
TORQUE_QUANTUM_NM = 288.0 / 4095
POSITION_NOISE_RAD = 2e-4
SPEED_NOISE_RAD_S = 0.01
TORQUE_NOISE_NM = 0.2


@dataclass(slots=True)
class Faults:
    """What has been injected, by joint; the methods of SimulatedJoints set it."""

    silent: NDArray[np.bool_]
    stuck: NDArray[np.bool_]
    lost_share: float = 0.0
    bits: list[DriveFault] | None = None
    bus: BusFault = BusFault.NONE
    temperature_c: JointArray | None = None
    drag_nm: JointArray | None = None


class SimulatedJoints:
    """Implements hal.joints.joints.Joints on a simulated wearer.

    seed: of the sensors' noise; noisy False gives true values; quantised False leaves out the wire's quanta.
    """

    def __init__(
        self, device: Exoskeleton, body: Body, *, seed: int = 0, noisy: bool = True, quantised: bool = True
    ) -> None:
        self.wearer = Wearer(device, body)
        self._device = device
        self._torque_limit = np.array([joint.max_torque_nm for joint in device.joints])
        self._no_load_speed = np.radians([joint.no_load_speed_deg_s for joint in device.joints])
        self._thermal = thermal_model(device)
        self._temperatures = at_rest(ROOM_C)
        self._random = np.random.default_rng(seed)
        self._noisy, self._quantised = noisy, quantised
        self._state = DriveState.UNCONFIGURED
        self._torque = np.zeros(4)
        self._stuck_at = np.zeros(4)
        self._last = JointFeedback(
            measured_ns=np.zeros(4, dtype=np.int64),
            position_rad=np.zeros(4),
            velocity_rad_s=np.zeros(4),
            torque_nm=np.zeros(4),
            temperature_c=np.full(4, ROOM_C),
            faults=(DriveFault.NONE,) * 4,
            state=DriveState.UNCONFIGURED,
        )
        self.faults = Faults(silent=np.zeros(4, dtype=bool), stuck=np.zeros(4, dtype=bool))

    def open(self, now_ns: int) -> None:
        """Probe: raises HardwareError naming the joints that are silent."""
        missing = [Joint(number).name.lower().replace("_", " ") for number in np.flatnonzero(self.faults.silent)]
        if missing:
            raise HardwareError(f"No answer from {', '.join(missing)}: check its power and its cable.")
        self._state = DriveState.PROBED
        self._measure(now_ns)

    def enable(self, now_ns: int) -> None:
        """Switch the drives on; raises HardwareError when they aren't open or a fault is present."""
        if self._state not in {DriveState.PROBED, DriveState.DISABLED}:
            raise HardwareError(f"The drives can't be enabled while they are {self._state.value}; open them first.")
        if self.faults.bits and any(self.faults.bits):
            raise HardwareError("A drive reports a fault and can't be enabled; mend it and open the joints again.")
        self._state = DriveState.ENABLED
        self._measure(now_ns)

    def write(self, command: JointCommand, now_ns: int) -> None:  # noqa: ARG002 - the tick is the time here
        """One tick of physics under this command; without power the wearer hangs in the harness."""
        powered = self._state is DriveState.ENABLED
        knees = None
        if powered and command.stiffness_nm_rad.any():
            left, right = command.position_rad[1], command.position_rad[3]
            knees = (float(left), float(right)) if np.isfinite(left + right) else None
        square = np.zeros(4)
        for _ in range(SUBSTEPS):
            self._torque = self._drive(command) if powered else np.zeros(4)
            square += self._torque * self._torque
            self.wearer.advance(self._at_joint(self._torque), knees)
        self._temperatures = warm(self._thermal, self._temperatures, square / SUBSTEPS, ROOM_C, TICK_S)

    def read(self, now_ns: int) -> JointFeedback:
        """What the drives report now; silent ones keep their last word and its time."""
        if self._state is not DriveState.UNCONFIGURED:
            self._measure(now_ns)
        bus, self.faults.bus = self.faults.bus, BusFault.NONE
        last = self._last
        return JointFeedback(
            measured_ns=last.measured_ns.copy(),
            position_rad=last.position_rad.copy(),
            velocity_rad_s=last.velocity_rad_s.copy(),
            torque_nm=last.torque_nm.copy(),
            temperature_c=last.temperature_c.copy(),
            faults=_four(self.faults.bits),
            state=self._reported_state(),
            bus=bus,
        )

    def close(self, now_ns: int) -> None:
        """Switch the drives off."""
        if self._state is not DriveState.UNCONFIGURED:
            self._state = DriveState.DISABLED
            self._torque = np.zeros(4)
            self._measure(now_ns)

    def stage(self, scene: Scene) -> None:
        """Put the scene of the coming action around the feet."""
        self.wearer.stage(scene)

    def place(self, joints_rad: JointArray) -> None:
        """Put the wearer at rest in a pose (4,), the harness tight."""
        self.wearer.place(joints_rad)

    def truth(self) -> Truth:
        """Where everything really is."""
        return self.wearer.truth()

    def warm_to(self, joint: Joint, temperature_c: float) -> None:
        """Fault: this winding has this temperature from now on, whatever it does."""
        temperature = np.full(4, np.nan) if self.faults.temperature_c is None else self.faults.temperature_c
        temperature[joint] = temperature_c
        self.faults.temperature_c = temperature

    def silence(self, joint: Joint) -> None:
        """Fault: this drive does not answer any more; it goes on doing what it was told."""
        self.faults.silent[joint] = True

    def raise_fault(self, joint: Joint, fault: DriveFault) -> None:
        """Fault: this drive reports a fault bit and gives no torque."""
        bits = list(_four(self.faults.bits))
        bits[joint] = fault
        self.faults.bits = bits

    def jam(self, joint: Joint) -> None:
        """Fault: this joint is stuck where it is."""
        self.faults.stuck[joint] = True
        self._stuck_at = np.where(self.faults.stuck, self.wearer.joints_rad, self._stuck_at)

    def drag(self, joint: Joint, torque_nm: float) -> None:
        """Fault: something holds this joint back with this torque: its following error grows."""
        dragged = np.zeros(4) if self.faults.drag_nm is None else self.faults.drag_nm
        dragged[joint] = torque_nm
        self.faults.drag_nm = dragged

    def lose_frames(self, share: float) -> None:
        """Fault: this share of the drives' answers, 0 to 1, never arrives."""
        self.faults.lost_share = share

    def disturb_bus(self, fault: BusFault) -> None:
        """Fault: the next read tells this of the bus."""
        self.faults.bus |= fault

    def mend(self) -> None:
        """All injected faults end."""
        self.faults = Faults(silent=np.zeros(4, dtype=bool), stuck=np.zeros(4, dtype=bool))

    def _drive(self, command: JointCommand) -> JointArray:
        """Motor torque of the impedance law, saturated, (4,)."""
        position, speed = self.wearer.joints_rad, self.wearer.speeds_rad_s
        wish = (
            command.stiffness_nm_rad * (command.position_rad - position)
            + command.damping_nm_s_rad * (command.velocity_rad_s - speed)
            + command.torque_nm
        )
        if not np.isfinite(wish).all():
            wish = np.nan_to_num(wish, nan=0.0, posinf=0.0, neginf=0.0)
        limit = self._torque_limit
        fast = (1 - speed * np.sign(wish) / self._no_load_speed) / (1 - FULL_TORQUE_SPEED)
        limit = limit * np.clip(fast, 0.0, 1.0)  # turning against its torque a drive gives all it has
        torque: JointArray = np.clip(wish, -limit, limit)
        if self.faults.bits:
            torque = np.where([bool(bit) for bit in self.faults.bits], 0.0, torque)
        return torque

    def _at_joint(self, torque: JointArray) -> JointArray:
        faults = self.faults
        if faults.drag_nm is not None:
            torque = torque - faults.drag_nm * np.tanh(self.wearer.speeds_rad_s / 0.02)
        if faults.stuck.any():
            away = self.wearer.joints_rad - self._stuck_at
            held = -20_000.0 * away - 300.0 * self.wearer.speeds_rad_s
            torque = np.where(faults.stuck, held, torque)
        return torque

    def _measure(self, now_ns: int) -> None:
        heard = ~self.faults.silent
        if self.faults.lost_share:
            heard &= self._random.random(4) >= self.faults.lost_share
        position, speed, torque = self.wearer.joints_rad, self.wearer.speeds_rad_s, self._torque
        if self._noisy:
            noise = self._random.standard_normal((3, 4))
            position = position + POSITION_NOISE_RAD * noise[0]
            speed = speed + SPEED_NOISE_RAD_S * noise[1]
            torque = torque + TORQUE_NOISE_NM * noise[2] * (self._state is DriveState.ENABLED)
        if self._quantised:
            position = np.round(position / POSITION_QUANTUM_RAD) * POSITION_QUANTUM_RAD
            speed = np.round(speed / SPEED_QUANTUM_RAD_S) * SPEED_QUANTUM_RAD_S
            torque = np.round(torque / TORQUE_QUANTUM_NM) * TORQUE_QUANTUM_NM
        temperature = self._temperatures.winding_c
        if self.faults.temperature_c is not None:
            temperature = np.where(np.isnan(self.faults.temperature_c), temperature, self.faults.temperature_c)
        last = self._last
        last.measured_ns[heard] = now_ns
        last.position_rad[heard] = position[heard]
        last.velocity_rad_s[heard] = speed[heard]
        last.torque_nm[heard] = torque[heard]
        last.temperature_c[heard] = temperature[heard]

    def _reported_state(self) -> DriveState:
        faulted = self.faults.bits is not None and any(self.faults.bits) and self._state is DriveState.ENABLED
        return DriveState.FAULTED if faulted else self._state


def _four(bits: list[DriveFault] | None) -> tuple[DriveFault, DriveFault, DriveFault, DriveFault]:
    if bits is None:
        return (DriveFault.NONE, DriveFault.NONE, DriveFault.NONE, DriveFault.NONE)
    return (bits[0], bits[1], bits[2], bits[3])
