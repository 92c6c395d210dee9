"""A session's outcomes: from its recording where there is one, else what its trail alone tells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from enum import Enum, auto
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from app.ipc.states import Outcome
from app.motion.plan import body_of
from app.outcomes.measures import Measures, measure
from app.outcomes.recorded import WALKING_ACTIONS, RecordedLegs, history_of, read_legs
from app.recording.read import session_of, trail_of
from app.system.errors import AppError
from app.system.paths import RECORDING_SUFFIX, recording_path
from hal.joints.body import Body
from hal.joints.protocol import TICK_S
from logs.errors import AuditError
from logs.read import duration_s, find_session, joints_host, records, understand
from logs.records import (
    ActionEnd,
    Discomfort,
    Exertion,
    GuidedTestResult,
    Pain,
    PatientChosen,
    Rating,
    Record,
)
from profiles.schema import DoseTargets, Profile

COMPLETED = Outcome.COMPLETED.value


class OutcomesFault(Enum):
    """Why outcomes are not told."""

    NO_PATIENT = auto()  # path: neither trail nor recording names one
    NO_LENGTHS = auto()  # path: its profile is not of this version
    NO_LEGS = auto()  # path


class OutcomeSource(Enum):
    """What the measures are made of."""

    RECORDING = "recording"
    CUT_RECORDING = "cut recording"  # up to where it can be read
    TRAIL = "trail"  # steps, walking time and actions only


class Dose(Struct, frozen=True, kw_only=True):
    """Done beside the target; None: not measured."""

    steps: int | None
    distance_m: float | None
    duration_s: float  # of the session, standing and sitting too, as the session screen counts it
    target: DoseTargets


class SessionOutcomes(Struct, frozen=True, kw_only=True):
    """One session."""

    session: str
    patient: str
    began: str  # UTC, ISO 8601
    began_ns: int  # the same moment on the monotonic clock, as the tests' times
    source: OutcomeSource
    measured_s: float  # how much of the session the measures are made of
    measures: Measures
    joints_host: str = ""  # the other computer, which had the legs and has their trail; empty: none
    actions: dict[str, int]  # completed, by name
    dose: Dose | None = None  # None: its profile holds no targets
    discomfort: int | None = None  # 0 none to 10 worst; None: not asked
    pain: int | None = None  # the same
    exertion: int | None = None  # Borg's scale, 6 none to 20 maximal
    tests: tuple[GuidedTestResult, ...] = ()  # guided ones, in order, with those that were not completed


def find_outcomes(folder: Path, name: str) -> SessionOutcomes:
    """Of a session or recording by its path, name, beginning of a name, or "last". Raises AppError, AuditError."""
    given = Path(name)
    if given.suffix == RECORDING_SUFFIX:
        return of_recording(given)
    trail = find_session(folder, name)
    recording = recording_path(trail.parent, trail.stem)
    return of_recording(recording) if recording.exists() else of_trail(trail)


def of_recording(path: Path) -> SessionOutcomes:
    """With every measure. Raises AppError."""
    legs = read_legs(path)
    trail = _records_beside(path) or _records_within(legs)
    chosen = _chosen(trail)
    if chosen is None:
        raise AppError(OutcomesFault.NO_PATIENT, path=path)
    if joints_host(trail):
        return _of_records(session_of(path), trail, chosen)
    history = history_of(legs, _body(path, chosen))
    if history is None:
        raise AppError(OutcomesFault.NO_LEGS, path=path)
    recording = legs.recording
    return _outcomes(
        session_of(path),
        trail,
        chosen,
        source=OutcomeSource.RECORDING if recording.complete else OutcomeSource.CUT_RECORDING,
        measured_s=len(history.joints_rad) * TICK_S,
        measures=measure(history),
    )


def of_trail(path: Path) -> SessionOutcomes:
    """Without a recording: steps, walking time and actions; what the legs alone tell is None.

    Raises AppError, AuditError.
    """
    trail = records(path)
    chosen = _chosen(trail)
    if chosen is None:
        raise AppError(OutcomesFault.NO_PATIENT, path=path)
    return _of_records(path.stem, trail, chosen)


def _of_records(session: str, trail: Sequence[Record], chosen: PatientChosen) -> SessionOutcomes:
    return _outcomes(
        session,
        trail,
        chosen,
        source=OutcomeSource.TRAIL,
        measured_s=duration_s(trail),
        measures=_commanded(trail),
    )


def _commanded(trail: Sequence[Record]) -> Measures:
    """Steps and walking time as control commanded them; None where another computer's control did."""
    if joints_host(trail):
        return Measures(steps=None, walking_time_s=None)
    ends = [record.body for record in trail if isinstance(record.body, ActionEnd)]
    before = [0, *(end.steps for end in ends)]  # an end holds the steps of the session so far
    taken = [(end, end.steps - steps) for end, steps in zip(ends, before, strict=False)]
    walks = [(end, steps) for end, steps in taken if end.action in WALKING_ACTIONS and end.first_motion_ns]
    return Measures(steps=sum(steps for _, steps in walks), walking_time_s=_time_in_s([end for end, _ in walks]))


