"""Every row of the table of events is made to happen, and does what its row says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import msgspec
import numpy as np
import pytest

from app.control.events import LINGER_NS, ROW, TABLE, Event, Latch
from app.control.follow import Mode
from app.control.memory import Memory
from app.control.states import Action, Effect, GaitState, Source
from app.messages import OperatorKind
from hal.joints.guard import Quantity, Refusal
from hal.joints.joints import BusFault, DriveFault, DriveState, Joint, JointArray
from kgdfa.hand import Gesture
from logs import records
from tests.app.control.moments import standing
from tests.app.control.rig import Rig

E = Event


@dataclass(frozen=True)
class Cause:
    """How an event is brought about in a standing rig (or a fresh one), and how its condition goes away again."""

    make: Callable[[Rig], object]
    cure: Callable[[Rig], object] = lambda _: None
    ticks: int = 1
    fresh: bool = False  # happens before the drives carry power


def spoil(**fields: object) -> Callable[[Rig], None]:
    """Fields of the inputs, for one tick."""
    return lambda rig: rig.spoil.update(fields)


def names_in(memory: Memory) -> set[str]:
    """The events of a tick."""
    return {one.event.value for one in memory.active}


def joints(**fields: object) -> Callable[[Rig], None]:
    """Fields of the joints, from now on."""

    def change(rig: Rig) -> None:
        for name, value in fields.items():
            setattr(rig.joints, name, value)

    return change


def world(**fields: object) -> Callable[[Rig], None]:
    """Fields of the rig, from now on."""

    def change(rig: Rig) -> None:
        for name, value in fields.items():
            setattr(rig, name, value)

    return change


def fault(what: DriveFault) -> tuple[DriveFault, DriveFault, DriveFault, DriveFault]:
    """In the third drive."""
    return (DriveFault.NONE, DriveFault.NONE, what, DriveFault.NONE)


def one(value: float, rest: float = 0.0) -> JointArray:
    """(4,) with one joint different."""
    values = np.full(4, rest)
    values[Joint.LEFT_KNEE] = value
    return values


def lag(rad: float) -> Callable[[Rig], None]:
    """The joints are stuck that far from where they are told to be."""

    def change(rig: Rig) -> None:
        rig.joints.stuck = True
        rig.joints.position_rad = rig.joints.position_rad + one(rad)

    return change


def unlag(rig: Rig) -> None:
    """They follow again."""
    rig.joints.stuck = False


def say(*kinds: OperatorKind) -> Callable[[Rig], None]:
    """The operator's words."""

    def speak(rig: Rig) -> None:
        for kind in kinds:
            rig.say(kind)

    return speak


def wish(action: Action) -> Callable[[Rig], None]:
    """The therapist's key."""
    return lambda rig: rig.say(OperatorKind.ACT, action)


def walk_without_planner(rig: Rig) -> None:
    """The planner dies while a step of a walk runs."""
    rig.say(OperatorKind.ACT, Action.WALK)
    rig.tick(4)
    rig.planning = False
    rig.tick(420)


def never_answered(rig: Rig) -> None:
    """The planner is still loading."""
    assert rig.memory is not None
    rig.memory = msgspec.structs.replace(rig.memory, planner_ready=False)


def answered(rig: Rig) -> None:
    """It has loaded."""
    assert rig.memory is not None
    rig.memory = msgspec.structs.replace(rig.memory, planner_ready=True)


def pushed(rig: Rig) -> None:
    """A finished step has left the legs in another state's pose."""
    rig.settings = replace(rig.settings, poses={GaitState.STANDING: np.full(4, 0.5)})


