"""Every row of the table of events is made to happen and does what it says; acknowledgements; joints that fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.control.events.row import Latch
from app.control.events.table import LINGER_NS, ROW, TABLE
from app.control.running_action import Stage
from app.control.step import STREAM_OF
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState, Source
from app.motion.follower import Mode
from app.text.catalogue import key_of, load, render, use_language
from hal.joints.device import Joint
from hal.joints.guard import limits_of
from hal.joints.protocol import BusFault, DriveFault
from kgdfa.gesture import Gesture
from logs import records
from logs.explain.text import NAMED
from logs.reason import Reason, reason
from tests.app.control.causes import CAUSES, Cause, E, fault, names_in, observed, one, rig_with
from tests.app.control.moments import moving, standing
from tests.app.control.rig import DEVICE, SETTINGS, TICK_NS, Rig


def test_every_row_has_its_test_and_every_event_its_row() -> None:
    assert set(ROW) == set(Event), "a row of app/control/events for each event of app/ipc/states.py"
    assert set(CAUSES) == set(Event), "a way to cause it: CAUSES, tests/app/control/causes.py"
    assert len(TABLE) == len(ROW)


@pytest.mark.parametrize("event", Event)
def test_the_event_happens_with_its_effect_and_is_reported(event: Event) -> None:
    rig = rig_with(event)
    row = ROW[event]
    assert rig.state is not None
    raised = observed(rig, event)
    assert raised, rig.events()
    assert raised[0].effect == row.effect.name.lower()
    quantity = raised[0].quantity
    if event not in {E.GUARD_REFUSAL, E.LINK_POOR}:  # whose quantities are shown as they are recorded
        assert quantity in NAMED | {""}, "word it: _WORDED in logs/explain/text.py, compared.NAME in trail.po"
    assert (quantity == "message_age_ms") is (event in STREAM_OF), "whose message: STREAM_OF in app/control/step.py"
    at_its_time = [state for state, _ in rig.history if any(one.event is event for one in state.events)]
    assert at_its_time
    assert at_its_time[0].effect >= row.effect


@pytest.mark.parametrize("event", [row.event for row in TABLE if row.effect >= Effect.HOLD])
def test_what_holds_or_damps_stops_every_request_and_stays_until_acknowledged(event: Event) -> None:
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
    [event for event, cause in CAUSES.items() if ROW[event].latch is Latch.NEVER and cause.cure is not Cause.cure],
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
    "event",  # a missing pre-flight is present in the tick of the request alone: see test_step
    [row.event for row in TABLE if row.effect is Effect.REFUSE and row.event is not E.NO_PREFLIGHT],
)
@pytest.mark.parametrize("source", Source)
def test_what_refuses_refuses_whom_it_names_and_reports_why(event: Event, source: Source) -> None:
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
    "event", [event for event, cause in CAUSES.items() if ROW[event].effect < Effect.HOLD and not cause.fresh]
)
def test_of_what_stops_nothing_only_legs_far_from_their_pose_lose_their_state(event: Event) -> None:
    rig = rig_with(event)
    assert rig.state is not None
    assert (rig.state.gait.state is GaitState.BETWEEN) is (event is E.FAR_FROM_POSE)


@pytest.mark.parametrize("event", [row.event for row in TABLE if row.effect is Effect.NOTE])
def test_a_note_stops_nothing(event: Event) -> None:
    rig = rig_with(event)
    rig.send(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
    rig.tick()
    assert rig.state is not None
    assert rig.state.running is not None


@pytest.mark.parametrize("event", Event)
@pytest.mark.parametrize("code", ["en", "zh"])
def test_texts_report_what_happened_and_fit_the_screen(event: Event, code: str) -> None:
    use_language(code)
    (raised, *_) = [one for state, _ in rig_with(event).history for one in state.events if one.event is event]
    assert render(raised.reason)
    text = render(Reason(key_of(event), raised.detail | ({"detail": ""} if "detail" in raised.detail else {})))
    assert text[-1] in ".。"
    assert len(text) < 125


@pytest.mark.parametrize("event", [row.event for row in TABLE if row.effect is Effect.HOLD])
@pytest.mark.parametrize("code", ["en", "zh"])
def test_no_text_of_a_stop_says_what_the_legs_do(event: Event, code: str) -> None:
    """It stays on the screen while a second STOP damps them, or while they have no power; the screen says which."""
    text = load(code).gettext(key_of(event))
    assert not any(word in text for word in ("held", "hold", "保持"))


@pytest.mark.parametrize("event", [row.event for row in TABLE if row.latch is Latch.POWERED])
def test_before_the_drives_carry_power_nothing_waits_for_an_acknowledgement(event: Event) -> None:
    if event in {
        E.NEXT_STEP_MISSING,
        E.PAUSE_TOO_LONG,
        E.FAR_FROM_POSE,
        E.JOINT_SANK,
        E.UNEXPECTED_MOTION,
        E.OVER_SPEED,
        E.OVER_TORQUE,
    }:
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


def test_an_acknowledgement_covers_only_what_was_raised_before_it_was_sent() -> None:
    rig = rig_with(E.STOP)
    rig.send(OperatorKind.ACKNOWLEDGE, age_ms=50)
    rig.tick()
    assert E.STOP.value in rig.events()
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick()
    assert rig.events() == set()


def test_an_acknowledged_condition_that_still_holds_keeps_its_effect_until_it_goes() -> None:
    rig = rig_with(E.OVER_TEMPERATURE)
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick(10)
    assert rig.state is not None
    assert rig.state.effect is Effect.HOLD
    CAUSES[E.OVER_TEMPERATURE].cure(rig)
    rig.tick()
    assert rig.events() == set()


def test_an_event_that_comes_back_has_to_be_acknowledged_again() -> None:
    rig = rig_with(E.DRIVE_FAULT)
    CAUSES[E.DRIVE_FAULT].cure(rig)
    rig.tick()
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick()
    assert rig.events() == set()
    CAUSES[E.DRIVE_FAULT].make(rig)
    rig.tick()
    CAUSES[E.DRIVE_FAULT].cure(rig)
    rig.tick(5)
    assert E.DRIVE_FAULT.value in rig.events()


def test_the_strongest_event_stands_first() -> None:
    rig = rig_with(E.TICK_LATE)
    rig.send(OperatorKind.STOP)
    CAUSES[E.DRIVE_UNTRUSTED].make(rig)
    rig.tick()
    assert rig.state is not None
    effects = [ROW[one.event].effect for one in rig.state.events]
    assert effects == sorted(effects, reverse=True)
    assert effects[0] is Effect.DAMP
    assert rig.state.effect is Effect.DAMP


def test_an_unresponsive_joint_counts_within_twenty_milliseconds() -> None:
    rig = standing()
    rig.joints.silent = True
    rig.tick(7)
    assert E.JOINT_TIMEOUT.value not in rig.events()
    rig.tick(2)
    assert E.JOINT_TIMEOUT.value in rig.events()


def stall(rig: Rig, ms: int) -> None:
    """Control misses so many milliseconds; no drive is asked meanwhile."""
    rig.now_ns += ms * 1_000_000
    rig.spoil.update(late_ns=ms * 1_000_000, missed_ticks=ms // 2)


def test_drives_that_nobody_asked_are_not_reported_unresponsive() -> None:
    rig = standing()
    rig.joints.silent = True
    stall(rig, 14)
    rig.tick(2)  # the answer to the first command after it may take longer than until the next tick
    rig.joints.silent = False
    rig.tick(20)
    assert E.JOINT_TIMEOUT.value not in {event for state, _ in rig.history for event in names_in(state)}
    rig.joints.silent = True
    rig.tick(9)
    assert E.JOINT_TIMEOUT.value in rig.events(), "what was excused once is not excused again"


@pytest.mark.parametrize("stalls", [1, 2, 3])
def test_missed_ticks_only_put_off_the_timeout_of_a_drive(stalls: int) -> None:
    rig = standing()
    rig.joints.silent = True
    for _ in range(stalls):
        stall(rig, 14)
        rig.tick(1)
    rig.tick(9 - stalls)
    assert E.JOINT_TIMEOUT.value in rig.events()


def unpowered() -> Rig:
    rig = Rig()
    rig.tick(2)
    rig.send(OperatorKind.CONFIRM_PATIENT)
    rig.tick(20)
    return rig


@pytest.mark.parametrize("joint", Joint)
def test_without_power_a_joint_counts_as_unresponsive_after_a_second(joint: Joint) -> None:
    """The speed that it reported last would refuse power for good, and nobody would know why."""
    rig = unpowered()
    rig.joints.velocity_rad_s = one(2.0)
    rig.tick()
    rig.joints.mute = frozenset({joint})
    rig.tick(500)
    assert E.JOINT_TIMEOUT.value not in rig.events()
    rig.tick(2)
    assert E.JOINT_TIMEOUT.value in rig.events()
    (raised,) = observed(rig, E.JOINT_TIMEOUT)
    assert raised.text == Reason(key_of(E.JOINT_TIMEOUT), {"detail": reason(joint)})
    rig.joints.mute = frozenset()
    rig.joints.velocity_rad_s = np.zeros(4)
    rig.tick(LINGER_NS // TICK_NS + 2)
    assert rig.events() == {E.NOT_ARMED.value}, "nothing to acknowledge: its cable is in again"


def test_without_power_a_joint_that_is_not_asked_is_not_unresponsive() -> None:
    rig = unpowered()
    rig.joints.mute = rig.joints.unasked = frozenset({Joint.LEFT_KNEE})
    rig.tick(1000)
    assert rig.events() == {E.NOT_ARMED.value}
    for _ in range(100):
        stall(rig, 10)
        rig.tick(5)
    rig.joints.mute |= {Joint.RIGHT_HIP}
    rig.tick(502)
    assert E.JOINT_TIMEOUT.value in rig.events()
    (raised,) = observed(rig, E.JOINT_TIMEOUT)
    assert raised.text == Reason(key_of(E.JOINT_TIMEOUT), {"detail": reason(Joint.RIGHT_HIP)})


@pytest.mark.parametrize("swings", [False, True])
def test_the_last_speed_of_a_joint_that_is_not_asked_without_power_refuses_no_power(*, swings: bool) -> None:
    """It was read right after torque off, while the leg swung. With power it is asked again: still no stiffness."""
    rig = unpowered()
    rig.joints.velocity_rad_s = one(0.8)
    rig.joints.mute = rig.joints.unasked = frozenset({Joint.LEFT_KNEE})
    rig.tick(LINGER_NS // TICK_NS + 20)
    rig.send(OperatorKind.ACT, Action.INITIALISE)
    state = rig.run_until(lambda m: m.running is None or m.running.stage is Stage.ENABLING, 10)
    assert state.running is not None
    rig.joints.mute = frozenset()
    rig.joints.velocity_rad_s = one(0.8 * swings)
    state = rig.run_until(lambda m: m.running is None or m.running.stage is Stage.STIFFENING, 10)
    assert (state.motion.mode, E.LEGS_MOVING.value in rig.events()) == (
        (Mode.DISABLED, True) if swings else (Mode.STIFFENING, False)
    )


def test_without_power_control_itself_may_stand_still_for_longer() -> None:
    rig = unpowered()
    rig.joints.silent = True
    stall(rig, 1_200)
    rig.tick(20)
    assert E.JOINT_TIMEOUT.value not in rig.events()


@pytest.mark.parametrize(
    ("knee_rad", "shown"), [(np.radians(90.0), True), (np.radians(121.0), True), (np.radians(123.0), False)]
)
@pytest.mark.parametrize("code", ["en", "zh"])
def test_an_angle_beyond_the_patients_own_limit_names_that_limit(code: str, knee_rad: float, *, shown: bool) -> None:
    """A knee at 90° is not impossible, and its zero is right; 123° are beyond the device's 120° and its margin."""
    use_language(code)
    limits = limits_of(DEVICE, knee_max_rad=np.radians(80.0))
    rig = Rig(settings=replace(SETTINGS, limits=limits, device_high_rad=limits_of(DEVICE).high_rad))
    rig.joints.position_rad = one(knee_rad)
    rig.tick(2)
    (raised,) = observed(rig, E.NOT_HOMED)
    assert isinstance(raised.text, Reason)
    text = render(raised.text)
    assert ("80°" in text and f"{np.degrees(knee_rad):.0f}°" in text) is shown


def test_joints_may_settle_for_half_a_second_after_a_movement() -> None:
    rig = moving()
    rig.run_until(lambda m: m.running is None)
    rig.joints.velocity_rad_s = np.full(4, 0.7)
    rig.tick(249)
    assert E.UNEXPECTED_MOTION.value not in rig.events()
    rig.tick(3)
    assert E.UNEXPECTED_MOTION.value in rig.events()


@pytest.mark.parametrize("what", [fault for fault in DriveFault if fault])
def test_every_drive_fault_stops_the_legs(what: DriveFault) -> None:
    rig = standing()
    rig.joints.faults = fault(what)
    rig.tick()
    assert rig.state is not None
    assert rig.state.effect >= Effect.HOLD


@pytest.mark.parametrize("what", [fault for fault in BusFault if fault])
def test_every_bus_fault_is_an_event(what: BusFault) -> None:
    rig = standing()
    rig.joints.bus = what
    rig.tick()
    assert rig.events() & {E.BUS_FAULT.value, E.BUS_ERRORS.value}
