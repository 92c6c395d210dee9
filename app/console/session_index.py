"""Indexes of sessions and trainings, a file a patient and a line each; of sessions, the audit trail is the proof."""

from __future__ import annotations

from enum import Enum, auto
from pathlib import Path
from typing import Generic, TypeVar

import msgspec
from msgspec import Struct

from app.system.errors import AppError
from logs.disk import append_line
from logs.reading.errors import InputError, cause_of
from logs.reading.formats import MAX_JSON_LINES, decode_json, decode_json_lines
from logs.reading.regular import read_bytes


class SessionIndexFault(Enum):
    """Why the index can't be read or written."""

    UNREADABLE = auto()  # path, detail
    NOT_WRITTEN = auto()  # path, detail


class SessionRecord(Struct, frozen=True, kw_only=True):
    """What a session came to."""

    session: str
    patient: str
    at: str  # ISO 8601, UTC, the end
    operator: str = ""
    steps: int = 0
    distance_m: float = 0.0
    duration_s: float = 0.0
    refusals: int = 0
    discomfort: int | None = None  # 0 none to 10 worst
    pain: int | None = None  # the same
    exertion: int | None = None  # Borg's scale, 6 none to 20 maximal
    note: str = ""


class TrainingRecord(Struct, frozen=True, kw_only=True):
    """What a training of the gestures came to."""

    patient: str
    at: str  # ISO 8601, UTC, the end
    best: int = 0  # gestures in a row
    learnt: int = 0  # gestures shown


R = TypeVar("R", SessionRecord, TrainingRecord)


class Records(Generic[R]):
    """The records of a home that are of one kind, `<folder>/<patient>.jsonl`. Methods raise AppError."""

    def __init__(self, folder: Path, kind: type[R]) -> None:
        self._folder = folder
        self._kind: type[R] = kind

    def of(self, patient: str) -> tuple[R, ...]:
        """Oldest first, without lines that a loss of power has cut off or left as NULs."""
        path = self._folder / f"{patient}.jsonl"
        if not path.exists():
            return ()
        try:
            data = read_bytes(path, MAX_JSON_LINES)
            begin = b'{"%s":' % self._kind.__struct_fields__[0].encode()
            if begin in data or begin.startswith(data):  # any other file is refused, not read as an empty index
                data = b"\n".join(line for line in data.split(b"\n") if _is_json(line))
            return decode_json_lines(data, self._kind)
        except OSError as error:
            raise AppError(SessionIndexFault.UNREADABLE, path=path, detail=cause_of(error)) from error

    def add(self, record: R) -> None:
        """Keep one, or nothing of it."""
        path = self._folder / f"{record.patient}.jsonl"
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            append_line(path, msgspec.json.encode(record) + b"\n")
        except OSError as error:
            raise AppError(SessionIndexFault.NOT_WRITTEN, path=path, detail=error.strerror) from error


def _is_json(line: bytes) -> bool:
    """Whatever its values; what was cut off, or holds a NUL, is none."""
    try:
        decode_json(line, msgspec.Raw)
    except InputError:
        return False
    return True
