"""What was measured is kept: a recording takes a thirtieth of its time to read, a page shows many of them."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import msgspec
from msgspec import Struct

from app.outcomes.session import SessionOutcomes, find_outcomes
from app.system.paths import recording_path
from logs.reading.errors import InputError
from logs.reading.regular import read_bytes

DEFINITIONS = 2  # raised with every change of what a measure means, so that what was kept is measured anew
MOST_BYTES = 1 << 20


class _Kept(Struct, frozen=True, kw_only=True):
    definitions: int
    made_of: tuple[tuple[int, int], ...]  # trail, recording: bytes, nanoseconds of the last change
    outcomes: SessionOutcomes


class KeptOutcomes:
    """Outcomes of the sessions of a home, a file each in `<folder>`; without the folder they are measured each time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def of(self, trail: Path) -> SessionOutcomes:
        """Kept ones, if trail and recording are still the same. Raises AppError, AuditError."""
        made_of = tuple(
            (status.st_size, status.st_mtime_ns)
            for path in (trail, recording_path(trail.parent, trail.stem))
            if path.exists() and (status := path.stat())
        )
        path = self._folder / f"{trail.stem}.json"
        kept = _read(path)
        if kept is not None and (kept.definitions, kept.made_of) == (DEFINITIONS, made_of):
            return kept.outcomes
        found = find_outcomes(trail.parent, str(trail))
        self._write(path, _Kept(definitions=DEFINITIONS, made_of=made_of, outcomes=found))
        return found

    def _write(self, path: Path, kept: _Kept) -> None:
        """A full disk keeps nothing; the next time it is measured again."""
        new = path.with_name(f".{path.name}.new")
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            new.write_bytes(msgspec.json.encode(kept))
            new.replace(path)
        except OSError:
            with suppress(OSError):
                new.unlink(missing_ok=True)


def _read(path: Path) -> _Kept | None:
    try:
        return msgspec.json.decode(read_bytes(path, MOST_BYTES), type=_Kept)
    except (OSError, InputError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
