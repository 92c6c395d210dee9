"""The events of a session, from raising to acknowledgement."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from logs.records import Acknowledgement, EventCleared, EventRaised
from logs.report.timed import Timed

NOTED = "note"  # the weakest effect


@dataclass(frozen=True, slots=True, kw_only=True)
class EventFact:
    """One event from its raising to its acknowledgement."""

    at_s: float
    event: str
    effect: str
    text: str
    lasted_s: float | None
    acknowledged_after_s: float | None
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EventSum:
    """All occurrences of one event in a session."""

    event: str
    effect: str
    times: int
    lasted_s: float
    longest_unacknowledged_s: float | None


def events_of(timed: Timed) -> tuple[EventFact, ...]:
    """Every event of a session, in order."""
    cleared = timed.of(EventCleared)
    answers = [
        (timed.at_s(record), record.operator, record.body)
        for record in timed.records
        if isinstance(record.body, Acknowledgement) and record.body.accepted
    ]
    return tuple(_event(at_s, body, cleared, answers) for at_s, body in timed.of(EventRaised))


def _event(
    at_s: float,
    body: EventRaised,
    cleared: list[tuple[float, EventCleared]],
    answers: list[tuple[float, str, Acknowledgement]],
) -> EventFact:
    gone = next((when for when, other in cleared if when >= at_s and other.event == body.event), None)
    answer = next((a for a in answers if a[0] >= at_s and body.event in a[2].events), None)
    return EventFact(
        at_s=at_s,
        event=body.event,
        effect=body.effect,
        text=body.text,
        lasted_s=None if gone is None else gone - at_s,
        acknowledged_after_s=None if answer is None else answer[0] - at_s,
        by="" if answer is None else answer[1],
    )


def summed(events: Iterable[EventFact]) -> tuple[EventSum, ...]:
    """The occurrences of each event put together, the most frequent first."""
    groups: dict[tuple[str, str], list[EventFact]] = {}
    for event in events:
        groups.setdefault((event.event, event.effect), []).append(event)
    sums = [
        EventSum(
            event=name,
            effect=effect,
            times=len(group),
            lasted_s=sum(each.lasted_s or 0.0 for each in group),
            longest_unacknowledged_s=max((each.acknowledged_after_s or 0.0 for each in group), default=0.0) or None,
        )
        for (name, effect), group in groups.items()
    ]
    return tuple(sorted(sums, key=lambda each: -each.times))
