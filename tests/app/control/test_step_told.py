"""What a tick measures and tells: moments, tracking, the trail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.control.running_action import Stage
from app.control.state import REPORTS_KEPT, ControlState
from app.ipc.states import Event
from app.motion.follower import Mode
from kgdfa.gesture import Gesture
from logs import records
from tests.app.control.moments import A, K, S, moving, now, records_of, standing


def test_the_moments_of_an_action_are_in_order_and_true() -> None:
    rig = standing()
    rig.release(Gesture.ONE, age_ms=30)
    rig.run_until(lambda m: m.running is not None)
    accepted_ns = rig.now_ns
    start = rig.joints.position_rad.copy()
    command = rig.command
    first_ns = motion_ns = 0

    def watch(m: ControlState) -> bool:
        nonlocal first_ns, motion_ns
        if not first_ns and not np.array_equal(rig.command.position_rad, command.position_rad):
            first_ns = rig.now_ns + 1_000_000
        if not motion_ns and np.abs(rig.joints.position_rad - start).max() >= np.radians(0.5):
            motion_ns = rig.now_ns + 2_000_000
        return m.running is None

    rig.run_until(watch)
    report = now(rig).reports[-1]
    assert report.accepted_ns == accepted_ns
    assert report.released_ns < accepted_ns
    assert report.first_command_ns == first_ns
    assert report.first_motion_ns == motion_ns
    assert report.ended_ns == rig.now_ns
    assert report.tracking_rms_rad == pytest.approx(0.0, abs=1e-9)
    end = records_of(rig, records.ActionEnd)[-1]
    assert isinstance(end, records.ActionEnd)
    assert (end.first_command_ns, end.outcome) == (first_ns, "completed")


def test_the_tracking_error_is_the_joints_root_mean_square() -> None:
    rig = standing()
    rig.joints.stuck = True
    rig.plan_s = 1.2
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    errors = []
    for _ in range(60):
        errors.append(rig.joints.position_rad - rig.command.position_rad)
        rig.tick()
    running = now(rig).running
    assert running is not None
    assert running.squares_rad2 / running.samples == pytest.approx(float(np.mean(np.square(errors))), rel=1e-9)


def test_a_response_takes_one_tick_and_the_planners_answer() -> None:
    rig = standing()
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.run_until(lambda m: m.running is not None and bool(m.running.report.first_command_ns))
    running = now(rig).running
    assert running is not None
    assert running.report.first_command_ns - running.report.accepted_ns <= 5_000_000


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
    states = [
        (b.from_state, b.to_state) for b in records_of(rig, records.Transition) if isinstance(b, records.Transition)
    ]
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
        (b.from_effect, b.to_effect)
        for b in records_of(rig, records.EffectChanged)
        if isinstance(b, records.EffectChanged)
    ]
    assert effects == [("note", "refuse"), ("refuse", "note")]
    lost = [b.stream for b in records_of(rig, records.HeartbeatLost) if isinstance(b, records.HeartbeatLost)]
    found = [b.stream for b in records_of(rig, records.HeartbeatFound) if isinstance(b, records.HeartbeatFound)]
    assert lost == found == ["trigger"]


def test_a_guard_refusal_holds_the_legs_with_the_last_command_that_passed() -> None:
    rig = moving()
    rig.settings = replace(rig.settings, gains=replace(rig.settings.gains, stiffness_nm_rad=np.full(4, np.nan)))
    before = rig.command
    rig.tick(100)
    assert rig.command.position_rad == pytest.approx(before.position_rad)
    assert Event.GUARD_REFUSAL.value in rig.events()
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.HOLDING
    refusals = records_of(rig, records.GuardRefusal)
    assert len(refusals) == 1, "once it is held, nothing is refused any more"
    assert isinstance(refusals[0], records.GuardRefusal)
    assert refusals[0].value is None
    assert refusals[0].limit is None


def test_a_clock_step_is_told() -> None:
    rig = standing()
    rig.tick(20)
    rig.spoil["wall_ns"] = rig.now_ns + 9_000_000_000
    rig.tick(20)
    steps = [b.step_s for b in records_of(rig, records.ClockStep) if isinstance(b, records.ClockStep)]
    assert steps == [pytest.approx(4.0, abs=0.01), pytest.approx(-4.0, abs=0.01)], "forth, and back"


def test_legs_that_are_not_where_their_state_says_lose_it() -> None:
    rig = standing()
    rig.settings = replace(rig.settings, poses={S.STANDING: np.full(4, 0.5)})
    rig.tick()
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.HOLDING
    rig.settings = replace(rig.settings, poses={})
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(3)
    assert rig.settle().gait.state is S.STANDING
