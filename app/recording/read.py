"""Recordings as they are found: whole, cut by a crash, foreign, newer. What can be read is read."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk

from app.recording.encryption import open_recording
from app.recording.writer import CLOCK, LIBRARY, LOST, PROFILE, SOURCE, VERSION
from app.system.errors import AppError
from app.system.paths import PICTURES_SUFFIX, RECORDING_SUFFIX
from logs.manifest import begun_last
from logs.read import records
from logs.reading.errors import cause_of
from logs.reading.regular import open_regular
from logs.records import ProcessStart, RecordingFile, RecordingSent

MOST_RECORD = 64 << 20  # bytes
TRAIL_SUFFIX = ".jsonl"
STAMP = "%Y%m%dT%H%M%SZ"  # UTC, with which a session's name begins
CUT = "cut"  # of `Recording.source_damage`
# What the library makes of bytes that are no record; UnicodeDecodeError is a ValueError.
DAMAGE = (McapError, zstandard.ZstdError, struct.error, LookupError, MemoryError, OverflowError, ValueError)


class RecordingReadFault(Enum):
    """Why a file is not read as a recording."""

    UNREADABLE = auto()  # path, detail
    NOT_MCAP = auto()  # path
    FOREIGN = auto()  # path
    NEWER = auto()  # path, version, known
    NO_RECORDING = auto()  # name, folder
    AMBIGUOUS = auto()  # name, folder, matches
    EMPTY = auto()  # path
    NO_PICTURES = auto()  # path
    NO_PATIENT = auto()  # path
    KEPT_FOR_EVER = auto()
    UNDELETABLE = auto()  # path, detail


@dataclass(slots=True, kw_only=True)
class Recording:
    """What has been read of a file so far; `messages` fills it."""

    path: Path
    clock_offset_ns: int = 0  # wall minus monotonic
    counts: Counter[str] = field(default_factory=Counter)
    schemas: dict[str, str] = field(default_factory=dict)  # by topic
    lost: dict[str, int] = field(default_factory=dict)
    chunks: int = 0
    whole: bool = False  # up to its footer
    damage: str = ""  # why the rest can't be read; empty: the end, or cut between two chunks
    source_damage: str = ""  # of a copy: the same of the file that it was made of, CUT for a cut one
    first_ns: int | None = None  # monotonic; None: no message yet
    last_ns: int = 0

    @property
    def complete(self) -> bool:
        """Whether everything that was written is there, once it was read to its end."""
        return self.whole and not self.damage and not self.source_damage

    @property
    def duration_s(self) -> float:
        """From the first message to the last."""
        return 0.0 if self.first_ns is None else (self.last_ns - self.first_ns) / 1e9


@dataclass(frozen=True, slots=True)
class Sample:
    """One message; monotonic time."""

    topic: str
    at_ns: int
    data: bytes

    @property
    def value(self) -> dict[str, Any]:
        """The message's fields."""
        found: dict[str, Any] = msgspec.json.decode(self.data)
        return found


def find_recording(folder: Path, named: str) -> Path:
    """A recording by its path or its trail's, its session's name, the name's beginning, or "last". Raises AppError."""
    given = Path(named)
    if given.suffix == RECORDING_SUFFIX:
        return given
    if given.suffix == TRAIL_SUFFIX:
        return given.with_suffix(RECORDING_SUFFIX)
    found = sorted(path for path in folder.glob(f"*{RECORDING_SUFFIX}") if not path.name.endswith(PICTURES_SUFFIX))
    if named == "last" and found:
        return begun_last(folder, found)
    matches = [path for path in found if named and path.name.startswith(named)]
    if not matches:
        raise AppError(RecordingReadFault.NO_RECORDING, name=named, folder=folder)
    if len(matches) > 1:
        raise AppError(RecordingReadFault.AMBIGUOUS, name=named, folder=folder, matches=len(matches))
    return matches[0]


def session_of(path: Path) -> str:
    """The session that a recording is of."""
    return path.name.partition(".")[0]


def trail_of(path: Path) -> Path:
    """The trail beside a recording."""
    return path.with_name(f"{session_of(path)}{TRAIL_SUFFIX}")


def messages(recording: Recording, *topics: str) -> Iterator[Sample]:
    """The messages of these topics, or all, in the file's order, up to its end or to where it is cut.

    Raises AppError for a file that is no recording of this version or an older one.
    """
    channels: dict[int, str] = {}
    for record in _inner_records(recording):
        if isinstance(record, Channel):
            channels[record.id] = record.topic
        if not isinstance(record, Message):
            continue
        topic = channels.get(record.channel_id)
        if topic is None:
            recording.damage = f"no channel {record.channel_id}"
            return
        at_ns = record.log_time - recording.clock_offset_ns
        recording.counts[topic] += 1
        recording.first_ns = at_ns if recording.first_ns is None else min(recording.first_ns, at_ns)
        recording.last_ns = max(recording.last_ns, at_ns)
        if not topics or topic in topics:
            yield Sample(topic, at_ns, record.data)


def survey(path: Path) -> Recording:
    """A file read to its end, or to where it is cut. Raises AppError."""
    recording = Recording(path=path)
    for _ in messages(recording):
        pass
    return recording


