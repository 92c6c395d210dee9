"""One MCAP file: chunks that reach the disk whole, a disk that refuses, the trail's disk that must stay free.

The library writes into memory; what it gives goes to the disk at its own offset, again and again while the disk
refuses, so that the offsets in the file's index hold. A chunk ends each second: a crash loses at most the newest one.
The file's clock is the session's monotonic clock plus one offset, kept in the file: UTC as it was at the beginning.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterable
from enum import Enum, auto
from hashlib import sha256
from pathlib import Path
from typing import IO, cast

import msgspec
from mcap.writer import CompressionType, Writer
from msgspec import Struct

from app.recording.encryption import Sealer
from app.recording.schemas import Topic, schema_of
from logs.disk import FLOOR_BYTES, Disk
from logs.reason import Reason, reason
from logs.records import RecordingFile

VERSION = 1
PROFILE = "rleex"
LIBRARY = "rleex-recording"
CHUNK_NS = 1_000_000_000
CHUNK_BYTES = 4 << 20
SYNC_NS = 5_000_000_000
RETRY_NS = 500_000_000
MOST_PENDING = 16 << 20  # bytes that wait for the disk; then everything is refused, and counted
CLOCK = "rleex.clock"  # names of metadata
LOST = "rleex.lost"  # by topic; there only in a file that was finished
SOURCE = "rleex.source"  # damage; there only in a copy of a file that was cut or damaged


class RecorderFault(Enum):
    """Why a recording is not whole."""

    DISK = auto()  # detail
    DISK_LOW = auto()  # free_bytes
    SLOW = auto()  # waiting_bytes


class _Memory:
    """What the library has written since the last `take`; it tells the offset in the file."""

    def __init__(self) -> None:
        self.taken = 0
        self.buffer = bytearray()

    def write(self, data: bytes) -> int:
        self.buffer += data
        return len(data)

    def tell(self) -> int:
        return self.taken + len(self.buffer)

    def flush(self) -> None:
        """Nothing waits here for anything but `take`."""

    def take(self) -> bytes:
        data = bytes(self.buffer)
        self.taken += len(data)
        self.buffer.clear()
        return data


class RecordingWriter:
    """Writes messages of some topics; `lost` counts those that a slow or full disk cost, by topic."""

    def __init__(
        self,
        path: Path,
        topics: Iterable[Topic],
        clock_offset_ns: int,
        *,
        disk: Disk | None = None,
        floor_bytes: int = FLOOR_BYTES,
        most_pending: int = MOST_PENDING,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        key: bytes | None = None,
    ) -> None:
        """Raises OSError when the file exists or can't be made. clock_offset_ns: wall minus monotonic.

        key: the station's, by which the file is encrypted; None: it is not.
        """
        self.path = path
        self.written: Counter[str] = Counter()
        self.lost: Counter[str] = Counter()
        self.source_damage = ""  # of a copy: why its source could not be read to its end
        self.fault: Reason | None = None  # the newest
        self._disk = disk or Disk()
        self._floor_bytes = floor_bytes
        self._most_pending = most_pending
        self._free_bytes = free_bytes
        self._handle = self._disk.create(path)
        self._offset_ns = clock_offset_ns
        self._encode = msgspec.json.Encoder().encode
        self._memory = _Memory()
        self._sealer = None if key is None else Sealer(key)
        # Taken from the library, not on the disk.
        self._pending = bytearray(self._sealer.header if self._sealer else b"")
        self._at = 0  # in the file
        self._digest = sha256()
        self._low = False
        self._chunk_ns = self._sync_ns = self._retry_ns = 0
        self._mcap = Writer(cast("IO[bytes]", self._memory), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._mcap.start(profile=PROFILE, library=f"{LIBRARY} {VERSION}")
        self._mcap.add_metadata(CLOCK, {"wall_minus_monotonic_ns": str(clock_offset_ns)})
        self._channels = {topic.name: self._channel(topic) for topic in topics}

    def add(self, topic: str, at_ns: int, message: Struct | bytes) -> None:
        """One message at its monotonic time; refused, and counted, while the disk is behind or low."""
        if self.refuses:
            self.lost[topic] += 1
            return
        data = message if isinstance(message, bytes) else self._encode(message)
        self._mcap.add_message(
            self._channels[topic],
            log_time=at_ns + self._offset_ns,
            publish_time=at_ns + self._offset_ns,
            data=data,
            sequence=self.written[topic] & 0xFFFFFFFF,
        )
        self.written[topic] += 1

    @property
    def refuses(self) -> bool:
        """Whether messages are refused for now."""
        return self._low or len(self._pending) > self._most_pending

    @property
    def waiting_bytes(self) -> int:
        """What the disk has not taken yet."""
        return len(self._pending)

    def settle(self, now_ns: int) -> None:
        """End the chunk when it is time, and bring to the disk what waits."""
        if now_ns - self._chunk_ns >= CHUNK_NS:
            self._chunk_ns = now_ns
            self._mcap.flush()  # type: ignore[no-untyped-call]
            self._look_at_disk()
        self._take()
        if self._pending and now_ns >= self._retry_ns and not self._write():
            self._retry_ns = now_ns + RETRY_NS
        if len(self._pending) > self._most_pending and self.fault is None:
            self.fault = reason(RecorderFault.SLOW, waiting_bytes=len(self._pending))
        if now_ns - self._sync_ns >= SYNC_NS:
            self._sync_ns = now_ns
            self._sync()

    def finish(self) -> bool:
        """Losses, index and footer; False when the disk refuses them: the file reads to its last whole chunk."""
        self._mcap.add_metadata(LOST, {topic: str(number) for topic, number in self.lost.items() if number})
        if self.source_damage:
            self._mcap.add_metadata(SOURCE, {"damage": self.source_damage})
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._take()
        whole = self._write()
        self._sync()
        self._disk.close(self._handle)
        return whole

    def abandon(self) -> None:
        """Release the file as it is."""
        self._disk.close(self._handle)

    @property
    def sha256(self) -> str:
        """Of what has reached the disk."""
        return self._digest.hexdigest()

    @property
    def size_bytes(self) -> int:
        """Of what has reached the disk."""
        return self._at

    def _channel(self, topic: Topic) -> int:
        text = msgspec.json.encode(schema_of(topic))
        schema = self._mcap.register_schema(name=topic.schema_name, encoding="jsonschema", data=text)
        about = {"about": topic.about}
        return self._mcap.register_channel(topic.name, message_encoding="json", schema_id=schema, metadata=about)

    def _take(self) -> None:
        data = self._memory.take()
        self._pending += self._sealer.seal(data) if self._sealer else data

    def _look_at_disk(self) -> None:
        try:
            free_bytes = self._free_bytes(self.path.parent)
        except OSError as error:
            self.fault = reason(RecorderFault.DISK, detail=error.strerror or str(error))
            return
        self._low = free_bytes < self._floor_bytes
        if self._low:
            self.fault = reason(RecorderFault.DISK_LOW, free_bytes=free_bytes)

    def _write(self) -> bool:
        try:
            while self._pending:
                taken = self._disk.write(self._handle, bytes(self._pending), self._at)
                self._digest.update(self._pending[:taken])
                self._at += taken
                del self._pending[:taken]
        except OSError as error:
            self.fault = reason(RecorderFault.DISK, detail=error.strerror or str(error))
            return False
        return True

    def _sync(self) -> None:
        try:
            self._disk.sync(self._handle)
        except OSError as error:
            self.fault = reason(RecorderFault.DISK, detail=error.strerror or str(error))


def file_record(writer: RecordingWriter, *, whole: bool) -> RecordingFile:
    """A finished file for the trail."""
    return RecordingFile(
        file=writer.path.name,
        sha256=writer.sha256,
        size_bytes=writer.size_bytes,
        messages=dict(writer.written),
        lost={topic: number for topic, number in writer.lost.items() if number},
        whole=whole,
        fault=writer.fault,
    )
