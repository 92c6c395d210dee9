"""One tick after the other: what is granted, what stops it, and what is told of it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from app.control.events import Event
from app.control.follow import GIVE_WAY_S, HOLD_S, Mode
from app.control.inputs import DriveOrder
from app.control.memory import REPORTS_KEPT, Memory
from app.control.plan import TICK_HZ, Phase
from app.control.states import ACTION_OF, GESTURE_OF, Action, Effect, GaitState, Source
from app.control.task import Stage
from app.messages import OperatorKind
from hal.joints.joints import DriveState
from kgdfa.hand import Gesture
from logs import records
from tests.app.control.rig import Rig, resting, standing

S, A, K = GaitState, Action, OperatorKind
RESTS = (S.UNPOWERED, S.STANDING, S.SITTING, S.RIGHT_FORWARD, S.LEFT_FORWARD, S.BETWEEN)
GRANTED = {
    S.UNPOWERED: {A.INITIALISE},
    S.STANDING: {A.STEP_RIGHT_FIRST, A.WALK, A.STAIR_UP, A.STAIR_DOWN, A.OBSTACLE, A.SIT_DOWN},
    S.SITTING: {A.STAND_UP},
    S.RIGHT_FORWARD: {A.STEP_LEFT, A.STEP_END},
    S.LEFT_FORWARD: {A.STEP_RIGHT},
    S.BETWEEN: {A.INITIALISE},
}
HOLD_TICKS = int(HOLD_S * TICK_HZ)
SLACK_TICKS = int(GIVE_WAY_S * TICK_HZ)


def now(rig: Rig) -> Memory:
    """The rig's memory."""
    assert rig.memory is not None
    return rig.memory


def told(rig: Rig, kind: type[records.Body]) -> list[records.Body]:
    """The trail's records of a kind."""
    return [body for body in rig.audit if isinstance(body, kind)]


def drives(rig: Rig) -> DriveState:
    """What the drives say of themselves."""
    return rig.joints.state


def moving(action: Action = A.STEP_RIGHT_FIRST, state: GaitState = S.STANDING) -> Rig:
    """A rig in the middle of an action."""
    return deepcopy(_moving(action, state))


@cache
def _moving(action: Action, state: GaitState) -> Rig:
    rig = resting(state)
    rig.say(K.ACT, action)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.MOVING)
    rig.tick(60)
    rig.history.clear()
    return rig


# --- every state × wish × busy × armed ------------------------------------------------------------------------------


@pytest.mark.parametrize("armed", [True, False])
@pytest.mark.parametrize("source", Source)
@pytest.mark.parametrize("action", Action)
@pytest.mark.parametrize("state", RESTS)
def test_at_rest_the_table_and_the_arming_decide(state: GaitState, action: Action, source: Source, armed: bool) -> None:
    rig = resting(state)
    if not armed:
        rig.say(K.DISARM)
        rig.tick()
    before = now(rig).refusal_count
    _wish(rig, action, source)
    rig.tick(20)
    wanted = action in GRANTED[state] and (armed or source is Source.THERAPIST)
    assert (now(rig).task is not None) is wanted
    assert now(rig).refusal_count == before + (not wanted)
    commands = told(rig, records.Command)
    assert len(commands) == wanted
    if wanted:
        command = commands[0]
        assert isinstance(command, records.Command)
        assert command.source == source.value
        assert command.gesture == (GESTURE_OF[action].value if source is Source.GESTURE else None)
        if action is A.WALK:
            rig.say(K.ACT, A.WALK_END)
        done = rig.settle()
        assert done.gait.state is not state or action in {A.WALK, A.STAIR_UP, A.STAIR_DOWN, A.OBSTACLE}
        assert done.reports[-1].outcome == "completed"
    else:
        assert now(rig).refusal
        assert told(rig, records.Refusal)


