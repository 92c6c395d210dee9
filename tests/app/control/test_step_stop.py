"""STOP from every state and movement, what it does to the joints, and the way back."""

from __future__ import annotations

import numpy as np
import pytest

from app.control.running_action import Stage
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState, Outcome, RequestRefusal
from app.motion.follower import Mode
from hal.joints.protocol import DriveState
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import reason, reason_of
from tests.app.control.moments import (
    DAMPING_TICKS,
    GRANTED,
    HOLD_TICKS,
    RESTS,
    A,
    K,
    S,
    drives,
    moving,
    now,
    records_of,
    resting,
    standing,
)
from tests.app.control.rig import TICK_NS

MOVEMENTS = [
    (S.UNPOWERED, A.INITIALISE),
    (S.BETWEEN, A.INITIALISE),
    (S.STANDING, A.STEP_RIGHT_FIRST),
    (S.STANDING, A.WALK),
    (S.STANDING, A.STAIR_UP),
    (S.STANDING, A.STAIR_DOWN),
    (S.STANDING, A.OBSTACLE),
    (S.STANDING, A.SIT_DOWN),
    (S.SITTING, A.STAND_UP),
    (S.RIGHT_FORWARD, A.STEP_LEFT),
    (S.RIGHT_FORWARD, A.STEP_END),
    (S.LEFT_FORWARD, A.STEP_RIGHT),
]


@pytest.mark.parametrize(("state", "action"), MOVEMENTS)
@pytest.mark.parametrize("ticks", [1, 30, 77, 150])
def test_stop_brings_every_movement_to_rest_along_its_path(state: GaitState, action: Action, ticks: int) -> None:
    rig = resting(state)
    rig.send(K.ACT, action)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.tick(ticks)
    rig.send(K.STOP)
    rig.tick()
    assert now(rig).effect is Effect.HOLD
    assert now(rig).gait.running is None
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.path_rate < 1, "the first command after it is another one"
    rig.tick(HOLD_TICKS + 1)
    assert now(rig).motion.mode is Mode.HOLDING
    assert rig.command.velocity_rad_s.tolist() == [0.0] * 4
    assert rig.command.stiffness_nm_rad.min() > 0, "stiffly"
    held = rig.command
    rig.tick(60)
    assert rig.command is held, "and it stays there"
    report = now(rig).reports[-1]
    assert (report.outcome, report.to_state) == (Outcome.STOPPED, S.BETWEEN)
    assert report.reason == reason(Event.STOP)


@pytest.mark.parametrize("state", RESTS)
def test_stop_at_rest_holds_and_keeps_the_state(state: GaitState) -> None:
    rig = resting(state)
    before = rig.command
    rig.send(K.STOP)
    rig.tick(50)
    assert now(rig).effect is Effect.HOLD
    assert now(rig).gait.state is state
    assert rig.command is before
    rig.send(K.ACT, next(iter(GRANTED[state])))
    rig.tick(5)
    assert now(rig).running is None


@pytest.mark.parametrize("state", RESTS)
def test_a_second_press_damps_slowly_from_the_last_command(state: GaitState) -> None:
    rig = resting(state)
    powered = state is not S.UNPOWERED
    rig.send(K.STOP)
    rig.tick(5)
    rig.send(K.STOP)
    stiffness = rig.command.stiffness_nm_rad[0]
    for _ in range(DAMPING_TICKS + 2):
        rig.tick()
        assert rig.command.stiffness_nm_rad[0] <= stiffness
        stiffness = rig.command.stiffness_nm_rad[0]
    assert now(rig).effect is Effect.DAMP
    assert rig.command.stiffness_nm_rad.tolist() == [0.0] * 4
    assert rig.command.torque_nm.tolist() == [0.0] * 4
    assert (rig.command.damping_nm_s_rad > 0).all() == powered
    assert now(rig).gait.state is (S.BETWEEN if powered else S.UNPOWERED)
    assert rig.joints.state is (DriveState.ENABLED if powered else DriveState.PROBED)


def test_two_presses_in_one_tick_damp() -> None:
    rig = moving()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick()
    assert now(rig).effect is Effect.DAMP
    rig.tick()
    assert [stop.effect for stop in records_of(rig, records.Stop)] == ["hold", "damp"]


@pytest.mark.parametrize(("kind", "event"), [(K.STOP, Event.STOP), (K.VOICE_STOP, Event.VOICE_STOP)])
def test_an_acknowledgement_received_in_the_tick_of_a_stop_does_not_undo_it(kind: OperatorKind, event: Event) -> None:
    rig = moving()
    rig.send(kind, age_ms=30)
    rig.send(K.ACKNOWLEDGE, age_ms=10)
    rig.tick()
    assert event.value in rig.events()
    (set_aside,) = records_of(rig, records.Acknowledgement)
    assert (set_aside.accepted, set_aside.reason) == (False, reason(RequestRefusal.STOPPED_MEANWHILE))
    assert (now(rig).effect, now(rig).gait.state) == (Effect.HOLD, S.BETWEEN)
    rig.tick(HOLD_TICKS)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert event.value not in rig.events(), "the next one counts"