REFUSED = Refusal(joint=Joint.LEFT_HIP, quantity=Quantity.SPEED, value=9.0, limit=4.0)
CALM = (DriveFault.NONE,) * 4
SHUT = OperatorKind.SHUT_DOWN
CAUSES: dict[Event, Cause] = {
    E.STOP: Cause(say(OperatorKind.STOP)),
    E.STOP_AGAIN: Cause(say(OperatorKind.STOP, OperatorKind.STOP)),
    E.SHUTTING_DOWN: Cause(say(SHUT)),
    E.GIVING_WAY: Cause(say(SHUT), ticks=230),
    E.NOT_ARMED: Cause(say(OperatorKind.DISARM), say(OperatorKind.ARM)),
    E.NO_PATIENT: Cause(lambda rig: rig.tick(), say(OperatorKind.CONFIRM_PATIENT), fresh=True),
    E.NO_PREFLIGHT: Cause(lambda rig: (world(cleared=frozenset())(rig), wish(Action.WALK)(rig))),
    E.NOT_HOMED: Cause(joints(position_rad=one(2.4)), joints(position_rad=np.zeros(4)), fresh=True),
    E.LEGS_MOVING: Cause(joints(velocity_rad_s=one(-0.51)), joints(velocity_rad_s=one(0.49)), fresh=True),
    E.FAR_FROM_POSE: Cause(pushed),
    E.CAMERA_STALE: Cause(world(report={"camera_fault": "unplugged"}), world(report={}), ticks=40),
    E.PERCEPTION_GONE: Cause(world(watching=False), world(watching=True), ticks=140),
    E.CONSOLE_SILENT: Cause(world(alive=False), world(alive=True), ticks=140),
    E.AUDIT_BEHIND: Cause(world(audit_health={"waiting": 2001}), world(audit_health={}), ticks=40),
    E.AUDIT_FULL: Cause(spoil(audit_full=True)),
    E.AUDIT_GONE: Cause(world(auditing=False), world(auditing=True), ticks=230),
    E.AUDIT_FAULT: Cause(world(audit_health={"fault": "disk full"}), world(audit_health={}), ticks=40),
    E.TICK_LATE: Cause(spoil(late_ns=2_100_000)),
    E.TICK_STALLED: Cause(spoil(late_ns=20_100_000, missed_ticks=10)),
    E.HOST_SLEPT: Cause(lambda rig: rig.spoil.update(boot_ns=rig.now_ns + 9_000_000_000)),
    E.CLOCK_JUMP: Cause(lambda rig: rig.spoil.update(wall_ns=rig.now_ns + 7_000_000_000)),
    E.JOINT_SILENT: Cause(joints(silent=True), joints(silent=False), ticks=9),
    E.DRIVE_FAULT: Cause(joints(faults=fault(DriveFault.OVER_CURRENT)), joints(faults=CALM)),
    E.DRIVE_ASTRAY: Cause(joints(faults=fault(DriveFault.ENCODER)), joints(faults=CALM)),
    E.DRIVES_LOST: Cause(joints(state=DriveState.DISABLED)),
    E.DRIVE_ORDER_FAILED: Cause(
        lambda rig: (joints(refuse_enable="left hip is silent")(rig), wish(Action.INITIALISE)(rig)),
        ticks=4,
        fresh=True,
    ),
    E.OVER_TEMPERATURE_WARNING: Cause(joints(temperature_c=one(65.0, 30.0)), joints(temperature_c=np.full(4, 30.0))),
    E.OVER_TEMPERATURE: Cause(joints(temperature_c=one(80.0, 30.0)), joints(temperature_c=np.full(4, 30.0))),
    E.FOLLOWING_WARNING: Cause(lag(0.15), unlag),
    E.FOLLOWING_LIMIT: Cause(lag(0.27), unlag),
    E.OUT_OF_RANGE: Cause(lag(2.2), unlag),
    E.OVER_SPEED: Cause(joints(velocity_rad_s=one(-5.8)), joints(velocity_rad_s=np.zeros(4))),
    E.OVER_TORQUE: Cause(joints(torque_nm=one(-116.0)), joints(torque_nm=np.zeros(4))),
    E.GUARD_REFUSAL: Cause(spoil(guard_refusal=REFUSED)),
    E.BUS_FAULT: Cause(joints(bus=BusFault.BUS_OFF), joints(bus=BusFault.NONE)),
    E.BUS_DISTURBED: Cause(joints(bus=BusFault.ERROR_FRAME), joints(bus=BusFault.NONE)),
    E.UNEXPECTED_MOTION: Cause(joints(velocity_rad_s=one(0.61)), joints(velocity_rad_s=np.zeros(4))),
    E.GUARDIAN_GONE: Cause(world(guarding=False), world(guarding=True), ticks=160),
    E.GUARDIAN_ACTED: Cause(world(guardian_health={"acted": True}), world(guardian_health={}), ticks=40),
    E.PLANNER_STARTING: Cause(never_answered, answered, fresh=True),
    E.PLANNER_SILENT: Cause(lambda rig: (world(planning=False)(rig), wish(Action.WALK)(rig)), ticks=260),
    E.WALK_BROKEN: Cause(walk_without_planner, world(planning=True)),
    E.MESSAGE_REJECTED: Cause(spoil(rejected_messages=1)),
}


