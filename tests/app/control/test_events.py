"""Every row of the table of events is made to happen, and does what its row says."""

from __future__ import annotations

import numpy as np
import pytest

from app.control.events.row import Latch
from app.control.events.table import LINGER_NS, ROW, TABLE
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState, Source
from app.motion.follower import Mode
from app.text.catalogue import key_of, render, use_language
from kgdfa.gesture import Gesture
from logs import records
from tests.app.control.causes import CAUSES, Cause, E, rig_with, seen
from tests.app.control.rig import Rig


def test_every_row_has_its_test_and_every_event_its_row() -> None:
    assert set(CAUSES) == set(Event) == set(ROW)
    assert len(TABLE) == len(ROW)


@pytest.mark.parametrize("event", Event)
def test_the_event_happens_with_its_effect_and_is_told(event: Event) -> None:
    rig = rig_with(event)
    row = ROW[event]
    assert rig.state is not None
    raised = seen(rig, event)
    assert raised, rig.events()
    assert raised[0].effect == row.effect.name.lower()
    at_its_time = [state for state, _ in rig.history if any(one.event is event for one in state.events)]
    assert at_its_time
    assert at_its_time[0].effect >= row.effect


@pytest.mark.parametrize("event", [event for event in Event if ROW[event].effect >= Effect.HOLD])
def test_what_holds_or_damps_stops_every_wish_and_stays_until_acknowledged(event: Event) -> None:
    rig = rig_with(event)
    CAUSES[event].cure(rig)
    rig.tick(30)
    row = ROW[event]
    assert rig.state is not None
    if row.latch is Latch.NEVER:
        assert event in {E.SHUTTING_DOWN, E.SHUTDOWN_DAMPING}, "a hold or a damp is left only deliberately"
        return
    assert event.value in rig.events()
    refusals = rig.state.refusal_count
    rig.send(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
    rig.tick()
    assert rig.state.refusal_count == refusals + 1
    assert rig.state.running is None
    still = rig.command
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick(100)
    if event is not E.STOP_AGAIN and row.effect < Effect.DAMP and rig.state.motion.mode is not Mode.DISABLED:
        assert np.array_equal(rig.command.position_rad, still.position_rad), "acknowledging moves nothing"
    assert event.value not in rig.events()
    assert rig.state.gait.running is None


@pytest.mark.parametrize(
    "event",
    [event for event in Event if ROW[event].latch is Latch.NEVER and CAUSES[event].cure is not Cause.cure],
)
def test_what_does_not_latch_goes_with_its_condition(event: Event) -> None:
    rig = rig_with(event)
    assert event.value in rig.events()
    CAUSES[event].cure(rig)
    rig.tick(60)
    assert (event.value in rig.events()) is ROW[event].settles
    rig.tick(LINGER_NS // 2_000_000 + 60)
    assert event.value not in rig.events()
    assert rig.state is not None
    assert event not in {one.event for one in rig.state.events}
    assert [b for b in rig.audit if isinstance(b, records.EventCleared) and b.event == event.value]


@pytest.mark.parametrize(
    "event",  # a missing pre-flight is present in the tick of the wish alone: see test_step
    [event for event in Event if ROW[event].effect is Effect.REFUSE and event is not E.NO_PREFLIGHT],
)
@pytest.mark.parametrize("source", Source)
def test_what_refuses_refuses_whom_it_names_and_says_why(event: Event, source: Source) -> None:
    rig = rig_with(event)
    action, gesture = Action.STEP_RIGHT_FIRST, Gesture.ONE
    if CAUSES[event].fresh:
        action, gesture = Action.INITIALISE, Gesture.ZERO
    row = ROW[event]
    if source is Source.THERAPIST:
        rig.send(OperatorKind.ACT, action)
    elif event is E.PERCEPTION_TIMEOUT:
        rig.release(gesture)
        rig.tick(20)
        assert rig.state is not None
        assert rig.state.running is None
        return
    else:
        rig.release(gesture)
    rig.tick(18)
    assert rig.state is not None
    granted = rig.state.running is not None
    assert granted is (source not in row.blocks)
    if not granted:
        assert rig.state.refusal is not None
        assert rig.state.refusal.code == key_of(event) or not rig.watching


@pytest.mark.parametrize(
    "event", [event for event in Event if ROW[event].effect < Effect.HOLD and not CAUSES[event].fresh]
)
def test_of_what_stops_nothing_only_legs_far_from_their_pose_lose_their_state(event: Event) -> None:
    rig = rig_with(event)
    assert rig.state is not None
    assert (rig.state.gait.state is GaitState.BETWEEN) is (event is E.FAR_FROM_POSE)


@pytest.mark.parametrize("event", [event for event in Event if ROW[event].effect is Effect.NOTE])
def test_a_note_stops_nothing(event: Event) -> None:
    rig = rig_with(event)
    rig.send(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
    rig.tick()
    assert rig.state is not None
    assert rig.state.running is not None


@pytest.mark.parametrize("event", Event)
@pytest.mark.parametrize("code", ["en", "zh"])
def test_texts_say_what_happened_and_fit_the_screen(event: Event, code: str) -> None:
    use_language(code)
    (raised, *_) = [one for state, _ in rig_with(event).history for one in state.events if one.event is event]
    text = render(raised.reason)
    assert text[-1] in ".。"
    assert len(text) < 125


@pytest.mark.parametrize("event", [event for event in Event if ROW[event].latch is Latch.POWERED])
def test_before_the_drives_carry_power_nothing_waits_for_an_acknowledgement(event: Event) -> None:
    if event in {E.NEXT_STEP_MISSING, E.FAR_FROM_POSE, E.UNEXPECTED_MOTION, E.OVER_SPEED, E.OVER_TORQUE}:
        return  # can't come about without power
    rig = Rig()
    rig.tick(2)
    rig.send(OperatorKind.CONFIRM_PATIENT)
    rig.tick(200)
    assert rig.events() == {E.NOT_ARMED.value}
    CAUSES[event].make(rig)
    rig.tick(CAUSES[event].ticks)
    CAUSES[event].cure(rig)
    rig.tick(40)
    assert event.value not in rig.events()
