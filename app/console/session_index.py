"""One line a session, kept a patient, so that the list can tell of the last one; the audit trail is the proof."""

from __future__ import annotations

import errno
import os
from io import FileIO
from pathlib import Path

import msgspec
from msgspec import Struct

from app.system.errors import AppError


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
    note: str = ""


class SessionRecords:
    """The records of a home, `<folder>/<patient>.jsonl`. Methods raise AppError with a sentence."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def of(self, patient: str) -> tuple[SessionRecord, ...]:
        """Oldest first."""
        path = self._folder / f"{patient}.jsonl"
        if not path.exists():
            return ()
        try:
            lines = path.read_bytes().splitlines()
            return tuple(msgspec.json.decode(line, type=SessionRecord) for line in lines if line.strip())
        except (OSError, msgspec.MsgspecError) as error:
            raise AppError(f"The sessions in {path} can't be read: {error}; move the file away.") from error

    def add(self, record: SessionRecord) -> None:
        """Keep one, or nothing of it."""
        path = self._folder / f"{record.patient}.jsonl"
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            with path.open("ab", buffering=0) as file:
                _append(file, msgspec.json.encode(record) + b"\n")
        except OSError as error:
            raise AppError(f"{path} can't be written: {error.strerror}; free space, then save again.") from error


def _append(file: FileIO, line: bytes) -> None:
    """The whole line; a full disk takes part of one, which would spoil what is read and appended later."""
    before = file.tell()
    if file.write(line) < len(line):
        file.truncate(before)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
