"""candump logs: read back (also cut in half) and decoded. What writes them is in recorder.py."""

from __future__ import annotations

import gzip
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from enum import Enum
from functools import partial
from pathlib import Path
from typing import IO, NamedTuple, TextIO, cast

import can

from hal.errors import CanFault, HardwareError
from hal.joints.can.drive import Drive, Router, drives_of
from hal.joints.can.port import frame_of, meaning_of
from hal.joints.codecs import damiao
from hal.joints.codecs.wire import Frame, Order, Reply, SetPoint
from hal.joints.device import Exoskeleton
from hal.joints.motors import WireProtocol
from hal.joints.protocol import DriveFault, Joint
from logs.reading.errors import cause_of
from logs.reading.regular import open_regular

# (1731.000001) can0 001#7FFF7FF0000007FF, candump -L; candump -l adds R or T in newer versions
_WHOLE_LINE = re.compile(
    r"^\(\d+\.\d+\) \S+ ([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:(?:[0-9A-Fa-f]{2}){0,8}|R\d?)(?: [RT])?\s*$"
)
ERROR_FLAG = 0x2000_0000  # linux/can.h: in the identifier of an error frame
_LONGEST_LINE = 4096  # characters; a frame has some sixty, a packed file of zeros none


class FrameKind(Enum):
    """What a frame is."""

    COMMAND = "command"
    ORDER = "order"
    REPLY = "reply"
    REGISTER = "register"  # asked for, written or reported
    ERROR = "error"
    UNKNOWN = "unknown"


class Decoded(NamedTuple):
    """One frame of a log. joint: None where it belongs to no drive described. content: numbers at the joint."""

    at_s: float
    joint: Joint | None
    kind: FrameKind
    content: SetPoint | Order | Reply | CanFault | str  # by kind; str: identifier and data of any other frame


class WholeLines:
    """A log's lines that are whole; counts the others. Replaces the file that python-can's reader reads."""

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self.broken = 0
        self.identifier = 0  # of the newest line, with its flags
        self.closed = False

    def __iter__(self) -> Iterator[str]:
        try:
            for line in iter(partial(self._file.readline, _LONGEST_LINE), ""):
                match = _WHOLE_LINE.match(line)
                if match is not None and line.endswith("\n"):
                    self.identifier = int(match[1], 16)
                    yield line
                elif line.strip():
                    self.broken += 1
        except (EOFError, OSError, zlib.error):  # a compressed log that ends in mid-stream, or is none
            self.broken += 1

    def read(self, _size: int = -1) -> str:
        """For python-can's check that this is a file; it iterates."""
        raise NotImplementedError

    def close(self) -> None:
        """The caller closes the file."""
        self.closed = True


def open_log(path: Path) -> IO[str]:
    """A candump log, also compressed. Raises HardwareError."""
    try:
        with open_regular(path):  # refuses what is no file, before it is opened as text
            pass
        if path.suffix.lower() == ".gz":
            return gzip.open(path, "rt", encoding="ascii", errors="replace")
        return path.open(encoding="ascii", errors="replace")
    except OSError as error:
        raise HardwareError(CanFault.LOG_UNREADABLE, path=path, detail=cause_of(error)) from error


class BusDecoder:
    """What a bus's frames mean, as commands to or replies from its drives, and for which joint."""

    def __init__(self, drives: Iterable[Drive]) -> None:
        self._drives = list(drives)
        self._router = Router(self._drives)
        damiaos = (drive for drive in self._drives if drive.model.protocol is WireProtocol.DAMIAO)
        self._with_registers = {drive.device.can_id: drive for drive in damiaos}

    def decode(self, message: can.Message) -> Decoded:
        """One frame."""
        if message.is_error_frame:
            return Decoded(message.timestamp, None, FrameKind.ERROR, meaning_of(message).code)
        frame = frame_of(message)
        owner = self._register_owner(frame)  # first: its bytes could be those of a status
        if owner is not None:
            return Decoded(message.timestamp, owner.joint, FrameKind.REGISTER, _digits(frame))
        for drive in self._drives:
            asked = drive.codec.read_command(drive.device.can_id, frame)
            if isinstance(asked, Order):
                return Decoded(message.timestamp, drive.joint, FrameKind.ORDER, asked)
            if asked is not None:
                target = drive.transmission.to_joint(asked)
                return Decoded(message.timestamp, drive.joint, FrameKind.COMMAND, target)
        sender = self._router.sender(frame)
        reply = None if sender is None else sender.codec.read_reply(frame)
        if sender is None or reply is None:
            return Decoded(message.timestamp, None, FrameKind.UNKNOWN, _digits(frame))
        return Decoded(message.timestamp, sender.joint, FrameKind.REPLY, _at_joint(sender, reply))

    def _register_owner(self, frame: Frame) -> Drive | None:
        number = damiao.register_owner(frame) if self._with_registers else None
        drive = None if number is None else self._with_registers.get(number)
        on_its_id = drive is not None and frame.arbitration_id in (damiao.REGISTER_ID, drive.device.reply_id)
        return drive if on_its_id else None