def _inner_records(recording: Recording) -> Iterator[McapRecord]:
    names: dict[int, str] = {}
    for record in _outer_records(recording):
        inner = [record]
        if isinstance(record, Chunk):
            try:
                inner = breakup_chunk(record, validate_crc=True)
            except DAMAGE as error:
                recording.damage = _text(error)
                return
            recording.chunks += 1
        elif isinstance(record, Message):  # outside of a chunk no checksum protects it, and we write none
            recording.damage = "a message outside of a chunk"
            return
        for one in inner:
            if isinstance(one, Schema):
                names[one.id] = one.name
            elif isinstance(one, Channel):
                recording.schemas[one.topic] = names.get(one.schema_id, "")
            yield one


def _outer_records(recording: Recording) -> Iterator[McapRecord]:
    path = recording.path
    try:
        with open_recording(path) as file:
            found = StreamReader(file, emit_chunks=True, record_size_limit=MOST_RECORD).records
            begun = False
            try:
                _check_header(next(found, None), path)
                begun = True
                for record in found:
                    if isinstance(record, Metadata):
                        _take_metadata(record, recording)
                    if isinstance(record, DataEnd):  # what follows repeats channels and schemas
                        _take_summary(list(found), recording)
                        return
                    yield record
            except DAMAGE as error:
                if not begun:
                    raise AppError(RecordingReadFault.NOT_MCAP, path=path) from error
                if not isinstance(error, EndOfFile):  # that one is a cut
                    recording.damage = _text(error)
    except OSError as error:
        raise AppError(RecordingReadFault.UNREADABLE, path=path, detail=cause_of(error)) from error


def _check_header(header: McapRecord | None, path: Path) -> None:
    if not isinstance(header, Header) or header.profile != PROFILE or not header.library.startswith(f"{LIBRARY} "):
        raise AppError(RecordingReadFault.FOREIGN, path=path)
    version = header.library.removeprefix(f"{LIBRARY} ")
    if not version.isdigit() or int(version) > VERSION:
        raise AppError(RecordingReadFault.NEWER, path=path, version=version, known=VERSION)


def _take_summary(summary: list[McapRecord], recording: Recording) -> None:
    messages_written = [one.message_count for one in summary if isinstance(one, Statistics)]
    recording.whole = sum(isinstance(one, Footer) for one in summary) == 1
    if recording.whole and messages_written != [recording.counts.total()]:
        recording.damage = f"{recording.counts.total()} messages of {messages_written}"


def _text(error: Exception) -> str:
    return str(error) or type(error).__name__


def _take_metadata(record: Metadata, recording: Recording) -> None:
    if record.name == CLOCK:
        recording.clock_offset_ns = int(record.metadata["wall_minus_monotonic_ns"])
    elif record.name == LOST:
        recording.lost = {topic: int(number) for topic, number in record.metadata.items()}
    elif record.name == SOURCE:
        recording.source_damage = record.metadata["damage"]


class HashCheck(Enum):
    """How a file compares with what its trail says of it."""

    SAME = auto()
    OTHER = auto()  # another content
    UNKNOWN = auto()  # the trail names no hash: it ended before the recording did
    NO_TRAIL = auto()


def proof_of(path: Path) -> tuple[HashCheck, RecordingFile | None]:
    """Compare the file's hash with the trail beside it. Raises AppError, AuditError."""
    trail = trail_of(path)
    if not trail.exists():
        return HashCheck.NO_TRAIL, None
    named = [one.body for one in records(trail) if isinstance(one.body, RecordingFile) and one.body.file == path.name]
    if not named:
        return HashCheck.UNKNOWN, None
    try:
        digest = sha256()
        with open_regular(path) as file:
            for part in iter(partial(file.read, 1 << 20), b""):
                digest.update(part)
    except OSError as error:
        raise AppError(RecordingReadFault.UNREADABLE, path=path, detail=cause_of(error)) from error
    return (HashCheck.SAME if digest.hexdigest() == named[-1].sha256 else HashCheck.OTHER), named[-1]


SENDERS = ("control", "perception")


@dataclass(frozen=True, slots=True, kw_only=True)
class SentCheck:
    """By topic; only topics whose messages their process counts."""

    made: Mapping[str, int]
    missing: Mapping[str, int]  # neither there nor counted as lost, or there more often than made: below 0
    known: bool  # every process that was started said how many it made


def check_sent(recording: Recording, recorded: RecordingFile | None) -> SentCheck:
    """A recording that was read to its end, beside the trail's counts; of pictures none are. Raises AuditError."""
    trail = trail_of(recording.path)
    if recording.path.name.endswith(PICTURES_SUFFIX):
        return SentCheck(made={}, missing={}, known=False)
    made: Counter[str] = Counter()
    open_processes: Counter[str] = Counter()
    for record in records(trail) if trail.exists() else ():
        if record.process in SENDERS and isinstance(record.body, ProcessStart):
            open_processes[record.process] += 1
        elif isinstance(record.body, RecordingSent):
            open_processes[record.process] -= 1
            made.update(record.body.messages)
    lost = recorded.lost if recorded is not None else recording.lost
    missing = {topic: count - recording.counts[topic] - lost.get(topic, 0) for topic, count in made.items()}
    known = bool(made) and not any(open_processes.values())
    return SentCheck(made=made, missing={topic: count for topic, count in missing.items() if count}, known=known)
