"""A session in a line: for lists, and to compare sessions of one patient."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from logs.read import records
from logs.records import ActionEnd, Command, EventRaised, PatientChosen, Record, Refusal, Stop


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """What a list of sessions shows."""

    path: Path
    patient: str
    operator: str
    began: str
    duration_s: float
    records: int
    actions: int
    completed: int
    refusals: int
    events: int
    stops: int
    steps: int
    distance_m: float


def outline(path: Path) -> Outline:
    """The outline of a session's file. Raises AuditError when it can't be read."""
    return outline_of(path, records(path))


def outline_of(path: Path, found: list[Record]) -> Outline:
    """The same from records already read."""
    bodies = [record.body for record in found]
    ends = [body for body in bodies if isinstance(body, ActionEnd)]
    return Outline(
        path=path,
        patient=next((body.patient for body in bodies if isinstance(body, PatientChosen)), ""),
        operator=next((record.operator for record in found if record.operator), ""),
        began=found[0].wall if found else "",
        duration_s=duration_s(found),
        records=len(found),
        actions=sum(isinstance(body, Command) for body in bodies),
        completed=sum(end.outcome == "completed" for end in ends),
        refusals=sum(isinstance(body, Refusal) for body in bodies),
        events=sum(isinstance(body, EventRaised) for body in bodies),
        stops=sum(isinstance(body, Stop) for body in bodies),
        steps=sum(end.steps for end in ends),
        distance_m=sum(end.distance_m for end in ends),
    )


def duration_s(found: list[Record]) -> float:
    """From the earliest record to the latest, by the monotonic clock, which nobody can set."""
    moments = [record.monotonic_ns for record in found]
    return (max(moments) - min(moments)) / 1e9 if moments else 0.0