def _outcomes(
    session: str,
    trail: Sequence[Record],
    chosen: PatientChosen,
    *,
    source: OutcomeSource,
    measured_s: float,
    measures: Measures,
) -> SessionOutcomes:
    return SessionOutcomes(
        session=session,
        patient=chosen.patient,
        began=trail[0].wall,
        began_ns=trail[0].monotonic_ns,
        source=source,
        measured_s=measured_s,
        measures=measures,
        joints_host=joints_host(trail),
        actions=_actions(trail),
        dose=dose_of(chosen.parameters, measures, duration_s(trail)),
        discomfort=last_rating(trail, Discomfort),
        pain=last_rating(trail, Pain),
        exertion=last_rating(trail, Exertion),
        tests=tuple(record.body for record in trail if isinstance(record.body, GuidedTestResult)),
    )


def _body(path: Path, chosen: PatientChosen) -> Body:
    """By the profile as it was in that session."""
    try:
        return body_of(msgspec.convert({**chosen.parameters, "identifier": chosen.patient}, Profile))
    except msgspec.ValidationError as error:
        raise AppError(OutcomesFault.NO_LENGTHS, path=path) from error


def _chosen(trail: Iterable[Record]) -> PatientChosen | None:
    return next((record.body for record in trail if isinstance(record.body, PatientChosen)), None)


def _records_beside(path: Path) -> list[Record]:
    try:
        return records(trail_of(path)) if trail_of(path).exists() else []
    except AuditError:
        return []  # the recording holds the same lines


def _records_within(legs: RecordedLegs) -> list[Record]:
    found = (understand(line, number) for number, line in enumerate(legs.trail_lines, start=1))
    return [record for record in found if isinstance(record, Record)]


def _actions(trail: Iterable[Record]) -> dict[str, int]:
    ended = (record.body for record in trail if isinstance(record.body, ActionEnd))
    return dict(Counter(end.action for end in ended if end.outcome == COMPLETED).most_common())


def _time_in_s(walks: Sequence[ActionEnd]) -> float:
    """Together, from first motion to end; a walk and the action that ends it are one stretch."""
    total_ns, until_ns = 0, 0
    for walk in sorted(walks, key=lambda end: end.first_motion_ns):
        total_ns += max(0, walk.ended_ns - max(walk.first_motion_ns, until_ns))
        until_ns = max(until_ns, walk.ended_ns)
    return total_ns / 1e9


def dose_of(parameters: dict[str, Any], measures: Measures, duration_s: float) -> Dose | None:
    """By the profile as it was in that session; None where it holds no targets."""
    try:
        target = msgspec.convert(parameters["dose"], DoseTargets)
    except (KeyError, msgspec.ValidationError):
        return None
    return Dose(steps=measures.steps, distance_m=measures.distance_m, duration_s=duration_s, target=target)


def last_rating(trail: Iterable[Record], kind: type[Rating]) -> int | None:
    """The patient's last rating of this kind; None: not asked."""
    ratings = [record.body.rating for record in trail if isinstance(record.body, kind)]
    return ratings[-1] if ratings else None
