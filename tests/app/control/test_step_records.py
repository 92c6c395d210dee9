"""What a tick measures and records: moments, tracking, transitions, events."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from app.control.diagnostics import LOADING_MS
from app.control.effects import END_HOLD_NS
from app.control.events.table import LINGER_NS
from app.control.running_action import Stage
from app.control.state import REPORTS_KEPT, ControlState
from app.control.telemetry import JointStatisticsCollector
from app.ipc.states import Effect, Event, RequestRefusal
from app.ipc.streams import TRIGGER
from app.motion.follower import Mode
from hal.joints.guard import SPEED_MARGIN, Quantity, Refusal
from hal.joints.protocol import DriveState, Joint
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import reason
from tests.app.control.moments import DAMPING_TICKS, A, B, K, S, damped, moving, now, records_of, standing
from tests.app.control.rig import TICK_NS, Rig


def only(rig: Rig, kind: type[B]) -> B:
    """The one that there is."""
    (body,) = records_of(rig, kind)
    return body


@pytest.mark.parametrize(
    ("value", "limit", "kept"),
    [
        (9.0, 4.0, (9.0, 4.0)),
        (-9.0, 4.0, (-9.0, 4.0)),
        (math.nan, math.inf, (None, None)),
        (-math.inf, 4.0, (None, 4.0)),
        (math.inf, 4.0, (None, 4.0)),
        (9.0, math.inf, (9.0, None)),
    ],
)
def test_a_refusal_keeps_the_numbers_that_are_some(
    value: float, limit: float, kept: tuple[float | None, float | None]
) -> None:
    rig = moving()
    refused = Refusal(joint=Joint.LEFT_KNEE, quantity=Quantity.SPEED, value=value, limit=limit)
    rig.spoil["guard_refusal"] = refused
    rig.tick()
    body = only(rig, records.GuardRefusal)
    assert (body.value, body.limit) == kept
    assert (body.joint, body.quantity, body.reason) == (
        "left_knee",
        Quantity.SPEED.value,
        reason(refused.code, **refused.values),
    )


def test_an_event_that_is_over_reports_how_long_it_was_there() -> None:
    rig = standing()
    rig.audit.clear()
    rig.spoil["wall_ns"] = rig.now_ns + 9_000_000_000
    rig.tick()
    raised = only(rig, records.EventRaised)
    assert (raised.event, raised.effect) == (Event.CLOCK_JUMP.value, "note")
    raised_ns = rig.now_ns
    rig.run_until(lambda m: not m.events)
    cleared = records_of(rig, records.EventCleared)[-1]
    assert (cleared.event, cleared.effect) == (Event.CLOCK_JUMP.value, "note")
    assert cleared.total is None, "the sum of what it compared means nothing"
    assert cleared.lasted_s == (rig.now_ns - raised_ns) / 1e9
    assert cleared.lasted_s == pytest.approx(LINGER_NS / 1e9, abs=0.01)


@pytest.mark.parametrize("field", ["foreign_peers", "rejected_messages"])
def test_a_flood_is_one_record_that_comes_and_one_that_goes_with_all_it_counted(field: str) -> None:
    rig = standing()
    rig.audit.clear()
    for _ in range(20):
        rig.spoil[field] = 700
        rig.tick(250)  # links tell of them twice a second
    rig.tick(LINGER_NS // TICK_NS + 10)
    raised, cleared = only(rig, records.EventRaised), only(rig, records.EventCleared)
    assert (raised.value, cleared.total) == (700, 14_000)


def test_a_stream_that_stopped_reports_for_how_long() -> None:
    rig = standing()
    rig.watching = False
    rig.run_until(lambda _: Event.PERCEPTION_TIMEOUT.value in rig.events())
    lost = only(rig, records.HeartbeatLost)
    assert lost.stream == TRIGGER.name
    assert TRIGGER.stale_ms < lost.age_ms <= TRIGGER.stale_ms + TICK_NS / 1e6
    lost_ns = rig.now_ns
    rig.tick(250)
    rig.watching = True
    rig.run_until(lambda _: Event.PERCEPTION_TIMEOUT.value not in rig.events())
    heard_ns = rig.now_ns
    rig.tick(LINGER_NS // TICK_NS + 10)
    found = only(rig, records.HeartbeatFound)
    assert found.stream == TRIGGER.name
    assert found.silent_ms == pytest.approx(lost.age_ms + (heard_ns - TICK_NS - lost_ns) / 1e6)


def test_the_end_holds_for_just_so_long() -> None:
    rig = standing()
    rig.send(K.SHUT_DOWN)
    rig.tick()
    began_ns = rig.now_ns
    assert now(rig).effect is Effect.HOLD
    rig.run_until(lambda m: m.effect is Effect.DAMP)
    assert rig.now_ns - began_ns == END_HOLD_NS + TICK_NS
    assert END_HOLD_NS == 400_000_000


def test_torque_off_is_reported_once_and_not_for_the_next_time_that_the_joints_are_damped() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(300)
    rig.send(K.TORQUE_OFF)
    rig.run_until(lambda _: rig.joints.state is DriveState.DISABLED)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(60)
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(1000)
    assert now(rig).effect is Effect.DAMP
    assert rig.joints.state is DriveState.ENABLED


@pytest.mark.parametrize("joint", Joint)
def test_the_joint_that_is_unresponsive_is_named(joint: Joint) -> None:
    rig = standing()
    silent_since_ns = rig.now_ns
    for _ in range(9):
        feedback = rig.joints.feedback(rig.now_ns + TICK_NS)
        feedback.measured_ns[joint] = silent_since_ns
        rig.spoil["feedback"] = feedback
        rig.tick()
    (raised,) = (body for body in records_of(rig, records.EventRaised) if body.event == Event.JOINT_TIMEOUT.value)
    assert raised.text == reason(Event.JOINT_TIMEOUT, detail=joint)


def test_a_request_while_the_legs_come_to_rest_is_asked_to_wait() -> None:
    rig = moving()
    rig.send(K.STOP)
    rig.tick()
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    assert not now(rig).motion.settled
    rig.send(K.ACT, A.INITIALISE)
    rig.tick()
    assert now(rig).refusal == reason(RequestRefusal.COMING_TO_REST)
    assert now(rig).running is None
    rig.settle()
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING


def test_damping_continues_from_the_command_that_left_when_one_is_refused() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(30)
    left = rig.command
    rig.spoil["guard_refusal"] = Refusal(joint=Joint.LEFT_KNEE, quantity=Quantity.SPEED, value=9.0, limit=4.0)
    rig.tick()
    assert now(rig).motion.mode is Mode.DAMPED
    assert now(rig).motion.origin is left
    assert rig.command.stiffness_nm_rad.max() <= left.stiffness_nm_rad.max()
    rig.tick(DAMPING_TICKS + 1)
    assert now(rig).motion.fully_damped
    assert rig.command.stiffness_nm_rad.max() == 0


def test_asking_twice_for_the_end_does_not_put_it_off() -> None:
    rig = standing()
    rig.send(K.SHUT_DOWN)
    rig.tick()
    began_ns = now(rig).ending_ns
    rig.tick(50)
    rig.send(K.SHUT_DOWN)
    rig.tick()
    assert now(rig).ending_ns == began_ns


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
    assert (end.first_command_ns, end.outcome) == (first_ns, "completed")


def test_an_actions_end_holds_the_sessions_steps_and_distance_so_far() -> None:
    rig = standing()
    before = now(rig).steps
    for action in (A.STEP_RIGHT_FIRST, A.STEP_LEFT, A.STEP_RIGHT, A.STEP_END):
        rig.act(action)
    ends = records_of(rig, records.ActionEnd)[-4:]
    assert [end.steps - before for end in ends] == [1, 2, 3, 4]
    assert ends[-1].distance_m == now(rig).distance_walked_m


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
    states = [(b.from_state, b.to_state, b.action) for b in records_of(rig, records.Transition)]
    assert states == [
        ("standing", "right leg forward", A.STEP_RIGHT_FIRST.value),
        ("right leg forward", "standing", A.STEP_END.value),
        ("standing", "right leg high step", A.STAIR_UP.value),
        ("right leg high step", "standing", A.STAIR_UP.value),
        ("standing", "sitting", A.SIT_DOWN.value),
    ]


def test_the_effect_and_the_streams_are_reported_when_they_change() -> None:
    rig = standing()
    rig.watching = False
    rig.tick(140)
    rig.watching = True
    rig.tick(700)
    effects = [(b.from_effect, b.to_effect) for b in records_of(rig, records.EffectChanged)]
    assert effects == [("note", "refuse"), ("refuse", "note")]
    lost = [b.stream for b in records_of(rig, records.HeartbeatLost)]
    found = [b.stream for b in records_of(rig, records.HeartbeatFound)]
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
    assert refusals[0].value is None
    assert refusals[0].limit is None


def test_a_clock_step_is_reported() -> None:
    rig = standing()
    rig.tick(20)
    rig.spoil["wall_ns"] = rig.now_ns + 9_000_000_000
    rig.tick(20)
    steps = [b.step_s for b in records_of(rig, records.ClockStep)]
    assert steps == [pytest.approx(4.0, abs=0.01), pytest.approx(-4.0, abs=0.01)], "forth, and back"


def test_legs_that_are_not_where_their_state_requires_lose_it() -> None:
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


def test_an_event_records_the_value_and_the_limit_that_it_compared() -> None:
    rig = standing()
    rig.audit.clear()
    rig.spoil["late_ns"] = 55_000_000
    rig.tick()
    by_event = {body.event: body for body in records_of(rig, records.EventRaised)}
    stalled = by_event[Event.CONTROL_STALLED.value]
    assert (stalled.quantity, stalled.value, stalled.limit) == ("late_ms", 55.0, 50.0)
    assert stalled.raised_ns == rig.now_ns


def test_an_event_of_a_joint_records_the_joint_that_exceeds_most_with_its_limit() -> None:
    rig = standing()
    rig.audit.clear()
    feedback = rig.joints.feedback(rig.now_ns + TICK_NS)
    feedback.velocity_rad_s[:] = (8.0, 9.0, 0.0, 0.0)
    rig.spoil["feedback"] = feedback
    rig.tick()
    (raised,) = (body for body in records_of(rig, records.EventRaised) if body.event == Event.OVER_SPEED.value)
    limits = SPEED_MARGIN * rig.settings.limits.speed_rad_s
    worst = int(np.argmax(np.array((8.0, 9.0, 0.0, 0.0)) - limits))
    assert (raised.quantity, raised.joint) == ("speed_rad_s", Joint(worst).name.lower())
    assert (raised.value, raised.limit) == (feedback.velocity_rad_s[worst], limits[worst])


def test_a_refusal_names_the_event_with_its_numbers_and_the_gesture_with_its_moments() -> None:
    rig = standing()
    rig.spoil["late_ns"] = 55_000_000
    rig.tick()
    rig.report = {"released_recognised_ns": 77}
    rig.release(Gesture.FIVE)
    rig.run_until(lambda _: bool(records_of(rig, records.Refusal)))
    body = only(rig, records.Refusal)
    (raised,) = (one for one in records_of(rig, records.EventRaised) if one.event == Event.CONTROL_STALLED.value)
    assert (body.event, body.raised_ns) == (raised.event, raised.raised_ns)
    assert (body.quantity, body.value, body.limit) == ("late_ms", 55.0, 50.0)
    assert (body.recognised_ns, body.refused_ns) == (77, rig.now_ns)
    assert 0 < body.released_ns < body.refused_ns


def test_stop_is_recorded_with_its_first_joint_command() -> None:
    rig = moving()
    rig.audit.clear()
    rig.send(K.STOP)
    rig.tick()
    assert records_of(rig, records.Stop) == []
    seen_ns = rig.now_ns
    rig.tick()
    body = only(rig, records.Stop)
    assert (body.sent_ns, body.seen_ns) == (seen_ns, seen_ns)
    assert body.command_ns == now(rig).stop_command_ns == seen_ns + TICK_NS // 2


def test_a_stop_in_the_last_tick_is_recorded() -> None:
    rig = Rig()
    rig.tick(5)
    rig.audit.clear()
    rig.send(K.STOP)
    rig.send(K.SHUT_DOWN)
    rig.tick()
    assert rig.outputs is not None
    assert rig.outputs.finished
    body = only(rig, records.Stop)
    assert (body.seen_ns, body.command_ns) == (rig.now_ns, 0), "no joint command was written for it any more"


def test_a_plan_names_the_action_that_it_is_for() -> None:
    rig = moving()
    numbers = {body.number for body in records_of(rig, records.Command)}
    assert {body.command for body in records_of(rig, records.PlanChecked)} == numbers


def test_while_recognition_starts_no_camera_is_called_stale() -> None:
    """Neither before its first message, nor while it shows frames and loads the hand model."""
    rig = Rig(watching=False)
    rig.tick(500)
    assert {Event.PERCEPTION_STARTING.value} == {
        one for one in rig.events() if one[:10] in ("perception", "camera-sta")
    }
    rig.watching, rig.report = True, {"detector_ready": False, "captured_ns": 1}
    rig.tick(500)
    assert Event.CAMERA_STALE.value not in rig.events()
    rig.report = {"captured_ns": 1}
    rig.tick(20)
    assert Event.CAMERA_STALE.value in rig.events()
    assert Event.PERCEPTION_STARTING.value not in [one.event.value for one in now(rig).events if one.present]
    silent = Rig(watching=False)
    silent.tick(2)
    silent.now_ns += int(LOADING_MS * 1e6)  # nobody waits longer
    silent.tick(2)
    present = {one.event for one in now(silent).events if one.present}
    assert Event.PERCEPTION_TIMEOUT in present
    assert Event.PERCEPTION_STARTING not in present


def test_recognition_that_is_only_loading_has_not_timed_out() -> None:
    rig = standing()
    rig.report = {"detector_ready": False}
    rig.tick(30)
    rig.watching = False
    rig.tick(500)
    assert Event.PERCEPTION_TIMEOUT.value not in rig.events()
    rig.watching, rig.report = True, {}
    rig.tick(30)
    rig.watching = False
    rig.tick(130)
    assert Event.PERCEPTION_TIMEOUT.value in rig.events()


@pytest.mark.parametrize("resting", [Rig, damped])
def test_where_nothing_is_held_the_trail_has_no_target(resting: Callable[[], Rig]) -> None:
    """Off, and damped: a position of the command is then without effect."""
    rig, collector = resting(), JointStatisticsCollector(10)
    for _ in range(10):
        state = rig.tick()
        collector.add(rig.joints.feedback(rig.now_ns), state.motion.command)
    found = collector.take(0.02, "standing")
    assert found.target_mean_rad == found.tracking_rms_rad == (None,) * 4
    assert None not in found.angle_mean_rad


def test_where_the_legs_are_held_the_trail_has_the_command() -> None:
    rig, collector = standing(), JointStatisticsCollector(10)
    for _ in range(10):
        state = rig.tick()
        collector.add(rig.joints.feedback(rig.now_ns), state.motion.command)
    assert collector.take(0.02, "standing").target_mean_rad == pytest.approx(rig.command.position_rad.tolist())
