"""One patient's outcomes over sessions."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto
from pathlib import Path

from app.outcomes.kept import KeptOutcomes
from app.outcomes.session import SessionOutcomes, find_outcomes, patient_of_trail
from app.system.errors import AppError
from app.system.paths import Home
from logs.errors import AuditError
from logs.read import session_paths

Refused = AppError | AuditError


class HistoryFault(Enum):
    """Why no outcomes are told together."""

    OTHER_PATIENTS = auto()  # patients, sessions
    NO_SESSIONS = auto()  # patient, folder


def outcomes_of(folder: Path, names: Sequence[str], patient: str = "") -> list[SessionOutcomes]:
    """Of sessions by name, oldest first, each once; a patient: only those of this one.

    Raises AppError where they are of several patients, or one holds no outcomes; AuditError for one that is not there.
    """
    by_session = {one.session: one for one in (find_outcomes(folder, name) for name in names)}
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
    kept = KeptOutcomes(home.outcomes)
    found: list[SessionOutcomes] = []
    for trail in trails:
        try:
            found.append(kept.of(trail))
        except (AppError, AuditError) as error:
            refused.append(error)
    if not found:
        if refused:
            raise refused[0]
        raise AppError(HistoryFault.NO_SESSIONS, patient=patient, folder=home.logs)
    return found, refused


def trails_of(folder: Path, patient: str) -> tuple[list[Path], list[Refused]]:
    """The trails of this patient's sessions, oldest first; and those that can't be read."""
    found: list[Path] = []
    refused: list[Refused] = []
    for path in session_paths(folder):
        try:
            if patient_of_trail(path) == patient:
                found.append(path)
        except AuditError as error:
            refused.append(error)
    return found, refused
