"""Guided tests as a state machine: every kind against every state, and any history that control may report."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from app.ipc.snapshot import ActionReport, ControlSnapshot
from app.ipc.states import LEVEL_WALKING, Action, Effect, Event, GaitState, Outcome, Source
from app.outcomes.guided import (
    PROCEDURES,
    UNOBSERVED_S,
    GuidedRefusal,
    GuidedRun,
    GuidedStop,
    GuidedTest,
    advance,
    begin,
    refusal_of,
    result_of,
    stop,
)
from logs.reason import key_of, reason
from testing.messages import JOINT, event

S_NS = 1_000_000_000
START_NS = 100 * S_NS
TEN, SIX, UP_AND_GO = GuidedTest


def snapshot(at_s: float = 0.0, **fields: object) -> ControlSnapshot:
    """Control at so many seconds after the start by key; it had walked before."""
    base = ControlSnapshot(
        incarnation=1,
        sequence=1,
        at_ns=START_NS + round(at_s * 1e9),
        state=GaitState.STANDING,
        effect=Effect.NOTE,
        armed=True,
        patient_confirmed=True,
        enabled=True,
        joints=(JOINT, JOINT, JOINT, JOINT),
        steps=7,
        distance_walked_m=2.1,
    )
    return replace(base, **fields)


def report(action: Action, *, first_motion_s: float = 0.0, ended_s: float = 0.0) -> ActionReport:
    """Of an action that runs, or is completed."""
    return ActionReport(
        number=1,
        action=action,
        source=Source.GESTURE,
        from_state=GaitState.STANDING,
        outcome=Outcome.COMPLETED if ended_s else Outcome.RUNNING,
        first_motion_ns=START_NS + round(first_motion_s * 1e9) if first_motion_s else 0,
        ended_ns=START_NS + round(ended_s * 1e9) if ended_s else 0,
    )


def walked(at_s: float, steps: int, *reports: ActionReport, **fields: object) -> ControlSnapshot:
    """So many steps of 0.3 m since the start."""
    return snapshot(at_s, steps=7 + steps, distance_walked_m=2.1 + 0.3 * steps, reports=reports, **fields)


WALK = report(Action.WALK, first_motion_s=4.0)


def follow(test: GuidedTest, *moments: ControlSnapshot) -> GuidedRun:
    run = begin(test, snapshot(), START_NS)
    for now in moments:
        run = advance(run, now, fresh=True)
    return run


@pytest.mark.parametrize(("test", "state"), list(product(GuidedTest, GaitState)))
def test_each_begins_in_one_state_only(test: GuidedTest, state: GaitState) -> None:
    refused = refusal_of(test, snapshot(state=state), fresh=True)
    procedure = PROCEDURES[test]
    assert refused is (None if state is procedure.begins_in else procedure.refusal)


@pytest.mark.parametrize("test", GuidedTest)
def test_none_begins_while_the_legs_move_or_are_held_or_nobody_answers(test: GuidedTest) -> None:
    able = snapshot(state=PROCEDURES[test].begins_in)
    assert refusal_of(test, able, fresh=True) is None
    assert refusal_of(test, replace(able, action=Action.STAND_UP), fresh=True) is GuidedRefusal.LEGS_MOVING
    for effect in Effect:
        wanted = GuidedRefusal.HELD if effect >= Effect.HOLD else None
        assert refusal_of(test, replace(able, effect=effect), fresh=True) is wanted
    assert refusal_of(test, able, fresh=False) is GuidedRefusal.CONTROL_SILENT
    assert refusal_of(test, None, fresh=True) is GuidedRefusal.CONTROL_SILENT


@pytest.mark.parametrize("action", Action)
def test_the_clock_of_a_walk_starts_with_its_first_motion(action: Action) -> None:
    run = follow(TEN, walked(6.0, 0, report(action, first_motion_s=4.5)))
    assert run.duration_s == pytest.approx(1.5 if action in LEVEL_WALKING else 0.0)


def test_an_action_before_the_start_starts_no_clock() -> None:
    assert follow(SIX, walked(6.0, 0, report(Action.WALK, first_motion_s=-3.0, ended_s=-1.0))).began_ns == 0


def test_ten_metres_end_with_the_step_that_completes_them() -> None:
    before = follow(TEN, walked(5.0, 0, WALK), walked(70.0, 33, WALK), walked(71.95, 33, WALK))
    assert not before.ended
    assert before.remaining_m == pytest.approx(0.1)
    run = advance(before, walked(72.0, 34, WALK), fresh=True)
    result = result_of(run)
    assert (result.outcome, result.reason, result.steps) == ("completed", None, 34)
    assert result.distance_m == pytest.approx(10.2)
    assert result.duration_s == pytest.approx(68.0)
    assert result.speed_m_s == pytest.approx(10.2 / 68.0)
    assert advance(run, walked(99.0, 50, WALK), fresh=True) is run
    assert stop(run, reason(GuidedStop.BY_KEY)) is run


def test_ten_metres_of_even_steps_need_no_further_one() -> None:
    now = snapshot(50.0, steps=47, distance_walked_m=2.1 + sum([0.25] * 40), reports=(WALK,))
    assert follow(TEN, walked(49.95, 30, WALK), now).outcome is Outcome.COMPLETED


def test_six_minutes_end_by_the_clock_and_count_no_later_step() -> None:
    before = follow(SIX, walked(5.0, 0, WALK), walked(363.99, 120, WALK))
    assert not before.ended
    assert before.remaining_s == pytest.approx(0.01)
    result = result_of(advance(before, walked(364.04, 121, WALK), fresh=True))
    assert (result.outcome, result.steps, result.duration_s) == ("completed", 120, 360.0)
    assert result.distance_m == pytest.approx(36.0)
    assert result.ended_ns == START_NS + 364 * S_NS


def test_ten_metres_whose_end_nobody_observed_are_not_completed() -> None:
    """A console that stood still: its own pause had become the patient's time."""
    before = follow(TEN, walked(4.2, 0, WALK), walked(5.2, 33, WALK))
    result = result_of(advance(before, walked(10.2, 34, WALK), fresh=True))
    assert (result.outcome, result.reason) == ("stopped", reason(GuidedStop.NOT_OBSERVED, gap_s=5.0))
    assert (result.steps, result.ended_ns) == (33, before.at_ns)
    assert result.duration_s == pytest.approx(1.2)


