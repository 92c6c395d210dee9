"""Walking through the ticks: no pause, no jump, and every way in which a walk ends."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest

from app.control.inputs import Settings
from app.control.running_action import Stage
from app.ipc.states import Event, Outcome, Source
from app.motion.follower import Mode
from app.motion.plan import Phase, Plan, PlanCheck, PlanRequest, patient_of
from app.motion.trajectory import nominal_pose, plan
from hal.joints.protocol import TICK_HZ
from kgdfa.gesture import Gesture
from logs.reason import reason, reason_of
from profiles.schema import DEMO_PATIENT
from tests.app.control.instant_planner import POSES, make_plan
from tests.app.control.moments import HOLD_TICKS, A, K, S, moving, now, request, standing
from tests.app.control.rig import DEVICE, SETTINGS, Rig

PATIENT = patient_of(DEMO_PATIENT, DEVICE)


def test_a_walk_has_no_pause_and_no_jump_between_its_steps() -> None:
    rig = standing()
    rig.send(K.ACT, A.WALK)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.history.clear()
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT and m.motion.row > 20)
    rows = [state.motion.row for state, _ in rig.history]
    phases = [state.gait.phase for state, _ in rig.history]
    assert {Phase.WALK_START, Phase.WALK_RIGHT, Phase.WALK_LEFT} == set(phases)
    for (before, after), (one, other) in zip(pairwise(rows), pairwise(phases), strict=True):
        assert after == (before + 1 if one is other else 1)
    commands = [outputs.command.position_rad for _, outputs in rig.history]
    assert max(float(np.abs(b - a).max()) for a, b in pairwise(commands)) < 0.01


def test_a_walk_counts_its_steps_and_its_distance() -> None:
    rig = standing()
    rig.send(K.ACT, A.WALK)
    rig.run_until(lambda m: m.steps == 3)
    rig.send(K.ACT, A.WALK_END)
    state = rig.settle()
    assert state.steps == 5
    assert state.distance_walked_m == pytest.approx(1.5)


def test_gesture_6_in_the_last_tick_of_a_step_still_ends_the_walk_with_it() -> None:
    rig = moving(A.WALK)
    rig.run_until(lambda m: m.motion.rows_left == 1)
    phase = now(rig).gait.phase
    rig.send(K.ACT, A.WALK_END)
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
    assert Event.PAUSE_TOO_LONG.value in rig.events()
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.HOLDING


def test_a_walk_whose_closing_step_can_not_be_planned_goes_no_farther() -> None:
    rig = moving(A.WALK)
    rig.refuse_plans, rig.refused = "too far", frozenset({A.WALK_END})
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_RIGHT)
    rig.tick(3)
    assert now(rig).gait.closing, "while there is a whole step to slow down on"
    steps = now(rig).steps
    rig.tick(800)
    assert now(rig).steps == steps
    assert Event.PAUSE_TOO_LONG.value in rig.events()
    assert (now(rig).gait.state, now(rig).motion.mode) == (S.BETWEEN, Mode.HOLDING)


@pytest.mark.parametrize("rows_left", [1, 2, 10, 25, 37, 42])
@pytest.mark.parametrize("by_event", [False, True])
def test_a_walk_closed_at_the_end_of_a_step_without_the_closing_plan_is_held(rows_left: int, by_event: bool) -> None:
    rig = moving(A.WALK)
    rig.unanswered = frozenset({A.WALK_END})
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_RIGHT and m.motion.rows_left == rows_left)
    if by_event:
        rig.audit_health["fault"] = reason(Event.AUDIT_WRITE_FAILED)
        rig.spoil = {"audit": rig._audit()}
    else:
        rig.send(K.ACT, A.WALK_END)
    before = rig.command
    while now(rig).running is not None or not now(rig).motion.settled:
        rig.tick()
        assert rig._refusal is None
        assert np.abs(rig.command.position_rad - before.position_rad).max() < 0.01
        before = rig.command
    assert (now(rig).gait.state, now(rig).motion.mode) == (S.BETWEEN, Mode.HOLDING)
    assert {report.outcome for report in now(rig).reports[-1 if by_event else -2 :]} == {Outcome.STOPPED}
    assert now(rig).reports[-1].reason is not None
    rig.unanswered, rig.audit_health = frozenset(), {}
    rig.tick(600)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert rig.act(A.INITIALISE).gait.state is S.STANDING


@dataclass(repr=False)
class PlannedRig(Rig):
    """Its plans are real ones: a step of a walk ends with the legs moving."""

    settings: Settings = field(
        default_factory=lambda: replace(SETTINGS, poses={state: nominal_pose(state, PATIENT) for state in POSES})
    )

    def _answer(self, plan_request: PlanRequest) -> Plan:
        return plan(plan_request, PATIENT)


def test_a_walk_that_is_stopped_at_the_end_of_a_step_slows_down_along_the_next() -> None:
    rig = PlannedRig()
    rig.tick(2)
    rig.send(K.CONFIRM_PATIENT)
    rig.act(A.INITIALISE)
    rig.send(K.ACT, A.WALK)
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_START and 0 < m.motion.rows_left <= 10)
    assert np.abs(now(rig).motion.command.velocity_rad_s).max() > np.radians(20)
    commands = [rig.command]
    rig.send(K.STOP)
    for _ in range(HOLD_TICKS + 5):
        rig.tick()
        commands.append(rig.command)
    assert (now(rig).gait.state, now(rig).motion.mode) == (S.BETWEEN, Mode.HOLDING)
    velocity = TICK_HZ * np.diff([command.position_rad for command in commands], axis=0)
    commanded = np.array([command.velocity_rad_s for command in commands[1:]])
    assert np.degrees(np.abs(velocity - commanded)).max() < 1
    assert np.degrees(np.abs(np.diff(velocity, axis=0))).max() < 1
    assert velocity[-1].tolist() == [0.0] * 4


def test_a_late_plan_of_the_step_before_closes_no_walk() -> None:
    rig = moving(A.WALK)
    rig.unanswered = frozenset({A.WALK_END})
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_RIGHT)
    (overdue,) = [one for one in rig.history[-1][1].plan_requests if one.action is A.WALK_END]
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    rig.unanswered = frozenset()
    rig.tick(5)
    late = msgspec.structs.replace(make_plan(overdue), check=PlanCheck(reason=reason_of(OSError("too far"))))
    rig.spoil = {"plans": (late,)}
    rig.tick()
    assert not now(rig).gait.closing
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_RIGHT)


def test_a_late_next_step_is_taken_as_long_as_it_comes_before_the_last_call() -> None:
    rig = moving(A.WALK)
    rig.answer_ticks = 120
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    assert rig.events() == set()


@pytest.mark.parametrize("source", Source)
def test_when_perception_goes_a_walk_of_the_wearer_ends_and_the_therapists_continues(source: Source) -> None:
    rig = standing()
    request(rig, A.WALK, source)
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    rig.watching = False
    rig.tick(700)
    assert Event.PERCEPTION_TIMEOUT.value in rig.events()
    if source is Source.THERAPIST:
        assert not now(rig).gait.closing
        return
    assert now(rig).gait.running is not None, "the running step is carried out"
    assert rig.settle().gait.state is S.STANDING
    assert now(rig).reports[-1].outcome is Outcome.COMPLETED
    assert now(rig).reports[-1].reason is not None, "and the walk says why it ended"
    rig.release(Gesture.FIVE)
    rig.tick(100)
    assert now(rig).running is None


def test_a_walk_that_the_wearer_has_ended_was_ended_by_no_event_that_comes_after() -> None:
    rig = standing()
    request(rig, A.WALK, Source.GESTURE)
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    request(rig, A.WALK_END, Source.GESTURE)
    rig.run_until(lambda m: m.gait.closing)
    rig.audit_health = {"fault": reason_of(OSError("disk full"))}
    rig.run_until(lambda _: Event.AUDIT_WRITE_FAILED.value in rig.events())
    assert rig.settle().gait.state is S.STANDING
    assert now(rig).reports[-1].reason is None


def test_when_the_trail_stops_any_walk_ends_normally() -> None:
    rig = moving(A.WALK)
    rig.auditing = False
    rig.run_until(lambda _: Event.AUDIT_TIMEOUT.value in rig.events())
    assert now(rig).gait.closing, "in the very tick that the event is raised"
    assert rig.settle().gait.state is S.STANDING
    assert now(rig).reports[-1].outcome is Outcome.COMPLETED


@pytest.mark.parametrize("source", Source)
def test_a_walk_of_the_wearer_ends_while_a_restarted_perception_loads_its_hand_model(source: Source) -> None:
    """Its frames are fresh, but it sees no gesture, and so not the one that ends the walk."""
    rig = standing()
    request(rig, A.WALK, source)
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    rig.watching = False
    rig.tick(450)
    rig.restart_perception()
    rig.watching, rig.report = True, {"detector_ready": False}
    rig.tick(650)
    running, ended_by = now(rig).running, reason(Event.PERCEPTION_STARTING)
    assert running is not None
    assert running.walk_ended_by == (ended_by if source is Source.GESTURE else None)


def test_a_perception_that_has_loaded_its_hand_model_in_time_ends_no_walk() -> None:
    rig = standing()
    request(rig, A.WALK, Source.GESTURE)
    rig.run_until(lambda m: m.gait.phase is Phase.WALK_LEFT)
    rig.restart_perception()
    rig.report = {"detector_ready": False}
    rig.tick(450)
    rig.report = {}
    rig.tick(600)
    assert not now(rig).gait.closing
    assert rig.events() == set()