@pytest.mark.parametrize("source", Source)
@pytest.mark.parametrize("action", Action)
@pytest.mark.parametrize("running", [A.STEP_RIGHT_FIRST, A.STAIR_UP, A.OBSTACLE, A.STAIR_DOWN, A.SIT_DOWN, A.WALK])
def test_during_a_movement_only_the_end_of_a_walk_is_heard(running: Action, action: Action, source: Source) -> None:
    rig = moving(running)
    path = rig.command.position_rad
    _wish(rig, action, source)
    rig.tick(18)
    if (running, action) == (A.WALK, A.WALK_END):
        assert now(rig).gait.closing
        assert rig.settle().gait.state is S.STANDING
        assert [report.outcome for report in now(rig).reports[-2:]] == ["completed", "completed"]
    else:
        assert now(rig).gait.running is running
        assert now(rig).ignored_count == 1
        assert not now(rig).gait.closing
        assert not np.array_equal(rig.command.position_rad, path), "the movement goes on"
        assert told(rig, records.Refusal)


def _wish(rig: Rig, action: Action, source: Source) -> None:
    if source is Source.THERAPIST:
        rig.say(K.ACT, action)
    else:
        rig.release(GESTURE_OF[action])


# --- STOP ---------------------------------------------------------------------------------------------------------


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
    rig.say(K.ACT, action)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.MOVING)
    rig.tick(ticks)
    speed = float(np.abs(rig.command.velocity_rad_s).max())
    rig.say(K.STOP)
    rig.tick()
    assert now(rig).effect is Effect.HOLD
    assert now(rig).gait.running is None
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.pace < 1, "the first command after it is another one"
    first = now(rig).motion.row
    rig.tick(HOLD_TICKS + 1)
    assert now(rig).motion.mode is Mode.STIFF
    assert rig.command.velocity_rad_s.tolist() == [0.0] * 4
    assert rig.command.stiffness_nm_rad.min() > 0, "stiffly"
    held = rig.command
    rig.tick(60)
    assert rig.command is held, "and it stays there"
    assert speed >= 0
    assert first >= 0
    report = now(rig).reports[-1]
    assert (report.outcome, report.to_state) == ("stopped", S.BETWEEN)
    assert "STOP" in report.reason


@pytest.mark.parametrize("state", RESTS)
def test_stop_at_rest_holds_and_keeps_the_state(state: GaitState) -> None:
    rig = resting(state)
    before = rig.command
    rig.say(K.STOP)
    rig.tick(50)
    assert now(rig).effect is Effect.HOLD
    assert now(rig).gait.state is state
    assert rig.command is before
    rig.say(K.ACT, next(iter(GRANTED[state])))
    rig.tick(5)
    assert now(rig).task is None


@pytest.mark.parametrize("state", RESTS)
def test_a_second_press_gives_way_slowly_from_the_last_command(state: GaitState) -> None:
    rig = resting(state)
    powered = state is not S.UNPOWERED
    rig.say(K.STOP)
    rig.tick(5)
    rig.say(K.STOP)
    stiffness = rig.command.stiffness_nm_rad[0]
    for _ in range(SLACK_TICKS + 2):
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
    rig.say(K.STOP)
    rig.say(K.STOP)
    rig.tick()
    assert now(rig).effect is Effect.DAMP
    assert [stop.effect for stop in told(rig, records.Stop) if isinstance(stop, records.Stop)] == ["hold", "damp"]


def test_stop_wins_over_a_wish_and_over_an_acknowledgement_of_the_same_tick() -> None:
    for words in ((K.ACT, K.STOP), (K.STOP, K.ACT)):
        rig = standing()
        for word in words:
            rig.say(word, A.STEP_RIGHT_FIRST if word is K.ACT else None)
        rig.tick(3)
        assert now(rig).task is None
        assert now(rig).effect is Effect.HOLD
    rig = standing()
    rig.say(K.ACKNOWLEDGE)
    rig.say(K.STOP)
    rig.tick(3)
    assert now(rig).effect is Effect.HOLD


