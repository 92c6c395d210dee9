"""Between the grant of an action and its first motion: what forbids it by then, what fails, what does not matter."""

from __future__ import annotations

import numpy as np
import pytest

from app.control.running_action import Stage
from app.ipc.states import Effect, Event, GaitState, Outcome, Source
from app.motion.follower import Mode
from hal.joints.protocol import DriveState
from logs.reason import key_of, reason, reason_of
from tests.app.control.moments import A, K, S, now, request, resting, standing
from tests.app.control.rig import Rig


def at(rig: Rig, stage: Stage) -> Rig:
    """When the running action has come to this stage."""
    rig.run_until(lambda m: m.running is not None and m.running.stage is stage)
    return rig


def assert_refused(rig: Rig, event: Event, state: GaitState) -> None:
    report = now(rig).reports[-1]
    assert report.reason is not None
    assert (report.outcome, report.reason.code) == (Outcome.REFUSED, key_of(event))
    assert (now(rig).running, now(rig).gait.state, now(rig).gait.running) == (None, state, None)


def test_disarming_before_the_plan_has_come_lets_a_gesture_move_nothing() -> None:
    rig = standing()
    rig.answer_ticks = 150
    request(rig, A.STAIR_UP, Source.GESTURE)
    at(rig, Stage.PLANNING)
    before = rig.command
    rig.send(K.DISARM)
    rig.tick(400)
    assert_refused(rig, Event.NOT_ARMED, S.STANDING)
    assert rig.command is before


def test_disarming_takes_nothing_back_that_was_requested_by_key() -> None:
    rig = standing()
    rig.answer_ticks = 150
    request(rig, A.STAIR_UP, Source.THERAPIST)
    at(rig, Stage.PLANNING)
    rig.send(K.DISARM)
    at(rig, Stage.MOVING)
    assert rig.settle().reports[-1].outcome is Outcome.COMPLETED


def test_an_action_does_not_begin_without_the_guardian_that_was_there_at_its_request() -> None:
    rig = standing()
    rig.answer_ticks = 200
    request(rig, A.STAIR_UP, Source.THERAPIST)
    at(rig, Stage.PLANNING)
    rig.guarding = False
    rig.tick(400)
    assert_refused(rig, Event.GUARDIAN_TIMEOUT, S.STANDING)


def test_disarming_while_the_joints_are_gripped_leaves_them_held() -> None:
    rig = resting(S.UNPOWERED)
    request(rig, A.INITIALISE, Source.GESTURE)
    at(rig, Stage.STIFFENING)
    rig.send(K.DISARM)
    rig.run_until(lambda m: m.running is None)
    assert_refused(rig, Event.NOT_ARMED, S.BETWEEN)
    assert (now(rig).motion.mode, rig.joints.state) == (Mode.HOLDING, DriveState.ENABLED)
    assert rig.command.stiffness_nm_rad.min() > 0
    rig.tick(5)
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING, "and the key leads on"


def test_legs_that_begin_to_move_while_the_drives_wake_are_not_gripped() -> None:
    rig = resting(S.UNPOWERED)
    request(rig, A.INITIALISE, Source.THERAPIST)
    at(rig, Stage.ENABLING)
    rig.joints.velocity_rad_s = np.array([2.0, 3.0, 0.0, 0.0])
    rig.tick(300)
    assert_refused(rig, Event.LEGS_MOVING, S.UNPOWERED)
    assert rig.joints.state is DriveState.ENABLED
    assert rig.command.stiffness_nm_rad.max() == 0


@pytest.mark.parametrize("late_ms", [0, 30])
def test_drives_that_do_not_wake_end_the_action_at_once_though_control_was_late(late_ms: int) -> None:
    """The drives' answers are waited for, and a tick that pauses may follow."""
    rig = resting(S.UNPOWERED)
    rig.joints.refuse_enable = "left hip is silent"
    request(rig, A.INITIALISE, Source.THERAPIST)
    at(rig, Stage.ENABLING)
    rig.spoil = {"late_ns": late_ms * 1_000_000, "missed_ticks": late_ms // 2}
    rig.tick()
    assert now(rig).effect is (Effect.PAUSE if late_ms else Effect.REFUSE)
    assert now(rig).running is None
    report = now(rig).reports[-1]
    assert (report.outcome, report.reason) == (Outcome.STOPPED, reason_of(OSError("left hip is silent")))
    assert now(rig).gait.state is S.UNPOWERED
    rig.joints.refuse_enable = ""
    rig.tick(5)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING
    assert now(rig).refusal != reason(Event.DRIVE_ORDER_FAILED)
