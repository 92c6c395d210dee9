"""Every moment in a message that crosses the link is told by the receiver's clock."""

from __future__ import annotations

import msgspec
import pytest
from msgspec.structs import fields

from app.ipc.messages import OperatorCommand, OperatorKind, TriggerReport
from app.ipc.snapshot import ActionReport, ActiveEvent
from app.ipc.states import Action, Effect, Event, GaitState, Source
from app.link.clock import MOMENTS, PARTS, ClockEstimate, localized
from testing.messages import STANDING, event

AHEAD = ClockEstimate(0, 900, 1_100)


@pytest.mark.parametrize("kind", MOMENTS, ids=lambda kind: kind.__name__)
def test_no_field_with_a_moment_is_left_out(kind: type[msgspec.Struct]) -> None:
    moments = {field.name for field in fields(kind) if field.name.endswith("_ns")}
    assert moments == set(MOMENTS[kind])


@pytest.mark.parametrize("kind", MOMENTS, ids=lambda kind: kind.__name__)
def test_no_part_with_a_moment_is_left_out(kind: type[msgspec.Struct]) -> None:
    parts = {field.name for field in fields(kind) if any(one.__name__ in str(field.type) for one in MOMENTS)}
    assert parts == set(PARTS.get(kind, ()))


def test_a_moment_is_shifted_by_the_most_that_the_other_clock_may_be_ahead() -> None:
    command = OperatorCommand(sequence=7, kind=OperatorKind.STOP, sent_ns=5_000)
    assert localized(command, AHEAD).sent_ns == 3_900
    assert localized(command, AHEAD).sequence == 7


def test_what_has_not_come_stays_so() -> None:
    report = TriggerReport(
        incarnation=1, sequence=1, captured_ns=5_000, sent_ns=6_000, hand=False, gesture=None, released_ns=0
    )
    shifted = localized(report, AHEAD)
    assert (shifted.captured_ns, shifted.sent_ns, shifted.released_ns) == (3_900, 4_900, 0)


def test_parts_are_shifted_with_the_whole() -> None:
    event = stopped(9_000)
    action = ActionReport(
        number=1, action=Action.WALK, source=Source.GESTURE, from_state=GaitState.STANDING, released_ns=8_000
    )
    snapshot = msgspec.structs.replace(STANDING, at_ns=10_000, events=(event,), reports=(action,))
    shifted = localized(snapshot, AHEAD)
    assert shifted.at_ns == 8_900
    assert shifted.events[0].since_ns == 7_900
    assert shifted.reports[0].released_ns == 6_900
    assert shifted.pauses == snapshot.pauses


def test_an_event_s_identity_is_none_of_its_moments() -> None:
    """The estimate is another one with every snapshot; an event that is raised anew is another one by any."""
    first, later = (localized(stopped(9_000), clock) for clock in (AHEAD, ClockEstimate(0, 900, 1_101)))
    assert (first.since_ns, later.since_ns) == (7_900, 7_899)
    assert first.identity == later.identity == stopped(9_000).identity
    assert localized(stopped(9_001), ClockEstimate(0, 900, 1_101)).identity != first.identity


def stopped(since_ns: int) -> ActiveEvent:
    return event(Event.STOP, Effect.HOLD, since_ns)
