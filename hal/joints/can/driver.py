"""The four drives on CAN, through python-can: any of its interfaces, `socketcan` on a robot.

In a tick nothing waits and nothing raises; `read` reports what goes wrong. Opening, enabling and closing wait for
the drives' answers. After a fault the drives are never enabled again by themselves: close, open, enable.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hal.errors import CanFault, DrivesFault, HardwareError
from hal.joints.can import lifecycle
from hal.joints.can.bus import AbsentBus, open_bus
from hal.joints.can.description import check_description
from hal.joints.can.drive import Drive, Router, count_silences, drives_of
from hal.joints.can.port import BusPort
from hal.joints.can.range_check import RangeCheck
from hal.joints.codecs import damiao
from hal.joints.codecs.wire import Frame, SetPoint
from hal.joints.device import Exoskeleton
from hal.joints.protocol import BusFault, DriveFault, DriveState, Joint, JointCommand, JointFeedback

_ENDING = BusFault.BUS_OFF | BusFault.INTERFACE_GONE  # of the bus; with these the drives are out of reach
_POWERED = (DriveState.ENABLED, DriveState.FAULTED)
POLL_NS = 20_000_000  # how often drives without power are asked where they are: a screen needs no more


class SocketCanJoints:
    """The Joints Protocol on one or more CAN buses."""

    def __init__(self, device: Exoskeleton, *, motors: Path | None = None, damp_first: bool = False) -> None:
        """damp_first: a wearer may be held by what a dead session left on, so damp it before the first probe.

        Raises HardwareError when the motor table or the bus can't carry this device.
        """
        self.device = device
        self._damp_first = damp_first
        self.drives = drives_of(device, motors)
        check_description(device, self.drives)
        self._state = DriveState.UNCONFIGURED
        self._ports: list[BusPort] = []
        self._routers: list[Router] = []
        self._sent: list[bool] = []  # whether each bus took all of the newest commands
        self._drives_on: list[list[Drive]] = []
        self._absent: dict[int, HardwareError] = {}  # buses that could not be opened, while the others are used
        self._enabled_ns = 0
        self._polled_ns = 0
        self.unconfirmed: list[Drive] = []  # were enabled, and have not confirmed that they are off
        self.questions: dict[Joint, lifecycle.Request] = {}  # what each drive answers without power
        self._unasked = frozenset[Joint]()  # by the last probe

    @property
    def state(self) -> DriveState:
        """Where in its life cycle the driver is."""
        return self._state

    def open(self, now_ns: int) -> None:
        """Probe: who answers, and with which ranges where the drive reports them.

        Raises HardwareError naming the bus or the joint. Drives that may have been left on lose their torque also where
        another bus is missing.
        """
        if self._ports:
            raise HardwareError(DrivesFault.ALREADY_OPEN)
        for drive in self.drives:
            drive.range_check = RangeCheck()
        try:
            left_on = self._damp_first and self._state is DriveState.UNCONFIGURED  # later they have been off
            self._open_ports(now_ns, in_part=left_on)
            reachable = [drive for drive in self.drives if drive.device.can_bus not in self._absent]
            if left_on:
                lifecycle.damp_left_on(self, reachable)
            if self._absent:
                lifecycle.confirm_off(self, reachable)
                raise next(iter(self._absent.values()))
            lifecycle.probe(self)
            self._unasked = frozenset(joint for joint in Joint if joint not in self.questions)
        except HardwareError:
            self._release()
            raise
        self._state = DriveState.PROBED

    def enable(self, now_ns: int) -> None:
        """Neutral command, enable, neutral again, confirmed by feedback; the gains then ramp by themselves.

        Raises HardwareError, with every drive disabled, when one does not confirm.
        """
        if self._state is not DriveState.PROBED:
            raise HardwareError(DrivesFault.NOT_READY_TO_ENABLE, state=self._state)
        lifecycle.enable(self)
        self._state = DriveState.ENABLED
        self._enabled_ns = max(now_ns, time.monotonic_ns())

    def write(self, command: JointCommand, now_ns: int) -> None:
        """Send one set-point a drive, at once; drives that are not enabled are only asked where they are."""
        if self._state is DriveState.PROBED and now_ns - self._polled_ns >= POLL_NS:
            self._polled_ns = now_ns
            lifecycle.poll(self)
        if self._state not in _POWERED:
            return
        rows = _rows(command)
        if rows is None:
            rows = [SetPoint(0.0, 0.0, 0.0, drive.device.damp_nm_s_rad, 0.0) for drive in self.drives]
            self._ports[0].report(BusFault.SEND_FAILED, CanFault.INVALID_COMMAND_DAMPED)
        for drives, sent in zip(self._drives_on, self._sent, strict=True):
            if sent:  # a command that the bus refused could not be answered
                count_silences(drives)
        rising = self._soft_start(now_ns)
        leaving: list[list[Frame]] = [[] for _ in self._ports]
        for drive, row in zip(self.drives, rows, strict=True):
            if rising < 1.0:
                stiffness, torque = row.stiffness_nm_rad * rising, row.torque_nm * rising
                row = row._replace(stiffness_nm_rad=stiffness, torque_nm=torque)  # noqa: PLW2901
            leaving[drive.device.can_bus].append(drive.command(row))
        self._sent = [port.send(*frames) for port, frames in zip(self._ports, leaving, strict=True)]

    def read(self, now_ns: int) -> JointFeedback:
        """Take in what has arrived. Faults of bus and drives come with the feedback, never as an exception."""
        for number, port in enumerate(self._ports):
            for frame, measured_ns in port.drain(now_ns):
                self._take(number, frame, measured_ns)
        return self._feedback()

    def close(self, now_ns: int) -> None:
        """Damp, disable, confirm, release.

        Raises HardwareError, after releasing, when a drive that was enabled did not confirm that it is off; the next
        call asks it again, over those buses that can be opened anew: an adapter may have been plugged in meanwhile.
        Until it has confirmed it counts as one that has never answered.
        """
        if not self._ports and not self.unconfirmed:
            return
        try:
            if not self._ports:
                self._open_ports(now_ns, in_part=True)
            if self._state in _POWERED:
                self.unconfirmed = lifecycle.disable(self)
            elif self.unconfirmed:  # those alone: one that was out of reach may still be stiff
                lifecycle.damp_left_on(self, self.unconfirmed)
                self.unconfirmed = lifecycle.confirm_off(self, self.unconfirmed)
        finally:
            self._release()
            for drive in self.unconfirmed:
                drive.measured_ns = 0
        if self.unconfirmed and self._absent:
            raise next(iter(self._absent.values()))
        if self.unconfirmed:
            joints = tuple(drive.joint for drive in self.unconfirmed)
            raise HardwareError(DrivesFault.NOT_CONFIRMED_OFF, joints=joints)

    def send(self, drive: Drive, frames: list[Frame]) -> bool:
        """Frames to a drive's bus; False when it refused one of them (for the life cycle)."""
        return self._ports[drive.device.can_bus].send(*frames)

    def listen(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Take in frames until `done`, at most for `timeout_s` (for the life cycle, never in a tick)."""
        deadline_ns = time.monotonic_ns() + int(timeout_s * 1e9)
        share_s = 0.002 if len(self._ports) > 1 else 0.01
        while not done():
            late = time.monotonic_ns() >= deadline_ns
            for number, port in enumerate(self._ports):
                wait_s = 0.0 if late else share_s
                while (frames := port.wait_for_arrivals(wait_s)) is not None:
                    for frame, measured_ns in frames:
                        self._take(number, frame, measured_ns)
                    wait_s = 0.0
            if late:  # what had come by then counts, also where the host was too busy to read
                return done()
        return True

    def registers(self, drive: Drive, wanted: tuple[int, ...]) -> dict[int, float]:
        """What a Damiao drive reports of its registers, each asked several times: one frame may be lost.

        Those it does not know are missing (for the life cycle).
        """
        reported: dict[int, float] = {}
        router = self._routers[drive.device.can_bus]
        for register in wanted:
            router.expect_register(drive, register, reported)
            asked = self._ask_register(drive, register, reported)
            if not reported:
                break
            if register in reported and asked == 1:
                router.forget_register(drive, register)
        return reported

    def _ask_register(self, drive: Drive, register: int, reported: dict[int, float]) -> int:
        """Ask until it is reported, or often enough; how often."""
        question = damiao.read_register(drive.device.can_id, register)
        for asked in range(lifecycle.ATTEMPTS):
            if register in reported:
                return asked
            self.send(drive, [drive.ask(question)])
            self.listen(lambda: register in reported, 0.05)
        return lifecycle.ATTEMPTS

    def take_bus_fault(self) -> HardwareError | None:
        """What is wrong with the buses since the last call (for the life cycle)."""
        return self._bus_faults()[1]

    def _open_ports(self, now_ns: int, *, in_part: bool = False) -> None:
        """in_part: without those that fail, unless all do. Raises HardwareError."""
        self._absent = {}
        for number, bus in enumerate(self.device.buses):  # one by one: `_release` closes those before one that fails
            try:
                opened = open_bus(bus)
            except HardwareError as error:
                self._absent[number] = error
                if not in_part or len(self._absent) == len(self.device.buses):
                    raise
                opened = AbsentBus(bus.channel)
            self._ports.append(BusPort(opened, f"{bus.channel} ({bus.interface})", now_ns))
        buses = range(len(self._ports))
        self._drives_on = [[drive for drive in self.drives if drive.device.can_bus == number] for number in buses]
        self._routers = [Router(drives) for drives in self._drives_on]
        self._sent = [True] * len(self._ports)

    def _release(self) -> None:
        for port in self._ports:
            port.close()
        self._ports = []
        self._state = DriveState.UNCONFIGURED if self._state is DriveState.UNCONFIGURED else DriveState.DISABLED

    def _soft_start(self, now_ns: int) -> float:
        ramp_ns = self.device.soft_start_s * 1e9
        return 1.0 if ramp_ns == 0 else min(max((now_ns - self._enabled_ns) / ramp_ns, 0.0), 1.0)

    def _take(self, number: int, frame: Frame, measured_ns: int) -> None:
        problem = self._routers[number].deliver(frame, measured_ns)
        if problem is not None:
            self._ports[number].report(problem.fault, problem.code, **problem.values)

    def _feedback(self) -> JointFeedback:
        bus, detail = self._bus_faults()
        faults = tuple(self._drive_fault(drive) for drive in self.drives)
        healthy = bus is BusFault.NONE and all(fault is DriveFault.NONE for fault in faults)
        if self._state is DriveState.ENABLED and not healthy and (any(faults) or bus & _ENDING):
            self._state = DriveState.FAULTED
        drives = self.drives
        reported = np.array([(s.position_rad, s.velocity_rad_s, s.torque_nm, s.temperature_c) for s in drives])
        return JointFeedback(
            measured_ns=np.array([drive.measured_ns for drive in drives], dtype=np.int64),
            position_rad=reported[:, 0],
            velocity_rad_s=reported[:, 1],
            torque_nm=reported[:, 2],
            temperature_c=reported[:, 3],
            faults=(faults[0], faults[1], faults[2], faults[3]),
            state=self._state,
            bus=bus,
            detail=detail if healthy else detail or _first_fault(drives, faults),
            unasked=self._unasked,
        )

    def _bus_faults(self) -> tuple[BusFault, HardwareError | None]:
        faults: BusFault = BusFault.NONE
        detail = None
        for port in self._ports:
            fault, newest = port.take_faults()
            if fault is not BusFault.NONE:
                faults, detail = faults | fault, newest
        return faults, detail

    def _drive_fault(self, drive: Drive) -> DriveFault:
        """With power, also a fault that has gone by itself: until it is enabled anew its drive may give no torque."""
        if self._state not in _POWERED:
            return drive.faults
        if drive.enabled is False and drive.latched is DriveFault.NONE:
            drive.latched = DriveFault.UNEXPECTEDLY_DISABLED
        return drive.latched


def _rows(command: JointCommand) -> list[SetPoint] | None:
    """The command drive by drive, or None when it is not four finite rows."""
    rows = [SetPoint(*row) for row in command.rows()]
    return rows if len(rows) == 4 and math.isfinite(sum(map(sum, rows))) else None


def _first_fault(drives: tuple[Drive, ...], faults: tuple[DriveFault, ...]) -> HardwareError | None:
    for drive, fault in zip(drives, faults, strict=True):
        if fault:
            return HardwareError(DrivesFault.FAULT_REPORTED, **drive.identity, faults=tuple(fault))
    return None
