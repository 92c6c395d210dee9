"""One patient's outcomes over sessions.

What was measured is kept: a recording takes a thirtieth of its time to read, a page shows many of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from enum import Enum, auto
from os.path import realpath
from pathlib import Path
from typing import TypeVar

import msgspec
from msgspec import Struct

from app.outcomes.session import SessionOutcomes, find_outcomes
from app.system.errors import AppError
from app.system.files import write_whole
from app.system.paths import RECORDING_SUFFIX, Home, recording_path
from logs.errors import AuditError
from logs.read import find_session, holds_enrolment, patient_and_purpose, session_paths
from logs.reading.errors import InputError
from logs.reading.regular import read_bytes

Refused = AppError | AuditError
DEFINITIONS = 5  # raised with every change of what a measure means, so that what was kept is measured anew
MOST_BYTES = 1 << 20


class HistoryFault(Enum):
    """Why no outcomes are told together."""

    OTHER_PATIENTS = auto()  # patients, sessions
    NO_SESSIONS = auto()  # patient, folder
    ONE_NAME = auto()  # session, first, second: paths


def outcomes_of(folder: Path, names: Sequence[str], patient: str = "") -> list[SessionOutcomes]:
    """Of sessions by name, oldest first, each once; a patient: only those of this one.

    Raises AppError where they are of several patients, one holds no outcomes, or two files of two places have one name,
    as those of two computers do: which of them counts is not ours to say. AuditError for one that is not there.
    """
    by_session: dict[str, SessionOutcomes] = {}
    paths: dict[str, Path] = {}
    for name in names:
        path = Path(name) if Path(name).suffix == RECORDING_SUFFIX else find_session(folder, name)
        one = find_outcomes(folder, str(path))
        first = paths.setdefault(one.session, path)
        if realpath(first.parent) != realpath(path.parent):
            raise AppError(HistoryFault.ONE_NAME, session=one.session, first=first, second=path)
        by_session[one.session] = one
    found = [one for _, one in sorted(by_session.items()) if patient in ("", one.patient)]
    if not found:
        raise AppError(HistoryFault.NO_SESSIONS, patient=patient, folder=folder)
    patients = sorted({one.patient for one in found})
    if len(patients) > 1:
        sessions = ", ".join(f"{one.session} ({one.patient})" for one in found)
        raise AppError(HistoryFault.OTHER_PATIENTS, patients=", ".join(patients), sessions=sessions)
    return found


def outcomes_of_patient(home: Home, patient: str) -> tuple[list[SessionOutcomes], list[Refused]]:
    """All that this patient has, oldest first; and why sessions are left out. Raises AppError where none is left."""
    trails, refused = trails_of(home.logs, patient)
    found: list[SessionOutcomes] = []
    for trail in trails:
        try:
            found.append(kept_outcomes(home.outcomes, trail))
        except (AppError, AuditError) as error:
            refused.append(error)
    if not found:
        if refused:
            raise refused[0]
        raise AppError(HistoryFault.NO_SESSIONS, patient=patient, folder=home.logs)
    return found, refused


def trails_of(folder: Path, patient: str) -> tuple[list[Path], list[Refused]]:
    """The trails of this patient's sessions, oldest first; and those that can't be read.

    Trainings and enrolments name a patient too, and walk nobody.
    """
    found: list[Path] = []
    refused: list[Refused] = []
    for path in session_paths(folder):
        try:
            named, purpose = patient_and_purpose(path)
            if named == patient and (purpose == "session" or (not purpose and not holds_enrolment(path))):
                found.append(path)
        except AuditError as error:
            refused.append(error)
    return found, refused


class _MadeOf(Struct, frozen=True, kw_only=True):
    """What any version kept."""

    made_of: tuple[tuple[int, int], ...]  # trail, recording: bytes, nanoseconds of the last change


_Made = TypeVar("_Made", bound=_MadeOf)


class _Kept(_MadeOf, frozen=True, kw_only=True):
    definitions: int
    outcomes: SessionOutcomes


def kept_outcomes(folder: Path, trail: Path) -> SessionOutcomes:
    """A session's, kept in a file of this folder if trail and recording are still the same; else measured, and kept.

    What was measured of a recording stays when that is deleted, by the definitions of its time: the trail alone tells
    less. Times of change don't count then: a copy of the home has others.

    Raises AppError, AuditError.
    """
    made_of = tuple(
        (status.st_size, status.st_mtime_ns)
        for path in (trail, recording_path(trail.parent, trail.stem))
        if path.exists() and (status := path.stat())
    )
    path = folder / f"{trail.stem}.json"
    kept = _read(path, _Kept)
    if kept is not None and (kept.definitions, kept.made_of) == (DEFINITIONS, made_of):
        return kept.outcomes
    older = kept or _read(path, _MadeOf)
    tells_more = older is not None and _sizes(older.made_of[:-1]) == _sizes(made_of)  # its recording was deleted
    if kept is not None and tells_more:
        return kept.outcomes
    found = find_outcomes(trail.parent, str(trail))
    if not tells_more:
        with suppress(OSError):  # a full disk keeps nothing; the next time it is measured again
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_whole(path, msgspec.json.encode(_Kept(definitions=DEFINITIONS, made_of=made_of, outcomes=found)))
    return found


def _sizes(made_of: tuple[tuple[int, int], ...]) -> list[int]:
    return [size_bytes for size_bytes, _ in made_of]


def _read(path: Path, kind: type[_Made]) -> _Made | None:
    try:
        return msgspec.json.decode(read_bytes(path, MOST_BYTES), type=kind)
    except (OSError, InputError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
