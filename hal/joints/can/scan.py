"""Who is on the bus: by listening only, or by questions that move nothing (but disable what is enabled)."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Container, Iterable
from enum import Enum, auto
from pathlib import Path
from typing import NamedTuple

import can

from hal.errors import CanFault, HardwareError
from hal.joints.can.bus import open_bus
from hal.joints.can.candump import BusDecoder, Decoded, FrameKind
from hal.joints.can.drive import drives_of
from hal.joints.can.port import RECEIVE_ERRORS, BusPort, frame_of, message_of
from hal.joints.codecs import cybergear, damiao
from hal.joints.codecs.cubemars import AkV3Codec, upload_replier
from hal.joints.codecs.cybergear import CyberGearCodec
from hal.joints.codecs.damiao import DamiaoCodec
from hal.joints.codecs.mit import MitCodec, special_frame
from hal.joints.codecs.wire import Codec, Frame, Order
from hal.joints.device import Exoskeleton
from hal.joints.protocol import BusFault, Joint

LISTEN_S = 0.3
ROUND_S = 0.02
_ROUND_IDS = 8
ALL_IDS = range(128)
ASK_S = 0.02  # between two questions of a monitor that asks


class ScanReply(Enum):
    """How a drive answered a scan."""

    ANSWERS_ON = auto()
    SERIAL_NUMBER = auto()
    REPLIES_OF_SIZE = auto()
    UPLOADS_ON = auto()


Recognised = tuple[int, ScanReply, dict[str, object]]  # drive ID, and how it answered


class FoundDrive(NamedTuple):
    """One drive; more than one answer to a question means that several share the ID."""

    protocol: str
    drive_id: int
    answers: int
    code: ScanReply
    values: dict[str, object]


class BusTraffic(NamedTuple):
    """What was received without asking."""

    frames: int
    errors: int
    uploads: dict[int, int]  # drive ID → frames

    @property
    def busy(self) -> bool:
        """Whether others than uploading drives send: probing would interfere."""
        return self.frames > sum(self.uploads.values())

    def check_still(self, bus: str) -> None:
        """Raises HardwareError when others send on this bus."""
        if self.busy:
            raise HardwareError(CanFault.BUS_IN_USE, bus=bus, frames=self.frames)

    def check_free(self, bus: str) -> None:
        """Raises HardwareError when anybody sends on this bus, also drives that upload."""
        if self.frames:
            raise HardwareError(CanFault.BUS_NOT_FREE, bus=bus, frames=self.frames)


def listen(bus: can.BusABC, seconds: float = LISTEN_S) -> BusTraffic:
    """The traffic without any question."""
    frames = errors = 0
    uploads: Counter[int] = Counter()
    for message in _received(bus, seconds):
        if message.is_error_frame:
            errors += 1
            continue
        frames += 1
        drive = upload_replier(frame_of(message))
        if drive is not None:
            uploads[drive] += 1
    return BusTraffic(frames, errors, dict(uploads))


def scan(
    bus: can.BusABC,
    ids: Iterable[int] = ALL_IDS,
    *,
    uploads: Container[int] = (),
    watch: Callable[[str, int], None] = lambda *_: None,
    round_s: float = ROUND_S,
) -> list[FoundDrive]:
    """Ask every ID in every protocol, a few at a time, with `round_s` for their answers.

    Only on a bus that is otherwise still: drives are commanded to disable. uploads: drives that send by themselves, so
    that the number of their answers says nothing. watch: called with protocol and first ID.
    """
    wanted = list(ids)
    found: dict[tuple[str, int], FoundDrive] = {}
    taken: set[int] = set()
    for codec, question, recognise in QUESTIONS:
        protocol = codec.traits.scan_name
        for begin in range(0, len(wanted), _ROUND_IDS):
            batch = [number for number in wanted[begin : begin + _ROUND_IDS] if number not in taken]
            watch(protocol, batch[0] if batch else wanted[begin])
            for drive in _ask(bus, batch, question, recognise, round_s):
                uploading = drive.code is ScanReply.UPLOADS_ON and drive.drive_id in uploads
                answers = 1 if uploading else drive.answers
                found[protocol, drive.drive_id] = drive._replace(protocol=protocol, answers=answers)
        taken |= {drive_id for name, drive_id in found if name == protocol}
    return list(found.values())


def _ask(
    bus: can.BusABC,
    batch: list[int],
    question: Callable[[int], Frame],
    recognise: Callable[[Frame], Recognised | None],
    round_s: float,
) -> list[FoundDrive]:
    questions = {number: question(number) for number in batch}
    for frame in questions.values():
        _send(bus, frame)
    answers: Counter[int] = Counter()
    details: dict[int, Recognised] = {}
    echoes = {frame.data for frame in questions.values()}
    for message in _received(bus, round_s if batch else 0.0):
        frame = frame_of(message)
        recognised = None if message.is_error_frame or frame.data in echoes else recognise(frame)
        if recognised is not None and recognised[0] in questions:
            answers[recognised[0]] += 1
            details[recognised[0]] = recognised
    return [FoundDrive("", drive, count, *details[drive][1:]) for drive, count in answers.items()]


def _send(bus: can.BusABC, frame: Frame) -> None:
    try:
        bus.send(message_of(frame), 0.1)
    except (can.CanError, OSError) as error:
        raise HardwareError(CanFault.SEND_FAILED, bus=bus.channel_info, detail=str(error)) from error


def _received(bus: can.BusABC, seconds: float) -> Iterable[can.Message]:
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        try:
            message = bus.recv(left_s)
        except RECEIVE_ERRORS as error:
            raise HardwareError(CanFault.RECEIVE_FAILED, bus=bus.channel_info, detail=str(error)) from error
        if message is not None:
            yield message


def _damiao(frame: Frame) -> Recognised | None:
    value = damiao.register_reply(frame)
    if value is None or value.register != damiao.Register.DRIVE_ID:
        return None
    return value.drive_id, ScanReply.ANSWERS_ON, {"identifier": f"{frame.arbitration_id:03X}"}


def _cybergear(frame: Frame) -> Recognised | None:
    kind, field, _ = cybergear.unpack_identifier(frame.arbitration_id)
    if not frame.extended or kind != cybergear.Kind.WHO:
        return None
    return field & 0xFF, ScanReply.SERIAL_NUMBER, {"number": frame.data.hex()}


def _mit(frame: Frame) -> Recognised | None:
    if frame.extended or len(frame.data) not in (6, 7, 8):
        return None
    values = {"size": len(frame.data), "identifier": f"{frame.arbitration_id:03X}"}
    return frame.data[0], ScanReply.REPLIES_OF_SIZE, values


def _v3(frame: Frame) -> Recognised | None:
    drive = upload_replier(frame)
    return None if drive is None else (drive, ScanReply.UPLOADS_ON, {"identifier": f"{frame.arbitration_id:X}"})


# In this order: a Damiao drive answers the MIT question too, and then is already known.
QUESTIONS: tuple[tuple[type[Codec], Callable[[int], Frame], Callable[[Frame], Recognised | None]], ...] = (
    (DamiaoCodec, lambda number: damiao.read_register(number, damiao.Register.DRIVE_ID), _damiao),
    (MitCodec, lambda number: special_frame(number, Order.DISABLE), _mit),
    (CyberGearCodec, cybergear.who, _cybergear),
    (AkV3Codec, lambda number: Frame((1 << 8) | number, bytes(4), extended=True), _v3),
)


class BusMonitor:
    """Keeps each drive's newest frames by kind; sends nothing, unless it is to `ask`, which disables enabled drives."""

    def __init__(self, device: Exoskeleton, motors: Path | None = None, *, ask: bool = False) -> None:
        self.drives = drives_of(device, motors)
        drives_on = [
            [drive for drive in self.drives if drive.device.can_bus == number] for number in range(len(device.buses))
        ]
        self._decoders = [BusDecoder(drives) for drives in drives_on]
        self._questions = [
            [frame for drive in drives for frame in drive.codec.order(drive.device.can_id, Order.DISABLE)]
            for drives in (drives_on if ask else [])
        ]
        self._asked_s = 0.0
        self._ports = [BusPort(open_bus(bus), bus.channel, time.monotonic_ns()) for bus in device.buses]
        self.newest: dict[tuple[Joint | None, FrameKind], Decoded] = {}
        self.counts: Counter[tuple[Joint | None, FrameKind]] = Counter()
        self.bus = BusFault.NONE
        self.detail: HardwareError | None = None

    def poll(self, wait_s: float) -> None:
        """Take in what comes within this time."""
        end_s = time.monotonic() + wait_s
        while time.monotonic() < end_s:
            self._ask()
            for port, decoder in zip(self._ports, self._decoders, strict=True):
                message = port.receive_message(min(0.02, wait_s))
                for _ in range(1000):
                    if message is None:
                        break
                    self._note(decoder.decode(message))
                    message = port.receive_message(0.0)
                fault, detail = port.take_faults()
                if fault is not BusFault.NONE:
                    self.bus, self.detail = self.bus | fault, detail

    def close(self) -> None:
        """Release the buses."""
        for port in self._ports:
            port.close()

    def _ask(self) -> None:
        if time.monotonic() - self._asked_s < ASK_S:
            return
        self._asked_s = time.monotonic()
        for port, questions in zip(self._ports, self._questions, strict=False):  # no questions: only listening
            port.send(*questions)

    def _note(self, decoded: Decoded) -> None:
        self.newest[decoded.joint, decoded.kind] = decoded
        self.counts[decoded.joint, decoded.kind] += 1