def test_a_stop_never_grows_old_but_a_key_does() -> None:
    rig = standing()
    rig.say(K.ACT, A.WALK, age_ms=501)
    rig.tick()
    assert now(rig).task is None
    assert "too long ago" in now(rig).refusal
    rig.say(K.ACT, A.WALK, age_ms=499)
    rig.tick()
    assert now(rig).task is not None
    rig.say(K.STOP, age_ms=5000)
    rig.tick()
    assert now(rig).effect is Effect.HOLD


def test_the_moment_of_a_stop_and_of_its_command_are_told() -> None:
    rig = moving()
    rig.say(K.STOP)
    seen_ns = rig.now_ns + 2_000_000
    rig.tick(2)
    assert now(rig).stop_seen_ns == seen_ns
    assert now(rig).stop_command_ns == seen_ns + 1_000_000
    stop = told(rig, records.Stop)[0]
    assert isinstance(stop, records.Stop)
    assert (stop.seen_ns, stop.effect) == (seen_ns, "hold")


# --- after a stop -------------------------------------------------------------------------------------------------


def test_acknowledging_starts_nothing_and_gesture_0_returns_slowly_from_where_the_legs_are() -> None:
    rig = moving()
    rig.say(K.STOP)
    rig.tick(HOLD_TICKS + 5)
    held = rig.command
    rig.say(K.ACKNOWLEDGE)
    rig.tick(200)
    assert rig.command is held
    assert now(rig).effect is Effect.NOTE
    for action in set(Action) - {A.INITIALISE}:
        rig.say(K.ACT, action)
        rig.tick(2)
        assert now(rig).task is None
        assert "gesture 0" in now(rig).refusal or action is A.WALK_END
    rig.release(Gesture.ZERO)
    rig.run_until(lambda m: m.task is not None)
    plan_from = rig._asked[0][1].start_rad if rig._asked else now(rig).motion.plan
    assert plan_from == pytest.approx(tuple(rig.joints.position_rad))
    assert rig.settle().gait.state is S.STANDING


def test_the_way_back_is_refused_when_it_is_not_free() -> None:
    rig = resting(S.BETWEEN)
    rig.refuse_plans = "left knee: 130° lies beyond 120°"
    held = rig.command
    rig.say(K.ACT, A.INITIALISE)
    rig.tick(5)
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).gait.running is None
    assert now(rig).refusal == "left knee: 130° lies beyond 120°"
    assert now(rig).reports[-1].outcome == "refused"
    assert rig.command is held
    plan = told(rig, records.PlanChecked)[-1]
    assert isinstance(plan, records.PlanChecked)
    assert not plan.ok


def test_after_a_damp_the_joints_are_gripped_where_they_sank_to() -> None:
    rig = standing()
    rig.say(K.STOP)
    rig.say(K.STOP)
    rig.tick(SLACK_TICKS + 5)
    rig.joints.position_rad = np.array([0.4, 0.8, 0.5, 0.7])
    rig.say(K.ACKNOWLEDGE)
    rig.tick(5)
    assert now(rig).motion.mode is Mode.SLACK, "acknowledging does not grip"
    rig.say(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.motion.mode is Mode.GRIP)
    assert rig.command.position_rad == pytest.approx(np.array([0.4, 0.8, 0.5, 0.7]))
    stiffness = rig.command.stiffness_nm_rad.max()
    assert stiffness < 10
    rig.settle()
    assert now(rig).gait.state is S.STANDING
    assert now(rig).reports[-1].outcome == "completed"


def test_torque_goes_off_only_on_the_operators_word_and_only_when_the_joints_have_given_way() -> None:
    rig = standing()
    rig.say(K.TORQUE_OFF)
    rig.tick(3)
    assert rig.joints.state is DriveState.ENABLED
    assert "only after STOP twice" in now(rig).refusal
    rig.say(K.STOP)
    rig.say(K.STOP)
    rig.tick(10)
    rig.say(K.TORQUE_OFF)
    rig.tick(10)
    assert drives(rig) is DriveState.ENABLED, "still giving way"
    rig.tick(SLACK_TICKS)
    assert drives(rig) is DriveState.DISABLED
    assert now(rig).gait.state is S.UNPOWERED
    assert now(rig).motion.mode is Mode.LIMP
    assert Event.DRIVES_LOST.value not in rig.events()
    rig.say(K.ACKNOWLEDGE)
    rig.tick()
    rig.say(K.ACT, A.INITIALISE)
    assert rig.settle() is not None
    rig.tick(3)
    rig.settle()
    assert now(rig).gait.state is S.STANDING