@pytest.mark.parametrize(("steps", "outcome"), [(704, Outcome.STOPPED), (700, Outcome.COMPLETED)])
def test_six_minutes_whose_last_steps_nobody_observed_are_not_completed(steps: int, outcome: Outcome) -> None:
    run = follow(SIX, walked(5.0, 0, WALK), walked(360.0, 700, WALK), walked(368.0, steps, WALK))
    assert (run.outcome, run.steps) == (outcome, 700), "without a step in that time nothing is unknown"


def test_up_and_go_whose_end_nobody_observed_has_its_time_from_control() -> None:
    sat = report(Action.SIT_DOWN, first_motion_s=60.0, ended_s=65.3)
    run = follow(UP_AND_GO, walked(58.0, 19, WALK), walked(70.0, 20, WALK, sat, state=GaitState.SITTING))
    assert run.outcome is Outcome.COMPLETED
    assert run.duration_s == pytest.approx(65.3)


@pytest.mark.parametrize(("test", "end_s"), [(TEN, 72.0), (SIX, 364.04)])
def test_a_time_without_snapshots_in_the_middle_of_a_walk_does_no_harm(test: GuidedTest, end_s: float) -> None:
    early, late = (walked(at_s, steps, WALK) for at_s, steps in ((5.0, 1), (30.0, 20)))
    run = follow(test, early, late, walked(end_s - 0.05, 33, WALK), walked(end_s, 34, WALK))
    assert run.outcome is Outcome.COMPLETED


def test_six_minutes_go_on_through_a_rest() -> None:
    sat = report(Action.SIT_DOWN, first_motion_s=90.0, ended_s=95.0)
    run = follow(SIX, walked(80.0, 20, WALK), walked(120.0, 20, WALK, sat, state=GaitState.SITTING))
    assert not run.ended
    assert run.duration_s == pytest.approx(116.0)


def test_up_and_go_is_timed_from_its_key_to_sitting_again() -> None:
    sat = report(Action.SIT_DOWN, first_motion_s=60.0, ended_s=65.3)
    run = follow(UP_AND_GO, walked(2.0, 0, state=GaitState.SITTING), walked(58.0, 20, WALK))
    assert (run.ended, run.remaining_m) == (False, 0.0)
    assert run.duration_s == pytest.approx(58.0)
    result = result_of(advance(run, walked(65.34, 20, WALK, sat, state=GaitState.SITTING), fresh=True))
    assert (result.outcome, result.speed_m_s) == ("completed", None)
    assert result.duration_s == pytest.approx(65.3)


def test_up_and_go_that_sits_too_early_is_not_completed() -> None:
    sat = report(Action.SIT_DOWN, first_motion_s=20.0, ended_s=25.0)
    run = follow(UP_AND_GO, walked(25.1, 10, WALK, sat, state=GaitState.SITTING))
    assert run.stopped_by == reason(GuidedStop.SAT_DOWN_EARLY, distance_m=run.distance_m, wanted_m=6.0)
    stopped = replace(sat, outcome=Outcome.STOPPED)  # a sitting down that was stopped is none
    assert not follow(UP_AND_GO, walked(25.1, 10, WALK, stopped)).ended


@pytest.mark.parametrize(
    ("test", "held"), list(product(GuidedTest, (Event.STOP, Event.JOINT_TIMEOUT, Event.SHUTTING_DOWN)))
)
def test_a_hold_ends_it_with_the_event_that_came_first(test: GuidedTest, held: Event) -> None:
    events = (
        event(Event.NOT_ARMED, Effect.REFUSE, START_NS),
        event(Event.STOP_AGAIN, Effect.DAMP, START_NS + 9 * S_NS),
        event(held, Effect.HOLD, START_NS + 8 * S_NS),
    )
    result = result_of(follow(test, walked(10.0, 3, WALK, effect=Effect.DAMP, events=events)))
    assert (result.outcome, result.steps) == ("stopped", 3)
    assert result.reason == reason(held)


