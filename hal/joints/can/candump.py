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
from pathlib import Path
from typing import IO, NamedTuple, TextIO, cast

import can
import numpy as np

from hal.errors import HardwareError
from hal.joints.can.bus import frame_of, meaning_of, open_bus
from hal.joints.can.drive import Station
from hal.joints.codecs.wire import Order, Reply, SetPoint
from hal.joints.device import Exoskeleton
from hal.joints.protocol import DriveFault

# (1731.000001) can0 001#7FFF7FF0000007FF, candump -L; candump -l adds R or T in newer versions
_WHOLE_LINE = re.compile(
    r"^\(\d+\.\d+\) \S+ (?:[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:(?:[0-9A-Fa-f]{2}){0,8}|R\d?)(?: [RT])?\s*$"
)


class Decoded(NamedTuple):
    """One frame of a log; `drive` is empty for nobody's."""

    at_s: float
    drive: str
    kind: str  # command, order, reply, error, stranger
    text: str
    faults: DriveFault = DriveFault.NONE
    at_joint: Reply | SetPoint | None = None  # the numbers of a reply or a command, at the joint


class WholeLines:
    """A log's lines that are whole; counts the others. Stands in for the file that python-can's reader reads."""

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self.broken = 0
        self.closed = False

    def __iter__(self) -> Iterator[str]:
        try:
            for line in self._file:
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
        if path.suffix == ".gz":
            return gzip.open(path, "rt", encoding="ascii", errors="replace")
        return path.open(encoding="ascii", errors="replace")
    except OSError as error:
        raise HardwareError(f"The bus log {path} can't be read: {error.strerror or error}.") from error


class Decoder:
    """Frames in the words of a device's drives."""

    def __init__(self, stations: tuple[Station, ...]) -> None:
        self._stations = stations

    def decode(self, message: can.Message) -> Decoded:
        """What a frame said, and to whom."""
        if message.is_error_frame:
            return Decoded(message.timestamp, "", "error", meaning_of(message).text)
        frame = frame_of(message)
        for station in self._stations:
            asked = station.codec.read_command(station.device.can_id, frame)
            if isinstance(asked, Order):
                return Decoded(message.timestamp, station.short_name, "order", asked.value)
            if asked is not None:
                target = station.transmission.to_joint(asked)
                return Decoded(message.timestamp, station.short_name, "command", _told(target), at_joint=target)
        for station in self._stations:
            reply = station.codec.read_reply(frame) if station.codec.replier(frame) == station.told_as else None
            if reply is not None:
                said = _at_joint(station, reply)
                return Decoded(message.timestamp, station.short_name, "reply", _said(said), said.faults, said)
        digits = f"{frame.arbitration_id:08X}" if frame.extended else f"{frame.arbitration_id:03X}"
        return Decoded(message.timestamp, "", "stranger", f"{digits}#{frame.data.hex().upper()}")


def _told(target: SetPoint) -> str:
    return (
        f"{np.degrees(target.position_rad):8.2f}° {np.degrees(target.velocity_rad_s):8.1f}°/s "
        f"kp {target.stiffness_nm_rad:6.1f} kd {target.damping_nm_s_rad:5.2f} {target.torque_nm:7.2f} Nm"
    )


def _at_joint(station: Station, reply: Reply) -> Reply:
    return reply._replace(
        position_rad=station.transmission.angle_to_joint(reply.position_rad),
        velocity_rad_s=reply.velocity_rad_s / station.transmission.ratio,
        torque_nm=reply.torque_nm * station.transmission.ratio,
    )


def _said(reply: Reply) -> str:
    fault = f"  {(reply.faults.name or str(reply.faults)).lower().replace('_', ' ')}" if reply.faults else ""
    warmth = "" if np.isnan(reply.temperature_c) else f" {reply.temperature_c:.0f} °C"
    return (
        f"{np.degrees(reply.position_rad):8.2f}° {np.degrees(reply.velocity_rad_s):8.1f}°/s "
        f"{reply.torque_nm:7.2f} Nm{warmth}{fault}"
    )


class LogSummary:
    """What a log held, drive by drive: how many frames of each kind, the longest silence, the faults."""

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, str]] = Counter()
        self.longest_gap_s: dict[str, float] = {}
        self.faults: dict[str, DriveFault] = {}
        self.broken_lines = 0
        self.first_s = self.last_s = 0.0
        self._last_reply_s: dict[str, float] = {}

    def add(self, decoded: Decoded) -> None:
        """Count one frame."""
        self.counts[decoded.drive, decoded.kind] += 1
        self.first_s = self.first_s or decoded.at_s
        self.last_s = decoded.at_s
        if decoded.kind != "reply":
            return
        since_s = decoded.at_s - self._last_reply_s.get(decoded.drive, decoded.at_s)
        self.longest_gap_s[decoded.drive] = max(self.longest_gap_s.get(decoded.drive, 0.0), since_s)
        self._last_reply_s[decoded.drive] = decoded.at_s
        self.faults[decoded.drive] = self.faults.get(decoded.drive, DriveFault.NONE) | decoded.faults


def messages_of(file: IO[str], summary: LogSummary) -> Iterator[can.Message]:
    """The frames of a candump log by python-can's own reader; broken lines are counted, not fatal."""
    lines = WholeLines(file)
    try:
        yield from can.CanutilsLogReader(cast(TextIO, lines))
    finally:
        summary.broken_lines = lines.broken


FLUSH_S = 0.5
_BUFFER_BYTES = 8 << 20  # a second of a full bus, for a recorder that has to wait for its turn or its disk
_SO_RCVBUFFORCE = 33  # linux/socket.h; beyond the system's limit, for the privileged
_BATCH = 256
_PAUSE_S = 0.02  # frames are fetched by the batch: waking for each would take a core's time from perception


class BusRecorder:
    """Writes candump's `-L` format through python-can's own writer: can-utils read it, `rleex can decode` too."""

    def __init__(self, device: Exoskeleton, path: Path) -> None:
        """Raises HardwareError when the file or a bus can't be opened."""
        self.frames = 0
        self._flushed_s = 0.0
        try:
            self._file = path.open("a", encoding="ascii", buffering=1 << 20)
        except OSError as error:
            raise HardwareError(f"The bus log {path} can't be written: {error}; choose another place.") from error
        self._buses: list[can.BusABC] = []
        try:
            self._buses = [open_bus(bus) for bus in device.buses]
        except HardwareError:
            self._file.close()
            raise
        for bus in self._buses:
            _widen(bus)
        self._writers = [can.CanutilsLogWriter(self._file, channel=_plain(bus.channel)) for bus in device.buses]

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
            message.channel = None  # the writer's own name: a multicast address is no word for can-utils
            writer.on_message_received(message)
            self.frames += 1


def _plain(channel: str) -> str:
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