def test_damped_joints_stay_damped_without_the_operators_word() -> None:
    rig = standing()
    rig.say(K.STOP)
    rig.say(K.STOP)
    rig.tick(2000)
    assert rig.joints.state is DriveState.ENABLED
    assert rig.command.damping_nm_s_rad.min() > 0


# --- powering up --------------------------------------------------------------------------------------------------


def test_gesture_0_plans_enables_grips_and_only_then_moves() -> None:
    rig = resting(S.UNPOWERED)
    rig.release(Gesture.ZERO)
    stages: list[Stage] = []
    for _ in range(600):
        memory = rig.tick()
        if memory.task is not None and (not stages or stages[-1] is not memory.task.stage):
            stages.append(memory.task.stage)
            if memory.task.stage in {Stage.PLANNING, Stage.ENABLING}:
                assert rig.command.stiffness_nm_rad.max() == 0
    assert stages == [Stage.PLANNING, Stage.ENABLING, Stage.GRIPPING, Stage.MOVING]
    assert now(rig).gait.state is S.STANDING
    report = now(rig).reports[-1]
    assert report.source is Source.GESTURE
    assert report.from_state is S.UNPOWERED
    assert report.accepted_ns < report.first_command_ns < report.first_motion_ns < report.ended_ns


def test_a_refused_way_to_standing_never_powers_the_drives() -> None:
    rig = resting(S.UNPOWERED)
    rig.refuse_plans = "the feet are not on the ground"
    rig.say(K.ACT, A.INITIALISE)
    rig.tick(10)
    assert rig.joints.state is DriveState.PROBED
    assert now(rig).gait.state is S.UNPOWERED
    assert now(rig).reports[-1].outcome == "refused"


def test_legs_that_moved_while_the_drives_woke_are_planned_for_anew() -> None:
    rig = resting(S.UNPOWERED)
    rig.say(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.ENABLING)
    rig.joints.position_rad = rig.joints.position_rad + 0.3
    gripped_at = rig.joints.position_rad.copy()
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.MOVING)
    plan = now(rig).motion.plan
    assert plan is not None
    assert plan.position_rad[0] == pytest.approx(gripped_at)
    rig.settle()
    assert now(rig).gait.state is S.STANDING


def test_a_way_that_is_not_free_any_more_leaves_the_gripped_joints_held() -> None:
    rig = resting(S.UNPOWERED)
    rig.say(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.GRIPPING)
    rig.refuse_plans = "not free"
    rig.answer_ticks = 1
    rig.tick(300)
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.STIFF
    assert rig.joints.state is DriveState.ENABLED


def test_drives_that_do_not_wake_end_the_action_with_their_reason() -> None:
    rig = resting(S.UNPOWERED)
    rig.joints.refuse_enable = "left hip does not answer: check its cable"
    rig.say(K.ACT, A.INITIALISE)
    rig.tick(6)
    assert now(rig).task is None
    assert now(rig).reports[-1].reason == "left hip does not answer: check its cable"
    assert now(rig).gait.state is S.UNPOWERED
    assert Event.DRIVE_ORDER_FAILED.value in rig.events()


def test_drives_that_never_say_that_they_woke_are_given_up() -> None:
    rig = resting(S.UNPOWERED)
    rig.say(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.ENABLING)
    rig.joints.state = DriveState.PROBED
    rig.tick(1502)
    assert now(rig).task is None
    assert "did not confirm" in now(rig).reports[-1].reason