def rig_with(event: Event) -> Rig:
    """A rig in which the event has just been brought about, and is in force or was in one of the last ticks."""
    cause = CAUSES[event]
    rig = Rig()
    if cause.fresh:
        rig.tick(2)
        rig.say(OperatorKind.ARM)
        if event is not E.NO_PATIENT:
            rig.say(OperatorKind.CONFIRM_PATIENT)
        rig.tick(20)
    else:
        rig = standing()
        assert rig.events() == set()
    cause.make(rig)
    rig.tick(cause.ticks)
    return rig


def seen(rig: Rig, event: Event) -> list[records.EventRaised]:
    """The trail's records of it."""
    return [body for body in rig.audit if isinstance(body, records.EventRaised) and body.event == event.value]


def test_every_row_has_its_test_and_every_event_its_row() -> None:
    assert set(CAUSES) == set(Event) == set(ROW)
    assert len(TABLE) == len(ROW)


@pytest.mark.parametrize("event", Event)
def test_the_event_happens_with_its_effect_and_is_told(event: Event) -> None:
    rig = rig_with(event)
    row = ROW[event]
    assert rig.memory is not None
    raised = seen(rig, event)
    assert raised, rig.events()
    assert raised[0].effect == row.effect.name.lower()
    assert raised[0].text.startswith(row.text)
    at_its_time = [memory for memory, _ in rig.history if any(one.event is event for one in memory.active)]
    assert at_its_time
    assert at_its_time[0].effect >= row.effect


