"""A recording by its index: the chunks by time, and in each of them a topic's messages by binary search.

A file without its footer, cut by a crash, has no index: its chunks' heads are read once. Chunks are unpacked as they
are asked for and the newest few kept, so that a film or a screen never has more than some seconds in memory.
"""

from __future__ import annotations

import os
import struct
from bisect import bisect_left, bisect_right
from collections import OrderedDict
from dataclasses import dataclass, field
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import msgspec
import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk
from mcap.stream_reader import get_chunk_data_stream
from msgspec import UNSET
from numpy.typing import NDArray

from app.recording.encryption import open_recording
from app.recording.read import DAMAGE, Recording, RecordingReadFault, Sample, messages
from app.recording.schemas import JOINT_FIELDS, JointStates
from app.system.errors import AppError
from logs.reading.errors import cause_of

KEPT_CHUNKS = 24  # some twenty seconds
_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_TIMES = struct.Struct("<QQ")
_MAGIC_BYTES = 8
_DECODE = msgspec.json.Decoder(JointStates).decode


@dataclass(frozen=True, slots=True)
class _Place:
    """A chunk in the file, and the monotonic times of its messages."""

    begin_ns: int
    end_ns: int
    offset: int


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSamples:
    """One topic's joints over some time: at_ns (n,), values (n, 3, 4) in the order of JOINT_FIELDS and Joint."""

    at_ns: NDArray[np.int64]
    values: NDArray[np.float64]


@dataclass(slots=True)
class _Unpacked:
    """A chunk's bytes, and each topic's messages in the order of time: when, and where in the bytes."""

    data: bytes = b""
    topics: dict[str, list[tuple[int, int, int]]] = field(default_factory=dict)
    joints: dict[str, JointSamples] = field(default_factory=dict)