def test_a_stop_while_the_drives_wake_leaves_them_neutral() -> None:
    rig = resting(S.UNPOWERED)
    rig.say(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.ENABLING)
    rig.say(K.STOP)
    rig.tick(300)
    assert now(rig).gait.state is S.UNPOWERED
    assert rig.command.stiffness_nm_rad.max() == 0
    rig.say(K.ACKNOWLEDGE)
    rig.tick()
    rig.say(K.TORQUE_OFF)
    rig.tick()
    assert rig.joints.state is DriveState.DISABLED


def test_drives_that_are_awake_already_are_gripped_without_being_woken_again() -> None:
    rig = resting(S.UNPOWERED)
    rig.joints.state = DriveState.ENABLED
    rig.say(K.ACT, A.INITIALISE)
    rig.tick(400)
    assert now(rig).gait.state is S.STANDING
    assert all(outputs.drives is DriveOrder.NONE for _, outputs in rig.history)


def test_when_the_drives_lose_power_the_state_says_so() -> None:
    rig = moving()
    rig.joints.state = DriveState.DISABLED
    rig.tick()
    assert now(rig).gait.state is S.UNPOWERED
    assert now(rig).motion.mode is Mode.LIMP
    assert now(rig).reports[-1].outcome == "stopped"
    rig.tick(50)
    assert rig._refusal is None, "nothing that the guard would refuse is sent to drives that are off"


def test_one_faulted_drive_leaves_the_others_holding() -> None:
    rig = moving()
    rig.joints.state = DriveState.FAULTED
    rig.tick(HOLD_TICKS + 5)
    assert now(rig).heard.powered
    assert rig.command.stiffness_nm_rad.min() > 0


# --- gestures -----------------------------------------------------------------------------------------------------


def test_a_release_acts_once_however_often_it_is_told() -> None:
    rig = standing()
    rig.release(Gesture.ONE)
    rig.settle()
    rig.tick(20)
    rig.settle()
    rig.tick(500)
    assert len(told(rig, records.Command)) == 1
    assert now(rig).ignored_count == 0
    assert now(rig).refusal_count == 0