@pytest.mark.parametrize("event", [event for event in Event if ROW[event].effect >= Effect.HOLD])
def test_what_holds_or_damps_stops_every_wish_and_stays_until_acknowledged(event: Event) -> None:
    rig = rig_with(event)
    CAUSES[event].cure(rig)
    rig.tick(30)
    row = ROW[event]
    assert rig.memory is not None
    if row.latch is Latch.NEVER:
        assert event in {E.SHUTTING_DOWN, E.GIVING_WAY}, "a hold or a damp is left only deliberately"
        return
    assert event.value in rig.events()
    refusals = rig.memory.refusal_count
    rig.say(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
    rig.tick()
    assert rig.memory.refusal_count == refusals + 1
    assert rig.memory.task is None
    still = rig.command
    rig.say(OperatorKind.ACKNOWLEDGE)
    rig.tick(100)
    if event is not E.STOP_AGAIN and row.effect < Effect.DAMP and rig.memory.motion.mode is not Mode.LIMP:
        assert np.array_equal(rig.command.position_rad, still.position_rad), "acknowledging moves nothing"
    assert event.value not in rig.events()
    assert rig.memory.gait.running is None


@pytest.mark.parametrize(
    "event",
    [event for event in Event if ROW[event].latch is Latch.NEVER and CAUSES[event].cure is not Cause.cure],
)
def test_what_does_not_latch_goes_with_its_condition(event: Event) -> None:
    rig = rig_with(event)
    assert event.value in rig.events()
    CAUSES[event].cure(rig)
    rig.tick(60)
    assert (event.value in rig.events()) is ROW[event].settles
    rig.tick(LINGER_NS // 2_000_000 + 60)
    assert event.value not in rig.events()
    assert rig.memory is not None
    assert event not in {one.event for one in rig.memory.active}
    assert [b for b in rig.audit if isinstance(b, records.EventCleared) and b.event == event.value]


@pytest.mark.parametrize(
    "event",  # a missing pre-flight is present in the tick of the wish alone: see test_step
    [event for event in Event if ROW[event].effect is Effect.REFUSE and event is not E.NO_PREFLIGHT],
)
@pytest.mark.parametrize("source", Source)
def test_what_refuses_refuses_whom_it_names_and_says_why(event: Event, source: Source) -> None:
    rig = rig_with(event)
    action, gesture = Action.STEP_RIGHT_FIRST, Gesture.ONE
    if CAUSES[event].fresh:
        action, gesture = Action.INITIALISE, Gesture.ZERO
    row = ROW[event]
    if source is Source.THERAPIST:
        rig.say(OperatorKind.ACT, action)
    elif event is E.PERCEPTION_GONE:
        rig.release(gesture)
        rig.tick(20)
        assert rig.memory is not None
        assert rig.memory.task is None
        return
    else:
        rig.release(gesture)
    rig.tick(18)
    assert rig.memory is not None
    granted = rig.memory.task is not None
    assert granted is (source not in row.blocks)
    if not granted:
        assert rig.memory.refusal.startswith(row.text) or not rig.watching


@pytest.mark.parametrize(
    "event", [event for event in Event if ROW[event].effect < Effect.HOLD and not CAUSES[event].fresh]
)
def test_of_what_stops_nothing_only_legs_far_from_their_pose_lose_their_state(event: Event) -> None:
    rig = rig_with(event)
    assert rig.memory is not None
    assert (rig.memory.gait.state is GaitState.BETWEEN) is (event is E.FAR_FROM_POSE)


@pytest.mark.parametrize("event", [event for event in Event if ROW[event].effect is Effect.NOTE])
def test_a_note_stops_nothing(event: Event) -> None:
    rig = rig_with(event)
    rig.say(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
    rig.tick()
    assert rig.memory is not None
    assert rig.memory.task is not None


@pytest.mark.parametrize("event", Event)
def test_texts_say_what_happened_and_fit_the_screen(event: Event) -> None:
    text = ROW[event].text
    assert text[-1] in ".?"
    assert text[0].isupper()
    assert 25 < len(text) < 110


@pytest.mark.parametrize("event", [event for event in Event if ROW[event].latch is Latch.POWERED])
def test_before_the_drives_carry_power_nothing_waits_for_an_acknowledgement(event: Event) -> None:
    if event in {E.WALK_BROKEN, E.FAR_FROM_POSE, E.UNEXPECTED_MOTION, E.OVER_SPEED, E.OVER_TORQUE}:
        return  # can't come about without power
    rig = Rig()
    rig.tick(2)
    rig.say(OperatorKind.CONFIRM_PATIENT)
    rig.tick(200)
    assert rig.events() == {E.NOT_ARMED.value}
    CAUSES[event].make(rig)
    rig.tick(CAUSES[event].ticks)
    CAUSES[event].cure(rig)
    rig.tick(40)
    assert event.value not in rig.events()


def test_an_acknowledgement_covers_only_what_was_raised_before_it_was_sent() -> None:
    rig = rig_with(E.STOP)
    rig.say(OperatorKind.ACKNOWLEDGE, age_ms=50)
    rig.tick()
    assert E.STOP.value in rig.events()
    rig.say(OperatorKind.ACKNOWLEDGE)
    rig.tick()
    assert rig.events() == set()


def test_an_acknowledged_condition_that_still_holds_keeps_its_effect_until_it_goes() -> None:
    rig = rig_with(E.OVER_TEMPERATURE)
    rig.say(OperatorKind.ACKNOWLEDGE)
    rig.tick(10)
    assert rig.memory is not None
    assert rig.memory.effect is Effect.HOLD
    CAUSES[E.OVER_TEMPERATURE].cure(rig)
    rig.tick()
    assert rig.events() == set()


def test_an_event_that_comes_back_has_to_be_acknowledged_again() -> None:
    rig = rig_with(E.DRIVE_FAULT)
    CAUSES[E.DRIVE_FAULT].cure(rig)
    rig.tick()
    rig.say(OperatorKind.ACKNOWLEDGE)
    rig.tick()
    assert rig.events() == set()
    CAUSES[E.DRIVE_FAULT].make(rig)
    rig.tick()
    CAUSES[E.DRIVE_FAULT].cure(rig)
    rig.tick(5)
    assert E.DRIVE_FAULT.value in rig.events()


def test_the_strongest_event_stands_first() -> None:
    rig = rig_with(E.TICK_LATE)
    rig.say(OperatorKind.STOP)
    CAUSES[E.DRIVE_ASTRAY].make(rig)
    rig.tick()
    assert rig.memory is not None
    effects = [ROW[one.event].effect for one in rig.memory.active]
    assert effects == sorted(effects, reverse=True)
    assert effects[0] is Effect.DAMP
    assert rig.memory.effect is Effect.DAMP


def test_a_silent_joint_counts_within_twenty_milliseconds() -> None:
    rig = standing()
    rig.joints.silent = True
    rig.tick(7)
    assert E.JOINT_SILENT.value not in rig.events()
    rig.tick(2)
    assert E.JOINT_SILENT.value in rig.events()


def stall(rig: Rig, ms: int) -> None:
    """Control misses so many milliseconds; no drive is asked meanwhile."""
    rig.now_ns += ms * 1_000_000
    rig.spoil.update(late_ns=ms * 1_000_000, missed_ticks=ms // 2)


def test_drives_that_nobody_asked_are_not_called_silent() -> None:
    rig = standing()
    rig.joints.silent = True
    stall(rig, 14)
    rig.tick(2)  # the answer to the first command after it may take longer than until the next tick
    rig.joints.silent = False
    rig.tick(20)
    assert E.JOINT_SILENT.value not in {event for memory, _ in rig.history for event in names_in(memory)}
    rig.joints.silent = True
    rig.tick(9)
    assert E.JOINT_SILENT.value in rig.events(), "what was excused once is not excused again"


@pytest.mark.parametrize("stalls", [1, 2, 3])
def test_missed_ticks_only_put_off_the_silence_of_a_drive(stalls: int) -> None:
    rig = standing()
    rig.joints.silent = True
    for _ in range(stalls):
        stall(rig, 14)
        rig.tick(1)
    rig.tick(9 - stalls)
    assert E.JOINT_SILENT.value in rig.events()


@pytest.mark.parametrize("what", [fault for fault in DriveFault if fault])
def test_every_drive_fault_stops_the_legs(what: DriveFault) -> None:
    rig = standing()
    rig.joints.faults = fault(what)
    rig.tick()
    assert rig.memory is not None
    assert rig.memory.effect >= Effect.HOLD


@pytest.mark.parametrize("what", [fault for fault in BusFault if fault])
def test_every_bus_fault_is_an_event(what: BusFault) -> None:
    rig = standing()
    rig.joints.bus = what
    rig.tick()
    assert rig.events() & {E.BUS_FAULT.value, E.BUS_DISTURBED.value}
