"""Pauses: what waits, how it goes on, when it becomes a hold, and that nothing starts by it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.control.events.programs import CONTROL_STALLED_MS
from app.control.events.row import Latch
from app.control.events.table import ROW
from app.control.pause import LIMIT_NS
from app.control.running_action import Stage
from app.ipc.states import Action, Effect, Event, GaitState, Outcome, PauseCause
from app.ipc.streams import HEARTBEAT
from app.motion.follower import Mode
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import key_of, reason
from tests.app.control.causes import CAUSES
from tests.app.control.moments import HOLD_TICKS, A, K, S, moving, now, records_of, resting, standing
from tests.app.control.rig import Rig
from tests.app.control.test_step_stop import MOVEMENTS

TICKS_PER_S = 500
SPEED_RAD_S = Rig().settings.limits.speed_rad_s
PAUSING = [event for event, row in ROW.items() if row.effect is Effect.PAUSE]


def silence(rig: Rig, ticks: int) -> None:
    """The console's heartbeat stays out for so many ticks beyond its limit."""
    rig.alive = False
    rig.run_until(lambda _: Event.CONSOLE_TIMEOUT.value in rig.events(), 150)
    rig.tick(ticks)
    rig.alive = True


def stall(rig: Rig, ms: int) -> None:
    """Control is kept from its core."""
    rig.now_ns += ms * 1_000_000
    rig.spoil.update(late_ns=ms * 1_000_000, missed_ticks=ms // 2)
    rig.tick()


def to_its_end(rig: Rig, watch: Callable[[Rig], None] = lambda _: None) -> Outcome:
    """How the running action ends; the guard refuses nothing and the command never jumps meanwhile."""
    number = now(rig).number
    for _ in range(4000):
        before = rig.command
        rig.tick()
        watch(rig)
        assert rig._refusal is None
        assert (np.abs(rig.command.position_rad - before.position_rad) <= SPEED_RAD_S / TICKS_PER_S + 1e-9).all()
        assert (np.abs(rig.command.velocity_rad_s) <= SPEED_RAD_S).all()
        if now(rig).running is None:
            break
    return next(report.outcome for report in now(rig).reports if report.number == number)


def test_after_a_tick_whose_command_was_withheld_the_legs_stay_where_they_stand() -> None:
    rig = moving()
    rig.run_until(lambda state: state.motion.progress > 0.4)
    written = rig.command
    rig.withhold = True
    rig.tick()
    assert rig.command is written
    stall(rig, 62)
    assert Event.CONTROL_STALLED.value in rig.events()
    assert np.array_equal(rig.command.position_rad, written.position_rad)
    rig.tick(5)
    assert Event.GUARD_REFUSAL.value not in rig.events()


def test_what_pauses_is_only_timing_and_waits_for_no_acknowledgement() -> None:
    assert {event.value for event in PAUSING} == {cause.value for cause in PauseCause}, "PauseCause, app/ipc/states.py"
    assert all(ROW[event].latch is Latch.NEVER for event in PAUSING)
    assert (ROW[Event.PAUSE_TOO_LONG].effect, ROW[Event.PAUSE_TOO_LONG].latch) == (Effect.HOLD, Latch.POWERED)


@pytest.mark.parametrize("event", PAUSING)
def test_legs_that_move_pause_for_every_event_that_pauses(event: Event) -> None:
    rig = moving(A.WALK)
    CAUSES[event].make(rig)
    rig.run_until(lambda m: m.pause is not None, CAUSES[event].ticks)
    pause = now(rig).pause
    assert pause is not None
    assert pause.cause.value == event.value
    assert now(rig).effect is Effect.PAUSE


def test_the_guardian_acts_later_than_control_gives_up() -> None:
    two_ticks_ms = 4.0  # between two heartbeats
    assert CONTROL_STALLED_MS + two_ticks_ms < HEARTBEAT.stale_ms


def test_an_unresponsive_console_pauses_the_legs_and_they_continue_when_it_answers() -> None:
    rig = moving()
    silence(rig, HOLD_TICKS + 50)
    assert now(rig).effect is Effect.PAUSE
    assert now(rig).motion.path_rate == 0
    assert now(rig).motion.mode is Mode.MOVING
    assert rig.command.velocity_rad_s.tolist() == [0.0] * 4
    assert to_its_end(rig) is Outcome.COMPLETED
    assert now(rig).gait.state is S.RIGHT_FORWARD
    assert not any(one.latched for one in now(rig).events)


@pytest.mark.parametrize("ms", [22, 36, 50])
def test_a_late_control_slows_the_legs_and_continues(ms: int) -> None:
    rig = moving()
    before = now(rig).motion
    stall(rig, ms)
    assert now(rig).effect is Effect.PAUSE
    assert now(rig).motion.path_rate == pytest.approx(1 - (1 + ms // 2) / HOLD_TICKS)
    assert now(rig).motion.row > before.row
    assert to_its_end(rig) is Outcome.COMPLETED
    (pause,) = records_of(rig, records.Pause)
    assert (pause.cause, pause.action, pause.state, pause.resumed) == (
        Event.CONTROL_LATE.value,
        A.STEP_RIGHT_FIRST.value,
        S.STANDING.value,
        True,
    )
    assert pause.duration_s == pytest.approx((ms + 2) / 1000)
    assert 0 < pause.progress < 1
    assert (now(rig).pauses.count, now(rig).pauses.cause) == (1, PauseCause.CONTROL_LATE)
    assert now(rig).pauses.total_s == now(rig).pauses.duration_s == pause.duration_s


def test_a_control_that_was_late_for_longer_holds() -> None:
    rig = moving()
    stall(rig, 52)
    assert now(rig).effect is Effect.HOLD
    assert now(rig).gait.state is S.BETWEEN


def test_a_walk_waits_for_its_next_step_and_continues_with_it() -> None:
    rig = moving(A.WALK)
    rig.answer_ticks = 350
    rig.run_until(lambda m: m.effect is Effect.PAUSE)
    assert now(rig).pause is not None
    rig.run_until(lambda m: m.effect is not Effect.PAUSE)
    rig.answer_ticks = 1
    assert now(rig).gait.walking
    rig.send(K.ACT, A.WALK_END)
    assert to_its_end(rig) is Outcome.COMPLETED
    assert now(rig).gait.state is S.STANDING


def test_a_pause_of_more_than_a_second_becomes_a_hold_that_waits_for_its_acknowledgement() -> None:
    rig = moving()
    rig.alive = False
    rig.run_until(lambda m: m.effect is Effect.PAUSE)
    began_ns = rig.now_ns
    rig.run_until(lambda m: m.effect is Effect.HOLD)
    assert rig.now_ns - began_ns == LIMIT_NS + 2_000_000
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).reports[-1].reason == reason(Event.PAUSE_TOO_LONG)
    assert not now(rig).pauses.resumed
    rig.alive = True
    rig.tick(700)
    assert rig.events() == {Event.PAUSE_TOO_LONG.value}
    rig.send(K.ACKNOWLEDGE)
    rig.tick(100)
    assert rig.events() == set()
    assert now(rig).running is None, "acknowledging starts nothing"


def test_a_chain_of_short_pauses_is_not_endless() -> None:
    rig = moving(A.WALK)
    held_ns = rig.now_ns
    for _ in range(40):
        stall(rig, 50)
        rig.tick(20)
        if now(rig).effect is Effect.HOLD:
            break
    assert Event.PAUSE_TOO_LONG.value in rig.events()
    assert rig.now_ns - held_ns < 2_500_000_000


def test_pauses_far_apart_are_not_added() -> None:
    rig = moving(A.WALK)
    for _ in range(4):
        silence(rig, 300)
        rig.tick(1000)
    assert now(rig).gait.walking
    assert now(rig).pauses.count == 4


@pytest.mark.parametrize("state", [S.UNPOWERED, S.STANDING, S.SITTING])
def test_at_rest_a_pause_only_refuses_and_leaves_nothing_to_acknowledge(state: GaitState) -> None:
    rig = resting(state)
    before = rig.command
    rig.alive = False
    rig.tick(150)
    rig.release(Gesture.ZERO if state is S.UNPOWERED else Gesture.ONE)
    rig.tick(1000)
    assert now(rig).running is None
    assert now(rig).refusal_count == 1
    assert now(rig).refusal == reason(Event.CONSOLE_TIMEOUT)
    rig.alive = True
    rig.tick(600)
    assert rig.events() == set()
    assert rig.command is before
    assert now(rig).pauses.count == 0


def test_in_a_pause_a_request_is_refused_with_its_event_and_never_carried_out_later() -> None:
    rig = standing()
    rig.alive = False
    rig.tick(140)
    rig.release(Gesture.ONE)
    rig.tick(30)
    rig.alive = True
    rig.tick(300)
    assert now(rig).refusal == reason(Event.CONSOLE_TIMEOUT)
    assert now(rig).running is None


@pytest.mark.parametrize("ticks", [10, 400])
def test_an_action_that_has_not_moved_begins_soon_after_the_pause_or_not_at_all(ticks: int) -> None:
    rig = standing()
    rig.alive = False
    rig.run_until(lambda m: rig.now_ns - m.streams.console_ns > 226_000_000)
    rig.release(Gesture.ONE)
    rig.answer_ticks = 25
    rig.run_until(lambda m: m.running is not None or m.refusal_count > 0, 20)
    if now(rig).running is None:  # the pause was first
        return
    rig.run_until(lambda m: m.effect is Effect.PAUSE)
    before = rig.command
    rig.tick(ticks)
    assert rig.command is before
    rig.alive = True
    rig.run_until(lambda m: m.running is None or m.running.stage is Stage.MOVING, 100)
    assert (now(rig).running is None) is (ticks == 400)


@pytest.mark.parametrize("ticks", [1, 40, 90])
def test_stop_in_a_pause_holds_and_the_pause_does_not_bring_the_legs_back(ticks: int) -> None:
    rig = moving()
    silence(rig, ticks)
    rig.send(K.STOP)
    rig.tick()
    assert now(rig).effect is Effect.HOLD
    assert now(rig).gait.state is S.BETWEEN
    rig.tick(HOLD_TICKS + 1)
    assert now(rig).motion.mode is Mode.HOLDING
    held = rig.command
    rig.tick(300)
    assert rig.command is held
    (pause,) = records_of(rig, records.Pause)
    assert not pause.resumed
    rig.send(K.ACKNOWLEDGE)
    rig.tick(50)
    assert rig.events() == set()
    assert now(rig).running is None


def test_an_acknowledgement_in_a_pause_finds_nothing_to_acknowledge_and_changes_nothing() -> None:
    rig = moving()
    silence(rig, 60)
    rig.alive = False
    rig.send(K.ACKNOWLEDGE, age_ms=300)
    rig.tick()
    assert now(rig).effect is Effect.PAUSE
    (acknowledgement,) = records_of(rig, records.Acknowledgement)
    assert not acknowledgement.accepted


def test_a_walk_outlives_a_camera_that_is_late_for_less_than_a_second() -> None:
    rig = standing()
    rig.release(Gesture.FIVE)
    rig.run_until(lambda m: m.gait.walking and m.motion.mode is Mode.MOVING)
    rig.watching = False
    rig.tick(500)
    assert Event.CAMERA_STALE.value in rig.events()
    assert not now(rig).gait.closing
    rig.watching = True
    rig.tick(600)
    assert now(rig).gait.walking
    rig.watching = False
    rig.run_until(lambda m: m.gait.closing, 700)
    assert to_its_end(rig) is Outcome.COMPLETED
    why = now(rig).reports[-1].reason
    assert why is not None
    assert why.code in {key_of(Event.PERCEPTION_TIMEOUT), key_of(Event.CAMERA_STALE)}


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    movement=st.sampled_from(MOVEMENTS),
    wait=st.integers(0, 180),
    causes=st.lists(st.tuples(st.booleans(), st.integers(1, 24), st.integers(1, 60)), min_size=1, max_size=3),
)
def test_every_action_ends_where_it_was_commanded_to_whatever_pauses_it(
    movement: tuple[GaitState, Action], wait: int, causes: list[tuple[bool, int, int]]
) -> None:
    state, action = movement
    calm = resting(state)
    calm.send(K.ACT, action)
    calm.run_until(lambda m: m.running is not None)
    rig = resting(state)
    rig.send(K.ACT, action)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.tick(wait)
    for late, size, gap in causes:
        if now(rig).running is None:
            break
        if late:
            stall(rig, 2 * size)
        else:
            silence(rig, size)
        rig.tick(gap)
        assert rig._refusal is None
    if now(rig).running is not None:
        if action is A.WALK:
            rig.send(K.ACT, A.WALK_END)
            rig.tick(60)
            rig.send(K.ACT, A.WALK_END)
        to_its_end(rig)
    assert now(rig).reports[-1].outcome is Outcome.COMPLETED, now(rig).reports[-1]
    if action is A.WALK:
        return
    calm.settle()
    assert now(rig).gait.state is calm.state.gait.state  # type: ignore[union-attr]
    assert rig.command.position_rad == pytest.approx(calm.command.position_rad, abs=1e-9)