@pytest.mark.parametrize(
    ("age_ms", "acts"), [(30, True), (160, True), (204, False), (900, False), (-40, True), (-90, False)]
)
def test_a_stale_release_never_acts(age_ms: float, acts: bool) -> None:
    rig = standing()
    rig.tick(17 - (rig.now_ns % 34_000_000) // 2_000_000)  # the next tick brings a report
    rig.release(Gesture.ONE, age_ms=age_ms)
    rig.tick(40)
    rig.settle()
    assert bool(told(rig, records.Command)) is acts


def test_a_release_made_while_disarmed_never_acts_later() -> None:
    rig = standing()
    rig.say(K.DISARM)
    rig.tick()
    rig.release(Gesture.ONE)
    rig.tick(20)
    assert "not armed" in now(rig).refusal
    rig.say(K.ARM)
    rig.tick(500)
    assert not told(rig, records.Command)


def test_a_release_made_just_before_the_arming_does_not_act() -> None:
    rig = standing()
    rig.say(K.DISARM)
    rig.tick()
    rig.say(K.ARM)
    rig.release(Gesture.ONE, age_ms=10)
    rig.tick(30)
    assert not told(rig, records.Command)
    assert "before gestures were armed" in now(rig).refusal


def test_a_perception_that_restarts_repeats_nothing_and_is_heard_again() -> None:
    rig = standing()
    rig.release(Gesture.ONE)
    rig.tick(20)
    rig.settle()
    rig.restart_perception()
    rig.tick(300)
    assert len(told(rig, records.Command)) == 1
    rig.release(Gesture.FOUR)
    rig.tick(20)
    rig.settle()
    assert len(told(rig, records.Command)) == 2
    assert now(rig).gait.state is S.STANDING


def test_the_first_report_of_a_restarted_perception_may_bring_a_release() -> None:
    rig = standing()
    rig.restart_perception()
    rig.release(Gesture.ONE)
    rig.tick(20)
    assert now(rig).task is not None


def test_a_release_without_a_gesture_is_no_wish() -> None:
    rig = standing()
    rig.release(Gesture.ONE)
    rig._released = None
    rig.tick(30)
    assert now(rig).refusal_count == 0
    assert now(rig).task is None


def test_an_act_without_an_action_is_no_wish_and_old_words_are_not_heard_twice() -> None:
    rig = standing()
    rig.say(K.ACT)
    rig.tick(2)
    assert now(rig).refusal_count == 0
    rig.say(K.ACT, A.STEP_RIGHT_FIRST)
    word = rig._words[-1]
    rig.tick(2)
    rig.settle()
    rig._words.append(word)
    rig.tick(5)
    assert len(told(rig, records.Command)) == 1
    assert now(rig).refusal_count == 0


def test_without_a_preflight_an_action_is_refused_and_others_are_not() -> None:
    rig = standing()
    rig.cleared = frozenset({A.STEP_RIGHT_FIRST, A.WALK})
    rig.say(K.ACT, A.STAIR_UP)
    rig.tick(2)
    assert now(rig).task is None
    assert "pre-flight" in now(rig).refusal
    rig.say(K.ACT, A.WALK)
    rig.tick(60)
    assert now(rig).gait.running is A.WALK
    rig.say(K.ACT, A.WALK_END)
    rig.tick(2)
    assert now(rig).gait.closing, "ending a walk needs no pre-flight"


# --- walking ------------------------------------------------------------------------------------------------------


def test_a_walk_has_no_pause_and_no_jump_between_its_steps() -> None:
    rig = standing()
    rig.say(K.ACT, A.WALK)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.MOVING)
    rig.history.clear()
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT and m.motion.row > 20)
    rows = [memory.motion.row for memory, _ in rig.history]
    phases = [memory.gait.phase for memory, _ in rig.history]
    assert {Phase.WALK_START, Phase.WALK_RIGHT, Phase.WALK_LEFT} == set(phases)
    for (before, after), (one, other) in zip(pairwise(rows), pairwise(phases), strict=True):
        assert after == (before + 1 if one is other else 1)
    commands = [outputs.command.position_rad for _, outputs in rig.history]
    assert max(float(np.abs(b - a).max()) for a, b in pairwise(commands)) < 0.01


def test_a_walk_counts_its_steps_and_its_way() -> None:
    rig = standing()
    rig.say(K.ACT, A.WALK)
    rig.run_until(lambda m: m.steps == 3)
    rig.say(K.ACT, A.WALK_END)
    memory = rig.settle()
    assert memory.steps == 5
    assert memory.distance_walked_m == pytest.approx(1.5)


def test_gesture_6_in_the_last_tick_of_a_step_still_ends_the_walk_with_it() -> None:
    rig = moving(A.WALK)
    rig.run_until(lambda m: m.motion.rows_left == 1)
    phase = now(rig).gait.phase
    rig.say(K.ACT, A.WALK_END)
    rig.tick(2)
    assert now(rig).gait.running is A.WALK_END
    assert now(rig).gait.phase is not phase
    assert rig.settle().gait.state is S.STANDING


def test_a_next_step_that_can_not_be_planned_ends_the_walk_before_it() -> None:
    rig = moving(A.WALK)
    rig.refuse_plans = "too far"
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_RIGHT)
    rig.tick(3)
    assert now(rig).gait.closing
    rig.tick(800)
    # the closing step was refused as well: the legs are held on their way
    assert Event.WALK_BROKEN.value in rig.events()
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.STIFF


def test_a_late_next_step_is_taken_as_long_as_it_comes_before_the_last_call() -> None:
    rig = moving(A.WALK)
    rig.answer_ticks = 120
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    assert rig.events() == set()