@pytest.mark.parametrize(("kind", "event"), [(K.STOP, Event.STOP), (K.VOICE_STOP, Event.VOICE_STOP)])
@pytest.mark.parametrize("age_ms", [0.0, 10.0])  # of the acknowledgement: the word may have been sent before it came
def test_a_stop_after_an_acknowledgement_in_its_tick_waits_for_one_of_its_own(
    kind: OperatorKind, event: Event, age_ms: float
) -> None:
    rig = moving()
    rig.send(kind)
    rig.tick(HOLD_TICKS)
    rig.send(K.ACKNOWLEDGE, age_ms=age_ms)
    rig.send(kind)
    rig.tick()
    (again,) = [one for one in now(rig).events if one.in_force]
    assert (again.event, again.since_ns, again.acknowledged) == (event, rig.now_ns, False)
    assert [body.raised_ns for body in records_of(rig, records.EventRaised)][-1] == rig.now_ns
    assert records_of(rig, records.EventCleared)[-1].lasted_s == pytest.approx(HOLD_TICKS * TICK_NS / 1e9)
    rig.tick(10)
    assert [stop.seen_ns for stop in records_of(rig, records.Stop)][-1] == again.since_ns
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    assert records_of(rig, records.Acknowledgement)[-1].accepted
    assert (rig.events(), now(rig).stop_presses, now(rig).voice_stopped) == (set(), 0, False)


def test_a_second_press_with_an_acknowledgement_in_its_tick_damps() -> None:
    rig = moving()
    rig.send(K.STOP)
    rig.tick(20)
    rig.send(K.STOP, age_ms=30)
    rig.send(K.ACKNOWLEDGE, age_ms=10)
    rig.tick(3)
    assert now(rig).effect is Effect.DAMP


@pytest.mark.parametrize(("kind", "second"), [(K.STOP, Effect.DAMP), (K.VOICE_STOP, Effect.HOLD)])
def test_a_press_counts_on_after_an_acknowledgement_that_was_sent_before_control_saw_it(
    kind: OperatorKind, second: Effect
) -> None:
    rig = moving()
    rig.send(kind, age_ms=60)
    rig.tick()
    rig.send(K.ACKNOWLEDGE, age_ms=30)
    rig.tick()
    (early,) = records_of(rig, records.Acknowledgement)
    assert (early.accepted, early.reason) == (False, reason(RequestRefusal.NOTHING_TO_ACKNOWLEDGE))
    assert (now(rig).stop_presses, now(rig).voice_stopped) == (int(kind is K.STOP), kind is K.VOICE_STOP)
    rig.send(kind)
    rig.tick(3)
    assert now(rig).effect is second
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    assert (now(rig).stop_presses, now(rig).voice_stopped) == (0, False)


@pytest.mark.parametrize(("presses", "reached"), [(1, S.STANDING), (2, S.BETWEEN)])
def test_a_stop_before_the_plan_has_come_keeps_the_state_unless_the_joints_are_damped(
    presses: int, reached: GaitState
) -> None:
    rig = standing()
    rig.answer_ticks = 10
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.tick(3)
    for _ in range(presses):
        rig.send(K.STOP)
    rig.tick()
    report = now(rig).reports[-1]
    assert (report.outcome, report.to_state, now(rig).gait.state) == (Outcome.STOPPED, reached, reached)


def test_stop_wins_over_a_request_and_over_an_acknowledgement_of_the_same_tick() -> None:
    for text in ((K.ACT, K.STOP), (K.STOP, K.ACT)):
        rig = standing()
        for word in text:
            rig.send(word, A.STEP_RIGHT_FIRST if word is K.ACT else None)
        rig.tick(3)
        assert now(rig).running is None
        assert now(rig).effect is Effect.HOLD
    rig = standing()
    rig.send(K.ACKNOWLEDGE)
    rig.send(K.STOP)
    rig.tick(3)
    assert now(rig).effect is Effect.HOLD


def test_a_key_that_arms_grows_old() -> None:
    rig = standing()
    rig.send(K.DISARM)
    rig.tick(2)
    rig.send(K.ARM, age_ms=501)
    rig.tick()
    assert not now(rig).armed_ns
    assert now(rig).refusal == reason(RequestRefusal.KEY_EXPIRED)
    rig.send(K.ARM, age_ms=499)
    rig.tick()
    assert now(rig).armed_ns


