"""How each row of the table of events is brought about in a rig, and how its condition goes away again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from app.control.state import ControlState
from app.ipc.messages import LinkHealth, OperatorKind
from app.ipc.states import Action, Event, GaitState
from hal.errors import HardwareError
from hal.inputs.device import Contact, ContactReading, InputDevice, InputRole
from hal.inputs.reader import InputReader
from hal.joints.guard import Quantity, Refusal
from hal.joints.protocol import BusFault, DriveFault, DriveState, Joint, JointArray
from logs import records
from logs.reason import reason_of
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


def link_of(**figures: float) -> LinkHealth:
    """A good link to the console's computer but for these figures."""
    good = {"round_trip_ms": 8.0, "jitter_ms": 2.0, "loss": 0.0, "uncertainty_ns": 4_000_000}
    return LinkHealth(at_ns=0, host="laptop", connected=True, **{**good, **figures})  # type: ignore[arg-type]


def names_in(state: ControlState) -> set[str]:
    """The events of a tick."""
    return {one.event.value for one in state.events}


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
    """The joints are stuck that far from their target."""

    def change(rig: Rig) -> None:
        rig.joints.stuck = True
        rig.joints.position_rad = rig.joints.position_rad + one(rad)

    return change


def sink_in_silence(rig: Rig) -> None:
    """A joint does not answer for a while, and then answers from elsewhere."""
    rig.joints.silent = True
    rig.tick(9)
    rig.joints.silent = False
    lag(0.15)(rig)


def unlag(rig: Rig) -> None:
    """They follow again."""
    rig.joints.stuck = False


def send(*kinds: OperatorKind) -> Callable[[Rig], None]:
    """The operator's words."""

    def speak(rig: Rig) -> None:
        for kind in kinds:
            rig.send(kind)

    return speak


def request(action: Action) -> Callable[[Rig], None]:
    """The therapist's key."""
    return lambda rig: rig.send(OperatorKind.ACT, action)


def walk_without_planner(rig: Rig) -> None:
    """The planner dies while a step of a walk runs."""
    rig.send(OperatorKind.ACT, Action.WALK)
    rig.tick(4)
    rig.answer_ticks = 10_000
    rig.tick(420)


def planner_answers(rig: Rig) -> None:
    """What it was asked meanwhile."""
    rig.answer_ticks = 1
    rig._asked = [(1, asked) for _, asked in rig._asked]