@pytest.mark.parametrize("source", Source)
def test_when_perception_goes_a_walk_of_the_wearer_ends_and_the_therapists_goes_on(source: Source) -> None:
    rig = standing()
    _wish(rig, A.WALK, source)
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    rig.watching = False
    rig.tick(150)
    assert Event.PERCEPTION_GONE.value in rig.events()
    if source is Source.THERAPIST:
        assert not now(rig).gait.closing
        return
    assert now(rig).gait.running is not None, "the running step is carried out"
    assert rig.settle().gait.state is S.STANDING
    assert now(rig).reports[-1].outcome == "completed"
    rig.release(Gesture.FIVE)
    rig.tick(100)
    assert now(rig).task is None


def test_when_the_trail_stops_any_walk_ends_normally() -> None:
    rig = moving(A.WALK)
    rig.auditing = False
    rig.tick(250)
    assert Event.AUDIT_GONE.value in rig.events()
    assert rig.settle().gait.state is S.STANDING
    assert now(rig).reports[-1].outcome == "completed"


# --- what is measured and told --------------------------------------------------------------------------------------


def test_the_moments_of_an_action_are_in_order_and_true() -> None:
    rig = standing()
    rig.release(Gesture.ONE, age_ms=30)
    rig.run_until(lambda m: m.task is not None)
    accepted_ns = rig.now_ns
    start = rig.joints.position_rad.copy()
    command = rig.command
    first_ns = motion_ns = 0
    while now(rig).task is not None:
        rig.tick()
        if not first_ns and not np.array_equal(rig.command.position_rad, command.position_rad):
            first_ns = rig.now_ns + 1_000_000
        if not motion_ns and np.abs(rig.joints.position_rad - start).max() >= np.radians(0.5):
            motion_ns = rig.now_ns + 2_000_000
    report = now(rig).reports[-1]
    assert report.accepted_ns == accepted_ns
    assert report.released_ns < accepted_ns
    assert report.first_command_ns == first_ns
    assert report.first_motion_ns == motion_ns
    assert report.ended_ns == rig.now_ns
    assert report.tracking_rms_rad == pytest.approx(0.0, abs=1e-9)
    end = told(rig, records.ActionEnd)[-1]
    assert isinstance(end, records.ActionEnd)
    assert (end.first_command_ns, end.outcome) == (first_ns, "completed")


def test_the_tracking_error_is_the_joints_root_mean_square() -> None:
    rig = standing()
    rig.joints.stuck = True
    rig.plan_s = 1.2
    rig.say(K.ACT, A.STEP_RIGHT_FIRST)
    rig.run_until(lambda m: m.task is not None and m.task.stage is Stage.MOVING)
    errors = []
    for _ in range(60):
        errors.append(rig.joints.position_rad - rig.command.position_rad)
        rig.tick()
    task = now(rig).task
    assert task is not None
    assert task.squares_rad2 / task.samples == pytest.approx(float(np.mean(np.square(errors))), rel=1e-9)


def test_a_response_takes_one_tick_and_the_planners_answer() -> None:
    rig = standing()
    rig.say(K.ACT, A.STEP_RIGHT_FIRST)
    rig.run_until(lambda m: m.task is not None and bool(m.task.report.first_command_ns))
    task = now(rig).task
    assert task is not None
    assert task.report.first_command_ns - task.report.accepted_ns <= 5_000_000