def test_a_stop_never_grows_old_but_a_key_does() -> None:
    rig = standing()
    rig.send(K.ACT, A.WALK, age_ms=501)
    rig.tick()
    assert now(rig).running is None
    assert now(rig).refusal == reason(RequestRefusal.KEY_EXPIRED)
    rig.send(K.ACT, A.WALK, age_ms=499)
    rig.tick()
    assert now(rig).running is not None
    rig.send(K.STOP, age_ms=5000)
    rig.tick()
    assert now(rig).effect is Effect.HOLD


def test_the_moment_of_a_stop_and_of_its_command_are_reported() -> None:
    rig = moving()
    assert (now(rig).stop_received_ns, now(rig).stop_command_ns) == (0, 0)
    rig.send(K.STOP)
    seen_ns = rig.now_ns + 2_000_000
    rig.tick(2)
    assert now(rig).stop_received_ns == seen_ns
    assert now(rig).stop_command_ns == seen_ns + 1_000_000
    rig.tick(20)
    assert now(rig).stop_command_ns == seen_ns + 1_000_000, "of the first command after it"
    stop = records_of(rig, records.Stop)[0]
    assert (stop.seen_ns, stop.effect) == (seen_ns, "hold")


def test_acknowledging_starts_nothing_and_gesture_0_returns_slowly_from_where_the_legs_are() -> None:
    rig = moving()
    rig.send(K.STOP)
    rig.tick(HOLD_TICKS + 5)
    held = rig.command
    rig.send(K.ACKNOWLEDGE)
    rig.tick(200)
    assert rig.command is held
    assert now(rig).effect is Effect.NOTE
    for action in set(Action) - {A.INITIALISE}:
        rig.send(K.ACT, action)
        rig.tick(2)
        assert now(rig).running is None
        assert now(rig).refusal == reason(
            RequestRefusal.NO_WALK if action is A.WALK_END else RequestRefusal.BETWEEN_STATES
        )
    rig.release(Gesture.ZERO)
    rig.run_until(lambda m: m.running is not None)
    plan_from = rig._asked[0][1].start_rad if rig._asked else now(rig).motion.plan
    assert plan_from == pytest.approx(tuple(rig.joints.position_rad))
    assert rig.settle().gait.state is S.STANDING


def test_the_return_is_refused_when_it_is_not_free() -> None:
    rig = resting(S.BETWEEN)
    rig.refuse_plans = "left knee: 130° lies beyond 120°"
    held = rig.command
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(5)
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).gait.running is None
    assert now(rig).refusal == reason_of(OSError("left knee: 130° lies beyond 120°"))
    assert now(rig).reports[-1].outcome is Outcome.REFUSED
    assert rig.command is held
    plan = records_of(rig, records.PlanChecked)[-1]
    assert not plan.ok


def test_after_a_damp_the_joints_are_gripped_where_they_sank_to() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(DAMPING_TICKS + 5)
    rig.joints.position_rad = np.array([0.4, 0.8, 0.5, 0.7])
    rig.send(K.ACKNOWLEDGE)
    rig.tick(5)
    assert now(rig).motion.mode is Mode.DAMPED, "acknowledging does not stiffen"
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.motion.mode is Mode.STIFFENING)
    assert rig.command.position_rad == pytest.approx(np.array([0.4, 0.8, 0.5, 0.7]))
    stiffness = rig.command.stiffness_nm_rad.max()
    assert stiffness < 10
    rig.settle()
    assert now(rig).gait.state is S.STANDING
    assert now(rig).reports[-1].outcome is Outcome.COMPLETED


def test_torque_goes_off_only_on_the_operators_command_and_only_when_the_joints_are_damped() -> None:
    rig = resting(S.SITTING)
    rig.send(K.TORQUE_OFF)
    rig.tick(3)
    assert rig.joints.state is DriveState.ENABLED
    assert now(rig).refusal == reason(RequestRefusal.TORQUE_OFF_NEEDS_DAMPING)
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(10)
    rig.send(K.TORQUE_OFF)
    rig.tick(10)
    assert drives(rig) is DriveState.ENABLED, "still giving way"
    rig.tick(DAMPING_TICKS)
    assert drives(rig) is DriveState.DISABLED
    assert now(rig).gait.state is S.UNPOWERED
    assert not [one for one in rig.audit if isinstance(one, records.GuardRefusal)], (
        "for damped joints neutral is no jump"
    )
    assert now(rig).motion.mode is Mode.DISABLED
    assert Event.DRIVES_POWER_LOST.value not in rig.events()
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    rig.send(K.ACT, A.INITIALISE)
    assert rig.settle() is not None
    rig.tick(3)
    rig.settle()
    assert now(rig).gait.state is S.STANDING


def test_damped_joints_stay_damped_without_the_operators_command() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(2000)
    assert rig.joints.state is DriveState.ENABLED
    assert rig.command.damping_nm_s_rad.min() > 0
