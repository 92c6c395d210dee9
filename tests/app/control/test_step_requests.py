"""Which action requests are granted, by gesture and by key, in every state and every movement."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from app.ipc.messages import OperatorCommand
from app.ipc.states import GESTURE_OF, Action, Event, GaitState, Outcome, RequestRefusal, Source
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import reason
from tests.app.control.moments import GRANTED, RESTS, A, K, S, moving, now, records_of, request, resting, standing
from tests.app.control.rig import Rig


@pytest.mark.parametrize("armed", [True, False])
@pytest.mark.parametrize("source", Source)
@pytest.mark.parametrize("action", Action)
@pytest.mark.parametrize("state", RESTS)
def test_at_rest_the_table_and_the_arming_decide(state: GaitState, action: Action, source: Source, armed: bool) -> None:
    rig = resting(state)
    if not armed:
        rig.send(K.DISARM)
        rig.tick()
    before = now(rig).refusal_count
    request(rig, action, source)
    rig.tick(20)
    wanted = action in GRANTED[state] and (armed or source is Source.THERAPIST)
    assert (now(rig).running is not None) is wanted
    assert now(rig).refusal_count == before + (not wanted)
    commands = records_of(rig, records.Command)
    assert len(commands) == wanted
    if wanted:
        command = commands[0]
        assert command.source == source.value
        assert command.gesture == (GESTURE_OF[action].value if source is Source.GESTURE else None)
        if action is A.WALK:
            rig.send(K.ACT, A.WALK_END)
        done = rig.settle()
        assert done.gait.state is not state or action in {A.WALK, A.STAIR_UP, A.STAIR_DOWN, A.OBSTACLE}
        assert done.reports[-1].outcome is Outcome.COMPLETED
    else:
        assert now(rig).refusal
        assert records_of(rig, records.Refusal)


@pytest.mark.parametrize("source", Source)
@pytest.mark.parametrize("action", Action)
@pytest.mark.parametrize("running", [A.STEP_RIGHT_FIRST, A.STAIR_UP, A.OBSTACLE, A.STAIR_DOWN, A.SIT_DOWN, A.WALK])
def test_during_a_movement_only_the_end_of_a_walk_is_received(running: Action, action: Action, source: Source) -> None:
    rig = moving(running)
    path = rig.command.position_rad
    request(rig, action, source)
    rig.tick(18)
    if (running, action) == (A.WALK, A.WALK_END):
        assert now(rig).gait.closing
        assert rig.settle().gait.state is S.STANDING
        assert [report.outcome for report in now(rig).reports[-2:]] == [Outcome.COMPLETED, Outcome.COMPLETED]
    else:
        assert now(rig).gait.running is running
        assert now(rig).refusal_count == 0
        assert not now(rig).gait.closing
        assert not np.array_equal(rig.command.position_rad, path), "the movement goes on"
        assert records_of(rig, records.Refusal)


def test_a_release_acts_once_however_often_it_is_reported() -> None:
    rig = standing()
    rig.release(Gesture.ONE)
    rig.settle()
    rig.tick(20)
    rig.settle()
    rig.tick(500)
    assert len(records_of(rig, records.Command)) == 1
    assert now(rig).refusal_count == 0
    assert not records_of(rig, records.Refusal)


def test_a_count_that_falls_and_grows_again_commands_once_and_refuses_nothing() -> None:
    rig = standing()
    rig.release(Gesture.ONE)
    rig.tick(20)
    rig.settle()
    for released in ({"release_count": 0, "released_gesture": None, "released_ns": 0}, {}):
        rig.report = released
        rig.tick(40)
    assert len(records_of(rig, records.Command)) == 1
    assert not records_of(rig, records.Refusal)
    rig.release(Gesture.FOUR)
    rig.tick(20)
    assert len(records_of(rig, records.Command)) == 2


@pytest.mark.parametrize(
    ("age_ms", "acts"), [(30, True), (160, True), (204, False), (900, False), (-40, True), (-90, False)]
)
def test_a_stale_release_never_acts(age_ms: float, acts: bool) -> None:
    rig = standing()
    rig.tick(17 - (rig.now_ns % 34_000_000) // 2_000_000)  # the next tick brings a report
    rig.release(Gesture.ONE, age_ms=age_ms)
    rig.tick(40)
    rig.settle()
    assert bool(records_of(rig, records.Command)) is acts


def test_a_release_made_while_disarmed_never_acts_later() -> None:
    rig = standing()
    rig.send(K.DISARM)
    rig.tick()
    rig.release(Gesture.ONE)
    rig.tick(20)
    assert now(rig).refusal == reason(Event.NOT_ARMED)
    rig.send(K.ARM)
    rig.tick(500)
    assert not records_of(rig, records.Command)


def test_a_release_made_just_before_the_arming_does_not_act() -> None:
    rig = standing()
    rig.send(K.DISARM)
    rig.tick()
    rig.send(K.ARM)
    rig.release(Gesture.ONE, age_ms=10)
    rig.tick(30)
    assert not records_of(rig, records.Command)
    assert now(rig).refusal == reason(RequestRefusal.RELEASED_BEFORE_ARMING)


HELD_MS = [(100, True), (400, False)]  # released 240 ms after a moment: the first press began after it


@pytest.mark.parametrize(("held_ms", "acts"), HELD_MS)
def test_a_press_that_began_before_the_arming_commands_nothing_after_it(held_ms: float, acts: bool) -> None:
    rig = standing()
    rig.send(K.DISARM)
    rig.tick()
    rig.send(K.ARM)
    rig.tick(120)
    rig.release(Gesture.ONE, held_ms=held_ms)
    rig.tick(20)
    judge(rig, held_ms, acts)


@pytest.mark.parametrize(("held_ms", "acts"), HELD_MS)
def test_a_press_that_began_before_an_acknowledgement_commands_nothing_after_it(held_ms: float, acts: bool) -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.tick(300)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(120)
    rig.release(Gesture.ONE, held_ms=held_ms)
    rig.tick(20)
    judge(rig, held_ms, acts)


@pytest.mark.parametrize(("held_ms", "acts"), HELD_MS)
def test_a_press_that_began_before_the_patient_was_confirmed_commands_nothing_after_it(
    held_ms: float, acts: bool
) -> None:
    rig = armed_before_the_patient_was_confirmed()
    rig.release(Gesture.ZERO, held_ms=held_ms)
    rig.tick(20)
    judge(rig, held_ms, acts)


def test_a_second_confirmation_ends_no_press_and_none_arms() -> None:
    rig = armed_before_the_patient_was_confirmed()
    rig.send(K.CONFIRM_PATIENT)
    rig.tick(20)
    rig.release(Gesture.ZERO, held_ms=100)
    rig.tick(20)
    assert len(records_of(rig, records.Command)) == 1
    assert [one.armed for one in records_of(rig, records.Arming)] == [True, True]
    disarmed = Rig()
    disarmed.send(K.CONFIRM_PATIENT)
    disarmed.tick(2)
    assert not now(disarmed).armed_ns
    assert not records_of(disarmed, records.Arming)


def armed_before_the_patient_was_confirmed() -> Rig:
    """240 ms after the confirmation."""
    rig = Rig()
    rig.tick(2)
    rig.send(K.ARM)
    rig.tick(300)
    rig.send(K.CONFIRM_PATIENT)
    rig.tick(120)
    return rig


def judge(rig: Rig, held_ms: float, acts: bool) -> None:
    answers: list[records.Command | records.Refusal] = [*records_of(rig, records.Command)]
    answers += records_of(rig, records.Refusal)
    assert [one.released_ns - one.pressed_ns for one in answers] == [held_ms * 1_000_000]
    assert bool(records_of(rig, records.Command)) is acts
    assert now(rig).refusal == (None if acts else reason(RequestRefusal.RELEASED_BEFORE_ARMING))


def test_an_acknowledgement_of_nothing_ends_no_press_and_none_arms() -> None:
    rig = standing()
    rig.send(K.ACKNOWLEDGE)
    rig.tick(120)
    rig.release(Gesture.ONE, held_ms=400)
    rig.tick(20)
    assert len(records_of(rig, records.Command)) == 1
    rig.settle()
    rig.send(K.DISARM)
    rig.send(K.STOP)
    rig.tick(300)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert [one.accepted for one in records_of(rig, records.Acknowledgement)] == [False, True]
    assert not now(rig).armed_ns


def test_a_perception_that_restarts_repeats_nothing_and_is_received_again() -> None:
    rig = standing()
    rig.release(Gesture.ONE)
    rig.tick(20)
    rig.settle()
    rig.restart_perception()
    rig.tick(300)
    assert len(records_of(rig, records.Command)) == 1
    rig.release(Gesture.FOUR)
    rig.tick(20)
    rig.settle()
    assert len(records_of(rig, records.Command)) == 2
    assert now(rig).gait.state is S.STANDING


def test_the_first_report_of_a_restarted_perception_may_bring_a_release() -> None:
    rig = standing()
    rig.restart_perception()
    rig.release(Gesture.ONE)
    rig.tick(20)
    assert now(rig).running is not None


@pytest.mark.parametrize("restarted", [False, True])
def test_a_report_received_again_or_of_an_earlier_perception_is_dropped(restarted: bool) -> None:
    """Even while the frame that it released is fresh, and whatever its counts are."""
    rig = standing()
    rig.incarnation += 1
    rig.release(Gesture.ONE)
    rig.tick(20)
    rig.settle()
    heard = now(rig).streams.report
    assert heard is not None
    again = msgspec.structs.replace(heard, release_count=heard.release_count + 1, released_ns=rig.now_ns)
    if restarted:
        again = msgspec.structs.replace(again, incarnation=heard.incarnation - 1, sequence=heard.sequence + 1)
    rig.spoil = {"report": again}
    rig.tick()
    assert now(rig).streams.report == heard
    assert Event.MESSAGE_REJECTED.value in rig.events()
    rig.settle()
    assert len(records_of(rig, records.Command)) == 1


def test_a_command_received_again_does_nothing() -> None:
    rig = standing()
    act = OperatorCommand(sequence=rig._sequence + 1, kind=K.ACT, sent_ns=rig.now_ns, action=Action.STEP_RIGHT_FIRST)
    rig.spoil = {"commands": (act, act)}
    rig.tick()
    rig.spoil = {"commands": (act,)}
    rig.tick()
    assert len(records_of(rig, records.Command)) == 1
    assert now(rig).refusal_count == 0
    assert not records_of(rig, records.Refusal)


def test_a_release_without_a_gesture_is_no_request() -> None:
    rig = standing()
    rig.release(Gesture.ONE)
    rig._released = None
    rig.tick(30)
    assert now(rig).refusal_count == 0
    assert now(rig).running is None


def test_an_act_without_an_action_is_no_request_and_old_commands_act_once() -> None:
    rig = standing()
    rig.send(K.ACT)
    rig.tick(2)
    assert now(rig).refusal_count == 0
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    word = rig._commands[-1]
    rig.tick(2)
    rig.settle()
    rig._commands.append(word)
    rig.tick(5)
    assert len(records_of(rig, records.Command)) == 1
    assert now(rig).refusal_count == 0


def test_without_a_preflight_an_action_is_refused_and_others_are_not() -> None:
    rig = standing()
    rig.cleared = frozenset({A.STEP_RIGHT_FIRST, A.WALK})
    rig.send(K.ACT, A.STAIR_UP)
    rig.tick(2)
    assert now(rig).running is None
    assert now(rig).refusal == reason(Event.NO_PREFLIGHT)
    rig.send(K.ACT, A.WALK)
    rig.tick(60)
    assert now(rig).gait.running is A.WALK
    rig.send(K.ACT, A.WALK_END)
    rig.tick(2)
    assert now(rig).gait.closing, "ending a walk needs no pre-flight"


@pytest.mark.parametrize("source", Source)
@pytest.mark.parametrize("action", Action)
@pytest.mark.parametrize("running", [A.WALK, A.STAIR_UP])
def test_during_a_movement_a_request_without_preflight_is_ignored_as_every_other(
    running: Action, action: Action, source: Source
) -> None:
    rig = moving(running)
    rig.cleared = frozenset({running})
    request(rig, action, source)
    rig.tick(18)
    assert Event.NO_PREFLIGHT.value not in {one.event.value for one in now(rig).events}
    assert now(rig).gait.running is running
    assert now(rig).gait.closing is ((running, action) == (A.WALK, A.WALK_END))
    assert now(rig).refusal_count == 0


def test_a_refusal_is_shown_until_the_next_request_is_granted() -> None:
    rig = standing()
    request(rig, A.STEP_LEFT, Source.THERAPIST)
    rig.tick(3)
    assert now(rig).refusal
    request(rig, A.STEP_RIGHT_FIRST, Source.THERAPIST)
    rig.tick(3)
    assert now(rig).running is not None
    assert now(rig).refusal is None


@pytest.mark.parametrize("source", Source)
def test_an_action_whose_plan_came_too_late_is_refused_and_the_next_one_begins(source: Source) -> None:
    rig = standing()
    rig.planning = False
    request(rig, A.STEP_RIGHT_FIRST, source)
    rig.tick(260)
    report = now(rig).reports[-1]
    assert (report.outcome, report.reason) == (Outcome.REFUSED, reason(RequestRefusal.PLANNER_TIMEOUT))
    assert now(rig).gait.state is GaitState.STANDING
    rig.planning = True
    request(rig, A.STEP_RIGHT_FIRST, source)
    rig.tick(60)
    assert now(rig).gait.running is A.STEP_RIGHT_FIRST
