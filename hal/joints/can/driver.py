"""The four drives on CAN, through python-can: any of its interfaces, `socketcan` on a robot.

In a tick nothing waits and nothing raises; what goes wrong is told by `read`. Opening, enabling and closing wait for
the drives' answers. After a fault the drives are never enabled again by themselves: close, open, enable.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hal.errors import HardwareError
from hal.joints.can import lifecycle
from hal.joints.can.bus import LOAD_LIMIT, BusPort, bus_load, frame_bits, open_bus
from hal.joints.can.drive import Routes, Station
from hal.joints.codecs import damiao
from hal.joints.codecs.wire import NEUTRAL, Frame, SetPoint
from hal.joints.device import Exoskeleton
from hal.joints.motors import load_motors
from hal.joints.protocol import BusFault, DriveFault, DriveState, Joint, JointCommand, JointFeedback

_ENDING = BusFault.BUS_OFF | BusFault.INTERFACE_GONE  # of the bus; with these the drives are out of reach
_POWERED = (DriveState.ENABLED, DriveState.FAULTED)
LOOK_NS = 20_000_000  # how often drives without power are asked where they are: a screen needs no more


class SocketCanJoints:
    """The Joints Protocol on one or more CAN buses."""

    def __init__(
        self,
        device: Exoskeleton,
        *,
        motors: Path | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Raises HardwareError when the motor table or the bus can't carry this device."""
        table = load_motors(motors)
        self.device = device
        self._clock = clock
        self.stations = tuple(
            Station(joint, device.joints[joint], table.find(device.joints[joint].motor)) for joint in Joint
        )
        for station in self.stations:
            _check_bus(station, device)
            lifecycle.check_wire_range(station)
        self.loads = _loads(device, self.stations)
        self._state = DriveState.UNCONFIGURED
        self._ports: list[BusPort] = []
        self._routes: list[Routes] = []
        self._enabled_ns = 0
        self._looked_ns = 0
        self.questions: dict[Joint, lifecycle.Ask] = {}  # what each drive answers without power
        self.notes: tuple[str, ...] = ()

    @property
    def state(self) -> DriveState:
        """Where in its life cycle the driver is."""
        return self._state

    def open(self, now_ns: int) -> None:
        """Probe: who answers, and with which ranges where the drive can tell.

        Raises HardwareError naming the bus or the joint.
        """
        if self._ports:
            raise HardwareError("The joints are open already: close them first.")
        try:
            self._ports = [
                BusPort(open_bus(bus), f"{bus.channel} ({bus.interface})", now_ns, clock=self._clock)
                for bus in self.device.buses
            ]
            self._routes = [Routes(self._on_bus(number)) for number in range(len(self._ports))]
            self.notes = lifecycle.probe(self)
        except HardwareError:
            self._release()
            raise
        self._state = DriveState.PROBED

    def enable(self, now_ns: int) -> None:
        """Neutral command, enable, neutral again, confirmed by feedback; the gains then ramp by themselves.

        Raises HardwareError, with every drive told to disable, when one does not confirm.
        """
        if self._state is not DriveState.PROBED:
            raise HardwareError(
                f"The drives can't be enabled while {self._state.value}: close the joints, find the cause, "
                f"open them again."
            )
        lifecycle.enable(self)
        self._state = DriveState.ENABLED
        self._enabled_ns = max(now_ns, self._clock())

    def write(self, command: JointCommand, now_ns: int) -> None:
        """Send one set-point a drive, at once; drives that are not enabled are only asked where they are."""
        if self._state is DriveState.PROBED and now_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns = now_ns
            lifecycle.look(self)
        if self._state not in _POWERED:
            return
        rows = _rows(command)
        if rows is None:
            rows = [SetPoint(0.0, 0.0, 0.0, station.device.damp_nm_s_rad, 0.0) for station in self.stations]
            self._ports[0].report(BusFault.SEND_FAILED, "a command that is no number became damping")
        rising = self._soft_start(now_ns)
        leaving: list[list[Frame]] = [[] for _ in self._ports]
        for station, row in zip(self.stations, rows, strict=True):
            if rising < 1.0:
                stiffness, torque = row.stiffness_nm_rad * rising, row.torque_nm * rising
                row = row._replace(stiffness_nm_rad=stiffness, torque_nm=torque)  # noqa: PLW2901
            leaving[station.device.can_bus].append(station.command(row, now_ns))
        for port, frames in zip(self._ports, leaving, strict=True):
            port.send(*frames)

    def read(self, now_ns: int) -> JointFeedback:
        """Take in what has arrived. Faults of bus and drives come with the feedback, never as an exception."""
        for number, port in enumerate(self._ports):
            for frame, measured_ns in port.drain(now_ns):
                self._take(number, frame, measured_ns)
        for station in self.stations:
            station.ledger.look(now_ns)
        return self._feedback()

    def close(self, now_ns: int) -> None:  # noqa: ARG002 (the Protocol's; confirming takes real time)
        """Damp, disable, confirm, release.

        Raises HardwareError, after releasing, when a drive that was enabled did not confirm that it is off.
        """
        if not self._ports:
            return
        try:
            unconfirmed = lifecycle.disable(self) if self._state in _POWERED else []
        finally:
            self._release()
        if unconfirmed:
            names = ", ".join(station.name for station in unconfirmed)
            raise HardwareError(f"No confirmation that {names} is off: cut the motor power by hand.")

    def send(self, station: Station, frames: list[Frame]) -> None:
        """Frames to a station's bus (for the life cycle)."""
        self._ports[station.device.can_bus].send(*frames)

    def listen(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Take in frames until `done`, at most for `timeout_s` (for the life cycle, never in a tick)."""
        deadline_ns = self._clock() + int(timeout_s * 1e9)
        share_s = 0.002 if len(self._ports) > 1 else 0.01
        while not done():
            late = self._clock() >= deadline_ns
            for number, port in enumerate(self._ports):
                wait_s = 0.0 if late else share_s
                while (frames := port.wait_for_arrivals(wait_s)) is not None:
                    for frame, measured_ns in frames:
                        self._take(number, frame, measured_ns)
                    wait_s = 0.0
            if late:  # what had come by then counts, also where the host was too busy to look
                return done()
        return True

    def registers(self, station: Station, wanted: tuple[int, ...]) -> dict[int, float]:
        """What a Damiao drive tells of its registers; those it does not tell are missing (for the life cycle)."""
        told: dict[int, float] = {}
        routes = self._routes[station.device.can_bus]
        routes.await_registers(station, told)
        for register in wanted:
            question = damiao.read_register(station.device.can_id, register)
            self.send(station, [station.ask(question, self._clock())])
            self.listen(lambda register=register: register in told, 0.05)  # type: ignore[misc]
            if not told:
                break
        routes.await_registers(station, None)
        return told

    def bus_sentence(self) -> str:
        """What the buses have to say for a refusal, or nothing."""
        return "; ".join(text for port in self._ports for text in (port.take_faults()[1],) if text)

    def now_ns(self) -> int:
        """The driver's clock (for the life cycle)."""
        return self._clock()

    def _on_bus(self, number: int) -> list[Station]:
        return [station for station in self.stations if station.device.can_bus == number]

    def _release(self) -> None:
        for port in self._ports:
            port.close()
        self._ports = []
        self._state = DriveState.UNCONFIGURED if self._state is DriveState.UNCONFIGURED else DriveState.DISABLED

    def _soft_start(self, now_ns: int) -> float:
        ramp_ns = self.device.soft_start_s * 1e9
        return 1.0 if ramp_ns == 0 else min(max((now_ns - self._enabled_ns) / ramp_ns, 0.0), 1.0)

    def _take(self, number: int, frame: Frame, measured_ns: int) -> None:
        fault, text = self._routes[number].deliver(frame, measured_ns)
        if fault is not BusFault.NONE:
            self._ports[number].report(fault, text)

    def _feedback(self) -> JointFeedback:
        bus, detail = self._bus_faults()
        faults = tuple(self._drive_fault(station) for station in self.stations)
        healthy = bus is BusFault.NONE and all(fault is DriveFault.NONE for fault in faults)
        if self._state is DriveState.ENABLED and not healthy and (any(faults) or bus & _ENDING):
            self._state = DriveState.FAULTED
        stations = self.stations
        told = np.array([(s.position_rad, s.velocity_rad_s, s.torque_nm, s.temperature_c) for s in stations])
        return JointFeedback(
            measured_ns=np.array([station.measured_ns for station in stations], dtype=np.int64),
            position_rad=told[:, 0],
            velocity_rad_s=told[:, 1],
            torque_nm=told[:, 2],
            temperature_c=told[:, 3],
            faults=(faults[0], faults[1], faults[2], faults[3]),
            state=self._state,
            bus=bus,
            detail=detail if healthy else detail or _sentence(stations, faults),
            missed_replies=sum(station.ledger.overdue for station in stations),
        )

    def _bus_faults(self) -> tuple[BusFault, str]:
        faults, detail = BusFault.NONE, ""
        for port in self._ports:
            fault, text = port.take_faults()
            if fault is not BusFault.NONE:
                faults, detail = faults | fault, text
        return faults, detail

    def _drive_fault(self, station: Station) -> DriveFault:
        if station.enabled is False and station.faults is DriveFault.NONE and self._state in _POWERED:
            return DriveFault.UNEXPECTEDLY_DISABLED
        return station.faults


def _rows(command: JointCommand) -> list[SetPoint] | None:
    """The command drive by drive, or None when it is not four finite rows."""
    columns = (
        command.position_rad.tolist(),
        command.velocity_rad_s.tolist(),
        command.stiffness_nm_rad.tolist(),
        command.damping_nm_s_rad.tolist(),
        command.torque_nm.tolist(),
    )
    rows = [SetPoint(*row) for row in zip(*columns, strict=False)]
    return rows if len(rows) == 4 and math.isfinite(sum(map(sum, rows))) else None


def _sentence(stations: tuple[Station, ...], faults: tuple[DriveFault, ...]) -> str:
    for station, fault in zip(stations, faults, strict=True):
        if fault:
            return f"{station.name} reports {(fault.name or str(fault)).lower().replace('_', ' ')}"
    return ""


def _check_bus(station: Station, device: Exoskeleton) -> None:
    if not 0 <= station.device.can_bus < len(device.buses):
        raise HardwareError(
            f"The {station.name} sits on bus {station.device.can_bus}, but {device.name} has "
            f"{len(device.buses)} bus(es): correct can_bus or add a [[buses]] entry."
        )


def _loads(device: Exoskeleton, stations: tuple[Station, ...]) -> tuple[float, ...]:
    """Each bus's load. Raises HardwareError above the limit."""
    loads = []
    for number, bus in enumerate(device.buses):
        on_bus = [station for station in stations if station.device.can_bus == number]
        bits = [
            frame_bits(8, extended=station.codec.command(station.device.can_id, NEUTRAL).extended) * 2
            for station in on_bus
        ]
        load = bus_load(bits, bitrate=bus.bitrate)
        if load > LOAD_LIMIT:
            raise HardwareError(
                f"The bus {bus.channel} would be {load:.0%} full with {len(on_bus)} drives at 500 Hz and "
                f"{bus.bitrate} bit/s (limit {LOAD_LIMIT:.0%}): raise the bit rate or use a second bus."
            )
        loads.append(load)
    return tuple(loads)