def test_old_reports_make_room_for_new_ones() -> None:
    rig = standing()
    for _ in range(REPORTS_KEPT // 2 + 2):
        rig.act(A.STEP_RIGHT_FIRST)
        rig.act(A.STEP_END)
    numbers = [report.number for report in now(rig).reports]
    assert len(numbers) == REPORTS_KEPT
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == now(rig).number


def test_every_change_of_state_stands_in_the_trail() -> None:
    rig = standing()
    for action in (A.STEP_RIGHT_FIRST, A.STEP_END, A.STAIR_UP, A.SIT_DOWN):
        rig.act(action)
    states = [(b.from_state, b.to_state) for b in told(rig, records.Transition) if isinstance(b, records.Transition)]
    assert states == [
        ("standing", "right leg forward"),
        ("right leg forward", "standing"),
        ("standing", "right leg high step"),
        ("right leg high step", "standing"),
        ("standing", "sitting"),
    ]


def test_the_effect_and_the_streams_are_told_when_they_change() -> None:
    rig = standing()
    rig.watching = False
    rig.tick(140)
    rig.watching = True
    rig.tick(700)
    effects = [
        (b.from_effect, b.to_effect) for b in told(rig, records.EffectChanged) if isinstance(b, records.EffectChanged)
    ]
    assert effects == [("note", "refuse"), ("refuse", "note")]
    lost = [b.stream for b in told(rig, records.HeartbeatLost) if isinstance(b, records.HeartbeatLost)]
    found = [b.stream for b in told(rig, records.HeartbeatFound) if isinstance(b, records.HeartbeatFound)]
    assert lost == found == ["trigger"]


def test_a_guard_refusal_holds_the_legs_with_the_last_command_that_passed() -> None:
    rig = moving()
    rig.settings = replace(rig.settings, gains=replace(rig.settings.gains, stiffness_nm_rad=np.full(4, np.nan)))
    before = rig.command
    rig.tick(100)
    assert rig.command.position_rad == pytest.approx(before.position_rad)
    assert Event.GUARD_REFUSAL.value in rig.events()
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.STIFF
    refusals = told(rig, records.GuardRefusal)
    assert len(refusals) == 1, "once it is held, nothing is refused any more"
    assert isinstance(refusals[0], records.GuardRefusal)
    assert refusals[0].value is None
    assert refusals[0].limit is None


def test_a_clock_step_is_told() -> None:
    rig = standing()
    rig.spoil["wall_ns"] = rig.now_ns + 9_000_000_000
    rig.tick()
    steps = [b.step_s for b in told(rig, records.ClockStep) if isinstance(b, records.ClockStep)]
    assert steps == [pytest.approx(4.0, abs=0.01)]


def test_legs_that_are_not_where_their_state_says_lose_it() -> None:
    rig = standing()
    rig.settings = replace(rig.settings, poses={S.STANDING: np.full(4, 0.5)})
    rig.tick()
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.STIFF
    rig.settings = replace(rig.settings, poses={})
    rig.say(K.ACKNOWLEDGE)
    rig.tick(2)
    rig.say(K.ACT, A.INITIALISE)
    rig.tick(3)
    assert rig.settle().gait.state is S.STANDING


# --- the end ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("asked", ["word", "signal"])
def test_the_end_holds_gives_way_switches_off_and_finishes(asked: str) -> None:
    rig = moving(A.WALK)
    rig.say(K.SHUT_DOWN)
    if asked == "signal":
        rig._words.clear()
        rig.spoil["must_end"] = True
    modes: list[Mode] = []
    for _ in range(600):
        memory = rig.tick()
        modes.append(memory.motion.mode)
        assert rig.outputs is not None
        if rig.outputs.finished:
            break
    order = [mode for i, mode in enumerate(modes) if i == 0 or modes[i - 1] is not mode]
    assert order == [Mode.MOVE, Mode.STIFF, Mode.SLACK, Mode.LIMP]
    assert rig.joints.state is DriveState.DISABLED
    assert now(rig).gait.state is S.UNPOWERED


def test_with_the_drives_off_the_end_comes_at_once() -> None:
    rig = resting(S.UNPOWERED)
    rig.say(K.SHUT_DOWN)
    rig.tick()
    assert rig.outputs is not None
    assert rig.outputs.finished


def test_nothing_is_granted_while_the_session_ends() -> None:
    rig = standing()
    rig.say(K.SHUT_DOWN)
    rig.say(K.ACT, A.WALK)
    rig.tick()
    assert now(rig).task is None
    assert now(rig).refusal_count == 1


def test_every_gesture_has_its_action() -> None:
    assert {ACTION_OF[gesture] for gesture in Gesture} == set(Action)
