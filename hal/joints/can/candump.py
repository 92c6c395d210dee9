"""candump logs: recorded from the buses by a socket of their own, read back (also cut in half) and decoded."""

from __future__ import annotations

import gzip
import os
import re
import socket
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from enum import Enum
from functools import partial
from pathlib import Path
from typing import IO, NamedTuple, TextIO, cast

import can

from hal.errors import CanFault, HardwareError
from hal.joints.can.bus import frame_of, meaning_of, open_bus
from hal.joints.can.drive import Drive
from hal.joints.codecs.wire import Order, Reply, SetPoint
from hal.joints.device import Exoskeleton
from hal.joints.protocol import DriveFault, Joint
from logs.reading.errors import cause_of
from logs.reading.regular import open_regular

# (1731.000001) can0 001#7FFF7FF0000007FF, candump -L; candump -l adds R or T in newer versions
_WHOLE_LINE = re.compile(
    r"^\(\d+\.\d+\) \S+ (?:[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:(?:[0-9A-Fa-f]{2}){0,8}|R\d?)(?: [RT])?\s*$"
)


_LONGEST_LINE = 4096  # characters; a frame has some sixty, a packed file of zeros none


class FrameKind(Enum):
    """What a frame is."""

    COMMAND = "command"
    ORDER = "order"
    REPLY = "reply"
    ERROR = "error"
    UNKNOWN = "unknown"


class Decoded(NamedTuple):
    """One frame of a log. joint: None where it belongs to no drive described. content: numbers at the joint."""

    at_s: float
    joint: Joint | None
    kind: FrameKind
    content: SetPoint | Order | Reply | CanFault | str  # by kind; str: identifier and data of an unknown frame


class WholeLines:
    """A log's lines that are whole; counts the others. Replaces the file that python-can's reader reads."""

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self.broken = 0
        self.closed = False

    def __iter__(self) -> Iterator[str]:
        try:
            for line in iter(partial(self._file.readline, _LONGEST_LINE), ""):
                if _WHOLE_LINE.match(line) and line.endswith("\n"):
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
        if path.suffix == ".gz":
            return gzip.open(path, "rt", encoding="ascii", errors="replace")
        return path.open(encoding="ascii", errors="replace")
    except OSError as error:
        raise HardwareError(CanFault.LOG_UNREADABLE, path=path, detail=cause_of(error)) from error


def decode_frame(message: can.Message, drives: tuple[Drive, ...]) -> Decoded:
    """What a frame means, as a command to or a reply from one of these drives, and for which joint."""
    if message.is_error_frame:
        return Decoded(message.timestamp, None, FrameKind.ERROR, meaning_of(message).code)
    frame = frame_of(message)
    for drive in drives:
        asked = drive.codec.read_command(drive.device.can_id, frame)
        if isinstance(asked, Order):
            return Decoded(message.timestamp, drive.joint, FrameKind.ORDER, asked)
        if asked is not None:
            target = drive.transmission.to_joint(asked)
            return Decoded(message.timestamp, drive.joint, FrameKind.COMMAND, target)
    for drive in drives:
        reply = drive.codec.read_reply(frame) if drive.codec.replier(frame) == drive.reply_number else None
        if reply is not None:
            return Decoded(message.timestamp, drive.joint, FrameKind.REPLY, _at_joint(drive, reply))
    digits = f"{frame.arbitration_id:08X}" if frame.extended else f"{frame.arbitration_id:03X}"
    return Decoded(message.timestamp, None, FrameKind.UNKNOWN, f"{digits}#{frame.data.hex().upper()}")


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
        yield from can.CanutilsLogReader(cast(TextIO, lines))
    finally:
        summary.broken_lines = lines.broken


FLUSH_S = 0.5
_BUFFER_BYTES = 8 << 20  # a second of a full bus, for a recorder that waits for the scheduler or its disk
_SO_RCVBUFFORCE = 33  # linux/socket.h; beyond the system's limit, for the privileged
_BATCH = 256
_PAUSE_S = 0.02  # frames are fetched by the batch: waking for each would cost perception a core


class BusRecorder:
    """Writes candump's `-L` format through python-can's own writer: can-utils read it, `rleex can decode` too."""

    def __init__(self, device: Exoskeleton, path: Path) -> None:
        """Raises HardwareError when the file or a bus can't be opened."""
        self.frames = 0
        self._flushed_s = 0.0
        try:
            self._file = path.open("a", encoding="ascii", buffering=1 << 20)
        except OSError as error:
            raise HardwareError(CanFault.LOG_UNWRITABLE, path=path, detail=str(error)) from error
        self._buses: list[can.BusABC] = []
        try:
            self._buses = [open_bus(bus) for bus in device.buses]
        except HardwareError:
            self._file.close()
            raise
        for bus in self._buses:
            _widen(bus)
        self._writers = [can.CanutilsLogWriter(self._file, channel=_file_channel(bus.channel)) for bus in device.buses]

    def run(self, stopped: Callable[[], bool]) -> None:
        """Record until stopped."""
        while not stopped():
            time.sleep(_PAUSE_S)
            for bus, writer in zip(self._buses, self._writers, strict=True):
                self._take(bus, writer)
            if time.monotonic() - self._flushed_s >= FLUSH_S:
                self._file.flush()
                self._flushed_s = time.monotonic()

    def close(self) -> None:
        """Write what is left, release file and buses."""
        for bus in self._buses:
            bus.shutdown()
        self._file.close()

    def _take(self, bus: can.BusABC, writer: can.CanutilsLogWriter) -> None:
        for _ in range(_BATCH):
            try:
                message = bus.recv(0)
            except (can.CanError, OSError, ValueError, TypeError):
                return  # an interface that is gone may come back; control reports it meanwhile
            if message is None:
                return
            message.channel = None  # the writer's own name: can-utils can't read a multicast address
            writer.on_message_received(message)
            self.frames += 1


def _file_channel(channel: str) -> str:
    """A channel's name without what can-utils can't read in one."""
    return "".join(letter if letter.isalnum() else "_" for letter in channel)[:15] or "can"


def _widen(bus: can.BusABC) -> None:
    try:
        number = bus.fileno()
    except NotImplementedError:  # a bus without a socket has a queue without an end
        return
    if number < 0:
        return
    with socket.socket(fileno=os.dup(number)) as same:
        try:
            same.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER_BYTES)
        except OSError:
            same.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