class RecordingIndex:
    """One file, open for reading at any time. Times are the host's monotonic clock, in ns."""

    def __init__(self, path: Path) -> None:
        """Raises AppError for a file that is no recording, is of a newer version, or holds nothing."""
        self.recording = Recording(path=path)
        if next(messages(self.recording), None) is None:  # it reads header, clock and the first chunk
            raise AppError(RecordingReadFault.EMPTY, path=path)
        self.damaged_chunks: set[int] = set()
        self._kept: OrderedDict[int, _Unpacked] = OrderedDict()
        self._channels: dict[int, str] = {}
        try:
            self._file: BinaryIO = open_recording(path)
            places = self._indexed()
            self.cut = not places  # it has no index: the session did not end in good order
            places = places or self._scanned()
        except OSError as error:
            raise AppError(RecordingReadFault.UNREADABLE, path=path, detail=cause_of(error)) from error
        self._places = sorted(places, key=lambda one: one.begin_ns)
        self._begins = [one.begin_ns for one in self._places]
        self._ends = list(accumulate((one.end_ns for one in self._places), max))  # of a chunk and those before it
        self._read_channels(min(self._places, key=lambda one: one.offset))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    @property
    def begin_ns(self) -> int:
        """The first message."""
        return self._begins[0]

    @property
    def end_ns(self) -> int:
        """The last one."""
        return self._ends[-1]

    def newest(self, topic: str, at_ns: int, within_ns: int) -> Sample | None:
        """The newest message at or before a time, and after `at_ns - within_ns`."""
        best: tuple[int, _Unpacked, int, int] | None = None
        for unpacked in self._touching(at_ns - within_ns, at_ns):
            entries = unpacked.topics.get(topic, [])
            place = bisect_right(entries, at_ns, key=lambda entry: entry[0]) - 1
            if place >= 0 and (best is None or entries[place][0] >= best[0]):
                best = (entries[place][0], unpacked, *entries[place][1:])
        if best is None or best[0] <= at_ns - within_ns:
            return None
        when_ns, unpacked, begin, end = best
        return Sample(topic, when_ns, unpacked.data[begin:end])

    def between(self, topic: str, after_ns: int, until_ns: int) -> list[Sample]:
        """The messages after a time up to another, in their order."""
        found = []
        for unpacked in self._touching(after_ns, until_ns):
            entries = unpacked.topics.get(topic, [])
            first = bisect_right(entries, after_ns, key=lambda entry: entry[0])
            last = bisect_right(entries, until_ns, key=lambda entry: entry[0])
            found += [Sample(topic, when_ns, unpacked.data[a:b]) for when_ns, a, b in entries[first:last]]
        return sorted(found, key=lambda one: one.at_ns)

    def joints(self, topic: str, after_ns: int, until_ns: int) -> JointSamples:
        """Every sample of /joints/state or /joints/setpoint after a time up to another; not measured: NaN."""
        parts = [self._joints_of(unpacked, topic) for unpacked in self._touching(after_ns, until_ns)]
        at_ns = np.concatenate([np.zeros(0, np.int64), *(part.at_ns for part in parts)])
        values = np.concatenate([np.zeros((0, 3, 4)), *(part.values for part in parts)])
        chosen = np.flatnonzero((at_ns > after_ns) & (at_ns <= until_ns))
        chosen = chosen[np.argsort(at_ns[chosen], kind="stable")]
        return JointSamples(at_ns=at_ns[chosen], values=values[chosen])

    def _touching(self, after_ns: int, until_ns: int) -> list[_Unpacked]:
        """The chunks with messages in a stretch of time."""
        first, last = bisect_left(self._ends, after_ns), bisect_right(self._begins, until_ns)
        return [self._unpacked(number) for number in range(first, last) if self._places[number].end_ns >= after_ns]

    def _unpacked(self, number: int) -> _Unpacked:
        found = self._kept.get(number)
        if found is None:
            found = self._kept[number] = self._unpack(number)
            if len(self._kept) > KEPT_CHUNKS:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(number)
        return found

    def _unpack(self, number: int) -> _Unpacked:
        """A chunk that is damaged holds nothing, and is remembered."""
        try:
            data = self._data(self._places[number])
            return _Unpacked(data, self._topics(data))
        except OSError as error:
            raise AppError(RecordingReadFault.UNREADABLE, path=self.recording.path, detail=cause_of(error)) from error
        except DAMAGE:
            self.damaged_chunks.add(number)
            return _Unpacked()

    def _data(self, place: _Place) -> bytes:
        self._file.seek(place.offset + _RECORD.size)
        stream, length = get_chunk_data_stream(Chunk.read(ReadDataStream(self._file)), validate_crc=True)
        return stream.read(length)

    def _topics(self, data: bytes) -> dict[str, list[tuple[int, int, int]]]:
        found: dict[str, list[tuple[int, int, int]]] = {}
        at, offset_ns = 0, self.recording.clock_offset_ns
        while at + _RECORD.size <= len(data):
            opcode, length = _RECORD.unpack_from(data, at)
            body, at = at + _RECORD.size, at + _RECORD.size + length
            if opcode == Opcode.MESSAGE:
                channel, _, log_ns, _ = _MESSAGE.unpack_from(data, body)
                if channel in self._channels:
                    entry = (log_ns - offset_ns, body + _MESSAGE.size, at)
                    found.setdefault(self._channels[channel], []).append(entry)
        for entries in found.values():
            entries.sort()
        return found

    def _joints_of(self, unpacked: _Unpacked, topic: str) -> JointSamples:
        if topic not in unpacked.joints:
            entries = unpacked.topics.get(topic, [])
            rows = []
            for _, begin, end in entries:
                joints = _DECODE(unpacked.data[begin:end]).joints
                values = [[getattr(joint, name) for joint in joints] for name in JOINT_FIELDS]
                rows.append([[np.nan if value is UNSET else value for value in row] for row in values])
            at_ns = np.array([entry[0] for entry in entries], dtype=np.int64)
            unpacked.joints[topic] = JointSamples(at_ns=at_ns, values=np.array(rows).reshape(-1, len(JOINT_FIELDS), 4))
        return unpacked.joints[topic]

    def _read_channels(self, first: _Place) -> None:
        """The writer registers every channel before its first message."""
        data, at = self._data(first), 0
        while at + _RECORD.size <= len(data):
            opcode, length = _RECORD.unpack_from(data, at)
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(data[at + _RECORD.size :])))
                self._channels[channel.id] = channel.topic
            elif opcode == Opcode.MESSAGE:
                break
            at += _RECORD.size + length

    def _indexed(self) -> list[_Place]:
        """By the index at the file's end; empty: there is none."""
        try:
            self._file.seek(0)
            summary = make_reader(self._file).get_summary()
        except DAMAGE:
            return []
        if summary is None:
            return []
        offset_ns = self.recording.clock_offset_ns
        return [
            _Place(one.message_start_time - offset_ns, one.message_end_time - offset_ns, one.chunk_start_offset)
            for one in summary.chunk_indexes
            if one.message_index_offsets  # else it holds no messages
        ]

    def _scanned(self) -> list[_Place]:
        """By the head of each record; a chunk that is cut is left out."""
        size, at, offset_ns = self._file.seek(0, os.SEEK_END), _MAGIC_BYTES, self.recording.clock_offset_ns
        found = []
        while at + _RECORD.size <= size:
            self._file.seek(at)
            opcode, length = _RECORD.unpack(self._file.read(_RECORD.size))
            if at + _RECORD.size + length > size or opcode == Opcode.DATA_END:
                break
            if opcode == Opcode.CHUNK:
                begin_ns, end_ns = _TIMES.unpack(self._file.read(_TIMES.size))
                if end_ns:  # else it holds no messages
                    found.append(_Place(begin_ns - offset_ns, end_ns - offset_ns, at))
            at += _RECORD.size + length
        return found