@pytest.mark.parametrize("effect", [Effect.NOTE, Effect.REFUSE, Effect.PAUSE])
def test_what_does_not_hold_the_legs_ends_nothing(effect: Effect) -> None:
    events = (event(Event.CONSOLE_TIMEOUT, effect, START_NS),)
    assert not follow(TEN, walked(10.0, 3, WALK, effect=effect, events=events)).ended


@pytest.mark.parametrize(("since_s", "outcome"), [(363.9, Outcome.STOPPED), (364.01, Outcome.COMPLETED)])
def test_a_hold_at_the_end_counts_only_if_it_came_before(since_s: float, outcome: Outcome) -> None:
    held = (event(Event.STOP, Effect.HOLD, START_NS + round(since_s * 1e9)),)
    run = follow(SIX, walked(363.99, 9, WALK), walked(364.04, 9, WALK, effect=Effect.HOLD, events=held))
    assert run.outcome is outcome


@pytest.mark.parametrize("test", GuidedTest)
def test_a_control_that_is_silent_or_new_ends_it(test: GuidedTest) -> None:
    run = follow(test, walked(10.0, 3, WALK))
    for now, fresh, why in (
        (None, True, GuidedStop.CONTROL_SILENT),
        (walked(11.0, 4), False, GuidedStop.CONTROL_SILENT),
        (snapshot(11.0, incarnation=2, steps=0, distance_walked_m=0.0), True, GuidedStop.CONTROL_RESTARTED),
    ):
        ended = advance(run, now, fresh=fresh)
        assert (ended.stopped_by, ended.steps) == (reason(why), 3)


def test_a_test_that_never_began_has_no_time() -> None:
    result = result_of(stop(follow(TEN, walked(9.0, 0)), reason(GuidedStop.BY_KEY)))
    assert (result.began_ns, result.duration_s, result.distance_m, result.speed_m_s) == (0, 0.0, 0.0, None)


@st.composite
def histories(draw: st.DrawFn) -> list[tuple[ControlSnapshot, bool]]:
    """Snapshots in any order of time, with walks, seats, holds, silence and restarts."""
    found = []
    steps, at_s, motion_s = 0, 0.0, draw(st.floats(0.1, 20.0))
    for _ in range(draw(st.integers(1, 30))):
        at_s += draw(st.floats(-1.0, 60.0) | st.floats(0.0, 0.1))
        steps += draw(st.integers(0, 12))
        reports = [report(Action.WALK, first_motion_s=motion_s)] if at_s >= motion_s else []
        if at_s > 1.0 and draw(st.booleans()):
            reports.append(report(Action.SIT_DOWN, first_motion_s=at_s - 1.0, ended_s=at_s))
        effect = draw(st.sampled_from([*Effect, *[Effect.NOTE] * 20]))
        events = (event(Event.STOP, effect, START_NS + round(at_s * 1e9)),) if draw(st.booleans()) else ()
        incarnation = draw(st.sampled_from([1] * 20 + [2]))
        now = walked(at_s, steps, *reports, effect=effect, events=events, incarnation=incarnation)
        found.append((now, draw(st.integers(0, 20)) > 0))
    return found


@given(st.sampled_from(GuidedTest), histories())
def test_any_history_keeps_the_rules(test: GuidedTest, history: list[tuple[ControlSnapshot, bool]]) -> None:
    run = begin(test, snapshot(), START_NS)
    for now, fresh in history:
        before, run = run, advance(run, now, fresh=fresh)
        assert run.at_ns >= before.at_ns
        assert run.steps >= before.steps
        assert run.distance_m >= before.distance_m
        assert run.began_ns == before.began_ns or not before.began_ns
        assert run.ended is (run.outcome is not Outcome.RUNNING)
        if before.ended:
            assert run is before
        if run.ended and not before.ended:
            _ended_rightly(run, now, fresh=fresh)
    result = result_of(run)
    assert result.duration_s >= 0
    assert result.distance_m >= 0
    assert (result.reason is None) is (run.outcome is not Outcome.STOPPED)


def _ended_rightly(run: GuidedRun, now: ControlSnapshot, *, fresh: bool) -> None:
    procedure = run.procedure
    if run.outcome is Outcome.COMPLETED:
        assert fresh
        assert run.began_ns
        assert run.remaining_m in {None, 0.0}
        assert procedure.limit_s is None or run.duration_s == pytest.approx(procedure.limit_s)
        return
    assert run.stopped_by is not None
    code = run.stopped_by.code
    if not fresh:
        assert code == key_of(GuidedStop.CONTROL_SILENT)
    elif now.incarnation != run.incarnation:
        assert code == key_of(GuidedStop.CONTROL_RESTARTED)
    else:
        if code == key_of(GuidedStop.NOT_OBSERVED):
            assert now.at_ns - run.at_ns > UNOBSERVED_S * 1e9
            return
        early = code == key_of(GuidedStop.SAT_DOWN_EARLY)
        assert early is (now.effect < Effect.HOLD)
        assert not early or (procedure.until_seated and run.remaining_m)