class LogDecoder:
    """A log's frames, each for the drives of its channel; for all where the device has one bus."""

    def __init__(self, device: Exoskeleton, motors: Path | None = None) -> None:
        drives = drives_of(device, motors)
        on_channel: dict[str, list[Drive]] = {}
        shared = [file_channel(bus.channel) for bus in device.buses]  # as logs before `file_channels` have them
        for number, channel in enumerate(file_channels(device)):
            on_bus = [drive for drive in drives if drive.device.can_bus == number]
            for name in {channel, shared[number]}:
                on_channel.setdefault(name, []).extend(on_bus)
        self._only = BusDecoder(drives) if len(set(shared)) == 1 else None
        self._on_channel = {channel: BusDecoder(some) for channel, some in on_channel.items()}
        self._nobody = BusDecoder(())

    def decode(self, message: can.Message) -> Decoded:
        """One frame."""
        decoder = self._on_channel.get(file_channel(str(message.channel)), self._only or self._nobody)
        return decoder.decode(message)


def _digits(frame: Frame) -> str:
    identifier = f"{frame.arbitration_id:08X}" if frame.extended else f"{frame.arbitration_id:03X}"
    return f"{identifier}#{frame.data.hex().upper()}"


def _at_joint(drive: Drive, reply: Reply) -> Reply:
    return reply._replace(
        position_rad=drive.transmission.angle_to_joint(reply.position_rad),
        velocity_rad_s=reply.velocity_rad_s / drive.transmission.ratio,
        torque_nm=reply.torque_nm * drive.transmission.ratio,
    )


class LogSummary:
    """What a log held, drive by drive: how many frames of each kind, the longest time without a reply, the faults."""

    def __init__(self) -> None:
        self.counts: Counter[tuple[Joint | None, FrameKind]] = Counter()
        self.longest_gap_s: dict[Joint | None, float] = {}
        self.faults: dict[Joint | None, DriveFault] = {}
        self.broken_lines = 0
        self.first_s = self.last_s = 0.0
        self._last_reply_s: dict[Joint | None, float] = {}

    def add(self, decoded: Decoded) -> None:
        """Count one frame."""
        joint, reply = decoded.joint, decoded.content
        self.counts[joint, decoded.kind] += 1
        self.first_s = self.first_s or decoded.at_s
        self.last_s = decoded.at_s
        if not isinstance(reply, Reply):
            return
        since_s = decoded.at_s - self._last_reply_s.get(joint, decoded.at_s)
        self.longest_gap_s[joint] = max(self.longest_gap_s.get(joint, 0.0), since_s)
        self._last_reply_s[joint] = decoded.at_s
        self.faults[joint] = self.faults.get(joint, DriveFault.NONE) | reply.faults


def messages_of(file: IO[str], summary: LogSummary) -> Iterator[can.Message]:
    """The frames of a candump log by python-can's own reader; broken lines are counted, not fatal."""
    lines = WholeLines(file)
    try:
        for message in can.CanutilsLogReader(cast(TextIO, lines)):
            yield _error_frame(message, lines.identifier) if lines.identifier & ERROR_FLAG else message
    finally:
        summary.broken_lines = lines.broken


def _error_frame(message: can.Message, identifier: int) -> can.Message:
    """The reader takes error frames for data, or loses what they mean."""
    return can.Message(
        timestamp=message.timestamp,
        arbitration_id=identifier & ~ERROR_FLAG,
        is_extended_id=False,
        is_error_frame=True,
        data=message.data,
    )


def file_channel(channel: str) -> str:
    """A channel's name without what can-utils can't read in one; a number as python-can writes it."""
    name = "".join(letter if letter.isalnum() else "_" for letter in channel) or "can"
    return (f"can{name}" if name.isdigit() else name)[:15]


def file_channels(device: Exoskeleton) -> list[str]:
    """Each bus's channel in a log; with the bus's number where two would have one name (gs_usb's by index)."""
    names = [file_channel(bus.channel) for bus in device.buses]
    return [f"{name[:13]}_{number}" if names.count(name) > 1 else name for number, name in enumerate(names)]
