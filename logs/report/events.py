"""The events of a session's report, each from its raising to its acknowledgement, and their sums. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from logs import records as r
from logs.reason import Render, text_of
from logs.records import Body, Record

B = TypeVar("B", bound=Body)

NOTED = "note"  # the weakest effect
HELD = ("hold", "damp")  # effects that stay until acknowledged
ENDINGS = ("shutting-down", "shutdown-damping")  # of the session itself: nobody acknowledges them


class Timed:
    """Records with their seconds from the first."""

    def __init__(self, found: Sequence[Record]) -> None:
        self._began = min((record.monotonic_ns for record in found), default=0)
        self.records = found

    def at_s(self, record: Record) -> float:
        """Seconds from the session's beginning."""
        return (record.monotonic_ns - self._began) / 1e9

    def of(self, kind: type[B]) -> list[tuple[float, B]]:
        """(seconds, body) of one kind."""
        return [(self.at_s(record), record.body) for record in self.records if isinstance(record.body, kind)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportEvent:
    """One event from its raising to its acknowledgement."""

    at_s: float
    event: str
    effect: str
    text: str
    lasted_s: float | None
    acknowledged_after_s: float | None
    by: str

    def lasted_within_s(self, end_s: float) -> float:
        """Seconds it lasted; to the session's end where nothing cleared it."""
        return end_s - self.at_s if self.lasted_s is None else self.lasted_s

    def waited_within_s(self, end_s: float) -> float:
        """Seconds until it was acknowledged; to the session's end of a hold that nothing ended, 0 of anything else."""
        if self.acknowledged_after_s is not None:
            return self.acknowledged_after_s
        waits = self.lasted_s is None and self.effect in HELD and self.event not in ENDINGS
        return end_s - self.at_s if waits else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class EventSum:
    """All occurrences of one event in a session."""

    event: str
    effect: str
    times: int
    lasted_s: float
    longest_unacknowledged_s: float | None


def events_of(timed: Timed, render: Render) -> tuple[ReportEvent, ...]:
    """Every event of a session, in order."""
    cleared = timed.of(r.EventCleared)
    answers = [
        (timed.at_s(record), record.operator, record.body)
        for record in timed.records
        if isinstance(record.body, r.Acknowledgement) and record.body.accepted
    ]
    raised = timed.of(r.EventRaised)
    found = ((at_s, body, _answer(at_s, body.event, raised, answers)) for at_s, body in raised)
    return tuple(_event(at_s, body, cleared, answer, render) for at_s, body, answer in found)


Answer = tuple[float, str, r.Acknowledgement]  # seconds, operator


def _answer(at_s: float, event: str, raised: list[tuple[float, r.EventRaised]], answers: list[Answer]) -> Answer | None:
    """What acknowledged the event before it was raised again. Older trails have it behind the event's end."""
    again_s = next((when for when, other in raised if when > at_s and other.event == event), math.inf)
    return next((one for one in answers if at_s <= one[0] < again_s and event in one[2].events), None)


def _event(
    at_s: float,
    body: r.EventRaised,
    cleared: list[tuple[float, r.EventCleared]],
    answer: Answer | None,
    render: Render,
) -> ReportEvent:
    cleared_at = next((when for when, other in cleared if when >= at_s and other.event == body.event), None)
    return ReportEvent(
        at_s=at_s,
        event=body.event,
        effect=body.effect,
        text=text_of(body.text, render),
        lasted_s=None if cleared_at is None else cleared_at - at_s,
        acknowledged_after_s=None if answer is None else answer[0] - at_s,
        by="" if answer is None else answer[1],
    )


def summed(events: Iterable[ReportEvent], end_s: float) -> tuple[EventSum, ...]:
    """The occurrences of each event put together, the most frequent first. end_s: the session's end."""
    groups: dict[tuple[str, str], list[ReportEvent]] = {}
    for event in events:
        groups.setdefault((event.event, event.effect), []).append(event)
    sums = [
        EventSum(
            event=name,
            effect=effect,
            times=len(group),
            lasted_s=sum(each.lasted_within_s(end_s) for each in group),
            longest_unacknowledged_s=max(each.waited_within_s(end_s) for each in group) or None,
        )
        for (name, effect), group in groups.items()
    ]
    return tuple(sorted(sums, key=lambda each: -each.times))
