"""Who is on the bus: by listening only, or by questions that move nothing (but disable what is enabled)."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import can

from hal.errors import HardwareError
from hal.joints.can.bus import BusPort, frame_of, message_of, open_bus
from hal.joints.can.candump import Decoded, Decoder
from hal.joints.can.drive import Station
from hal.joints.codecs import cybergear, damiao
from hal.joints.codecs.cubemars import upload_replier
from hal.joints.codecs.mit import special_frame
from hal.joints.codecs.wire import Frame, Order
from hal.joints.device import Exoskeleton
from hal.joints.motors import load_motors
from hal.joints.protocol import BusFault, Joint

LISTEN_S = 0.3
ROUND_S = 0.02
_ROUND_IDS = 8
ALL_IDS = range(1, 128)


class Found(NamedTuple):
    """One drive; more than one answer a question means that several share the ID."""

    protocol: str
    drive_id: int
    answers: int
    detail: str


class Traffic(NamedTuple):
    """What was heard without asking."""

    frames: int
    errors: int
    uploads: dict[int, int]  # drive ID → frames

    @property
    def busy(self) -> bool:
        """Somebody talks who is no drive uploading by itself: probing would interfere."""
        return self.frames > sum(self.uploads.values())


def listen(bus: can.BusABC, seconds: float = LISTEN_S) -> Traffic:
    """What goes on while nobody asks."""
    frames = errors = 0
    uploads: Counter[int] = Counter()
    for message in _heard(bus, seconds):
        if message.is_error_frame:
            errors += 1
            continue
        frames += 1
        drive = upload_replier(frame_of(message))
        if drive is not None:
            uploads[drive] += 1
    return Traffic(frames, errors, dict(uploads))


def scan(
    bus: can.BusABC,
    ids: Iterable[int] = ALL_IDS,
    *,
    watch: Callable[[str], None] = lambda _: None,
    round_s: float = ROUND_S,
) -> list[Found]:
    """Ask every ID in every protocol, a few at a time, with `round_s` for their answers.

    Only on a bus that is otherwise still: drives are told to disable.
    """
    wanted = list(ids)
    found: dict[tuple[str, int], Found] = {}
    taken: set[int] = set()
    for protocol, question, recognise in _QUESTIONS:
        for begin in range(0, len(wanted), _ROUND_IDS):
            batch = [number for number in wanted[begin : begin + _ROUND_IDS] if number not in taken]
            watch(f"{protocol}, ID {batch[0] if batch else wanted[begin]} …")
            for drive in _ask(bus, batch, question, recognise, round_s):
                found[protocol, drive.drive_id] = drive._replace(protocol=protocol)
        taken |= {drive_id for name, drive_id in found if name == protocol}
    return list(found.values())


def _ask(
    bus: can.BusABC,
    batch: list[int],
    question: Callable[[int], Frame],
    recognise: Callable[[Frame], tuple[int, str] | None],
    round_s: float,
) -> list[Found]:
    questions = {number: question(number) for number in batch}
    for frame in questions.values():
        _send(bus, frame)
    answers: Counter[int] = Counter()
    details: dict[int, str] = {}
    echoes = {frame.data for frame in questions.values()}
    for message in _heard(bus, round_s if batch else 0.0):
        frame = frame_of(message)
        told = None if message.is_error_frame or frame.data in echoes else recognise(frame)
        if told is not None and told[0] in questions:
            answers[told[0]] += 1
            details[told[0]] = told[1]
    return [Found("", drive, count, details[drive]) for drive, count in answers.items()]


def _send(bus: can.BusABC, frame: Frame) -> None:
    try:
        bus.send(message_of(frame), 0.1)
    except (can.CanError, OSError) as error:
        raise HardwareError(f"Asking on the bus failed ({error}): run `rleex can doctor`.") from error


def _heard(bus: can.BusABC, seconds: float) -> Iterable[can.Message]:
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        try:
            message = bus.recv(left_s)
        except (can.CanError, OSError) as error:
            raise HardwareError(f"Listening to the bus failed ({error}): run `rleex can doctor`.") from error
        if message is not None:
            yield message


def _damiao(frame: Frame) -> tuple[int, str] | None:
    value = damiao.register_reply(frame)
    if value is None or value.register != damiao.Register.DRIVE_ID:
        return None
    return value.drive_id, f"answers on {frame.arbitration_id:03X}"


def _cybergear(frame: Frame) -> tuple[int, str] | None:
    kind, field, _ = cybergear.unpack_identifier(frame.arbitration_id)
    if not frame.extended or kind != cybergear.Kind.WHO:
        return None
    return field & 0xFF, f"number {frame.data.hex()}"


def _mit(frame: Frame) -> tuple[int, str] | None:
    if frame.extended or len(frame.data) not in (6, 7, 8):
        return None
    return frame.data[0], f"replies of {len(frame.data)} bytes on {frame.arbitration_id:03X}"


def _v3(frame: Frame) -> tuple[int, str] | None:
    drive = upload_replier(frame)
    return None if drive is None else (drive, f"uploads on {frame.arbitration_id:X}")


# In this order: a Damiao drive answers the MIT question too, and then is already known.
_QUESTIONS: tuple[tuple[str, Callable[[int], Frame], Callable[[Frame], tuple[int, str] | None]], ...] = (
    ("Damiao", lambda number: damiao.read_register(number, damiao.Register.DRIVE_ID), _damiao),
    ("MIT (AK V1/V2, bgkatz)", lambda number: special_frame(number, Order.DISABLE), _mit),
    ("CyberGear", cybergear.who, _cybergear),
    ("AK V3 / servo", lambda number: Frame((1 << 8) | number, bytes(4), extended=True), _v3),
)


class BusMonitor:
    """Keeps each drive's newest words by kind; sends nothing."""

    def __init__(self, device: Exoskeleton, motors: Path | None = None) -> None:
        self.stations = stations_of(device, motors)
        self._decoders = [
            Decoder(tuple(station for station in self.stations if station.device.can_bus == number))
            for number in range(len(device.buses))
        ]
        self._ports = [BusPort(open_bus(bus), bus.channel, time.monotonic_ns()) for bus in device.buses]
        self.newest: dict[tuple[str, str], Decoded] = {}
        self.counts: Counter[tuple[str, str]] = Counter()
        self.bus = BusFault.NONE
        self.detail = ""

    def look(self, wait_s: float) -> None:
        """Take in what comes within this time."""
        end_s = time.monotonic() + wait_s
        while time.monotonic() < end_s:
            for port, decoder in zip(self._ports, self._decoders, strict=True):
                message = port.hear(min(0.02, wait_s))
                for _ in range(1000):
                    if message is None:
                        break
                    self._note(decoder.decode(message))
                    message = port.hear(0.0)
                fault, text = port.take_faults()
                if fault is not BusFault.NONE:
                    self.bus, self.detail = self.bus | fault, text

    def close(self) -> None:
        """Release the buses."""
        for port in self._ports:
            port.close()

    def _note(self, decoded: Decoded) -> None:
        self.newest[decoded.drive, decoded.kind] = decoded
        self.counts[decoded.drive, decoded.kind] += 1


def stations_of(device: Exoskeleton, motors: Path | None = None) -> tuple[Station, ...]:
    """The device's four drives. Raises HardwareError for an unknown motor."""
    table = load_motors(motors)
    return tuple(Station(joint, device.joints[joint], table.find(device.joints[joint].motor)) for joint in Joint)