def silent_console_in_motion(rig: Rig) -> None:
    """The console stops answering for good while the legs move."""
    rig.plan_s = 3.0
    rig.send(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
    rig.tick(100)
    rig.alive = False
    rig.run_until(lambda state: E.PAUSE_TOO_LONG in {one.event for one in state.events})


def never_answered(rig: Rig) -> None:
    """The planner is still loading."""
    assert rig.state is not None
    rig.state = msgspec.structs.replace(rig.state, planner_ready=False)


def only_loading(rig: Rig) -> None:
    """Perception shows frames and loads the hand model."""
    assert rig.state is not None
    rig.state = msgspec.structs.replace(rig.state, streams=msgspec.structs.replace(rig.state.streams, recognised=False))
    rig.report = {"detector_ready": False}


def answered(rig: Rig) -> None:
    """It has loaded."""
    assert rig.state is not None
    rig.state = msgspec.structs.replace(rig.state, planner_ready=True)


def pushed(rig: Rig) -> None:
    """A finished step has left the legs in another state's pose."""
    rig.settings = replace(rig.settings, poses={GaitState.STANDING: np.full(4, 0.5)})


@dataclass
class Switch:
    """A stop input in the test's hand."""

    contact: Contact = Contact.CLOSED
    fault: HardwareError | None = None

    def open(self, now_ns: int) -> None:
        pass

    def read(self, now_ns: int) -> ContactReading:
        return ContactReading(Contact.SILENT if self.fault else self.contact, self.fault)

    def close(self) -> None:
        pass


def with_switch(rig: Rig, role: InputRole = InputRole.WEARER, contact: Contact = Contact.CLOSED) -> Switch:
    """Give the rig a stop input."""
    switch = Switch(contact)
    rig.stop_inputs = InputReader((InputDevice(name="pendant", role=role, kind="simulated"),), (switch,))
    return switch


def press(role: InputRole) -> Callable[[Rig], object]:
    """A stop input that is pressed."""
    return lambda rig: with_switch(rig, role, Contact.OPEN)


def release(rig: Rig) -> None:
    """And let go."""
    assert rig.stop_inputs is not None
    (switch,) = rig.stop_inputs._inputs
    assert isinstance(switch, Switch)
    switch.contact = Contact.CLOSED


def stop_reading(rig: Rig) -> None:
    """The stop inputs are read no more."""
    with_switch(rig)
    rig.tick(5)
    rig.reading = False


def read_on(rig: Rig) -> None:
    """And read again."""
    rig.reading = True


def release_and_unlag(rig: Rig) -> None:
    """And the joints follow again."""
    release(rig)
    unlag(rig)


DISK_FULL = reason_of(OSError("disk full"))
REFUSED = Refusal(joint=Joint.LEFT_HIP, quantity=Quantity.SPEED, value=9.0, limit=4.0)
CALM = (DriveFault.NONE,) * 4
SHUT = OperatorKind.SHUT_DOWN
CAUSES: dict[Event, Cause] = {
    E.STOP: Cause(send(OperatorKind.STOP)),
    E.STOP_AGAIN: Cause(send(OperatorKind.STOP, OperatorKind.STOP)),
    E.VOICE_STOP: Cause(send(OperatorKind.VOICE_STOP)),
    E.HARDWIRED_STOP: Cause(press(InputRole.EMERGENCY_STOP), release),
    E.HARDWIRED_STOP_SANK: Cause(lambda rig: (press(InputRole.EMERGENCY_STOP)(rig), lag(0.15)(rig)), release_and_unlag),
    E.WEARER_STOP: Cause(press(InputRole.WEARER), release),
    E.THERAPIST_STOP: Cause(press(InputRole.THERAPIST), release),
    E.STOP_INPUT_UNPRESSED: Cause(with_switch, fresh=True),
    E.SHUTTING_DOWN: Cause(send(SHUT)),
    E.SHUTDOWN_DAMPING: Cause(send(SHUT), ticks=230),
    E.NOT_ARMED: Cause(send(OperatorKind.DISARM), send(OperatorKind.ARM)),
    E.NO_PATIENT: Cause(lambda rig: rig.tick(), send(OperatorKind.CONFIRM_PATIENT), fresh=True),
    E.NO_PREFLIGHT: Cause(lambda rig: (world(cleared=frozenset())(rig), request(Action.WALK)(rig))),
    E.NOT_HOMED: Cause(joints(position_rad=one(2.4)), joints(position_rad=np.zeros(4)), fresh=True),
    E.LEGS_MOVING: Cause(joints(velocity_rad_s=one(-0.51)), joints(velocity_rad_s=one(0.49)), fresh=True),
    E.FAR_FROM_POSE: Cause(pushed),
    E.CAMERA_STALE: Cause(world(report={"camera_fault": reason_of(OSError("unplugged"))}), world(report={}), ticks=40),
    E.PERCEPTION_TIMEOUT: Cause(world(watching=False), world(watching=True), ticks=140),
    E.CONSOLE_TIMEOUT: Cause(world(alive=False), world(alive=True), ticks=140),
    E.AUDIT_BACKLOG: Cause(world(audit_health={"waiting": 2001}), world(audit_health={}), ticks=40),
    E.AUDIT_QUEUE_FULL: Cause(spoil(audit_full=True)),
    E.AUDIT_TIMEOUT: Cause(world(auditing=False), world(auditing=True), ticks=230),
    E.AUDIT_WRITE_FAILED: Cause(world(audit_health={"fault": DISK_FULL}), world(audit_health={}), ticks=40),
    E.TICK_LATE: Cause(spoil(late_ns=2_100_000)),
    E.CONTROL_LATE: Cause(spoil(late_ns=20_100_000, missed_ticks=10)),
    E.CONTROL_STALLED: Cause(spoil(late_ns=50_100_000, missed_ticks=25)),
    E.STOP_INPUTS_LATE: Cause(stop_reading, read_on, ticks=14),
    E.HOST_SUSPENDED: Cause(lambda rig: rig.spoil.update(boot_ns=rig.now_ns + 9_000_000_000)),
    E.CLOCK_JUMP: Cause(lambda rig: rig.spoil.update(wall_ns=rig.now_ns + 7_000_000_000)),
    E.JOINT_TIMEOUT: Cause(joints(silent=True), joints(silent=False), ticks=9),
    E.JOINT_SANK: Cause(sink_in_silence, unlag),
    E.DRIVE_FAULT: Cause(joints(faults=fault(DriveFault.OVER_CURRENT)), joints(faults=CALM)),
    E.DRIVE_UNTRUSTED: Cause(joints(faults=fault(DriveFault.ENCODER)), joints(faults=CALM)),
    E.DRIVES_POWER_LOST: Cause(joints(state=DriveState.DISABLED)),
    E.DRIVE_ORDER_FAILED: Cause(
        lambda rig: (joints(refuse_enable="left hip is silent")(rig), request(Action.INITIALISE)(rig)),
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
    E.BUS_ERRORS: Cause(joints(bus=BusFault.ERROR_FRAME), joints(bus=BusFault.NONE)),
    E.UNEXPECTED_MOTION: Cause(joints(velocity_rad_s=one(0.61)), joints(velocity_rad_s=np.zeros(4))),
    E.GUARDIAN_TIMEOUT: Cause(world(guarding=False), world(guarding=True), ticks=160),
    E.GUARDIAN_ACTED: Cause(world(guardian_health={"acted": True}), world(guardian_health={}), ticks=40),
    E.PERCEPTION_STARTING: Cause(only_loading, world(report={}), fresh=True),
    E.PLANNER_STARTING: Cause(never_answered, answered, fresh=True),
    E.PLANNER_TIMEOUT: Cause(lambda rig: (world(planning=False)(rig), request(Action.WALK)(rig)), ticks=260),
    E.NEXT_STEP_MISSING: Cause(walk_without_planner, planner_answers),
    E.PAUSE_TOO_LONG: Cause(silent_console_in_motion, world(alive=True)),
    E.MESSAGE_REJECTED: Cause(spoil(rejected_messages=1)),
    E.FOREIGN_PEER: Cause(spoil(foreign_peers=1)),
    E.LINK_POOR: Cause(spoil(link=link_of(loss=0.2)), spoil(link=link_of(loss=0.0))),
}


def rig_with(event: Event) -> Rig:
    """A rig in which the event has just been brought about, and is in force or was in one of the last ticks."""
    cause = CAUSES[event]
    rig = Rig()
    if cause.fresh:
        rig.tick(2)
        rig.send(OperatorKind.ARM)
        if event is not E.NO_PATIENT:
            rig.send(OperatorKind.CONFIRM_PATIENT)
        rig.tick(20)
    else:
        rig = standing()
        assert rig.events() == set()
    cause.make(rig)
    rig.tick(cause.ticks)
    return rig


def observed(rig: Rig, event: Event) -> list[records.EventRaised]:
    """The trail's records of it."""
    return [body for body in rig.audit if isinstance(body, records.EventRaised) and body.event == event.value]
