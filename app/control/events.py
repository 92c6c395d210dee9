"""Everything that can forbid or stop motion, as one table: event → effect, operator text, latched or not.

Adding a fault is adding a row. The strongest effect wins. An event that latches stays in force until the operator
acknowledges it, and an acknowledgement never restarts motion. Unless its row says ALWAYS, an event latches only
while the drives carry power: before that there is nothing that it would have stopped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, Flag, auto
from math import degrees

from app.control.facts import Facts
from app.control.states import Effect, Source
from app.processes import AUDIT_HEALTH, GUARDIAN, OPERATOR, TRIGGER
from hal.joints.joints import BusFault, DriveFault

AUDIT_WAITING_LIMIT = 2_000  # records; a tenth of the queue, about ten seconds of a busy session
TICK_LATE_MS = 2.0  # a whole tick
TICK_STALLED_MS = 20.0
JOINT_SILENT_MS = 15.0  # with a tick and its margin the effect comes within 20 ms
CLOCK_STEP_S = 0.5
HOST_SLEPT_S = 0.1
FOLLOWING_WARN_RAD = 0.14  # 8°, four times the tracking that the plans are checked for
FOLLOWING_LIMIT_RAD = 0.26  # 15°
POSE_LIMIT_RAD = 0.21  # 12°
DRIFT_RAD_S = 0.6
STILL_RAD_S = 0.5
LINGER_NS = 1_000_000_000  # a passing event stays to be read; it has no effect any more, unless it `settles`

# The drive still does what it is told, or is simply off; the others go on holding the wearer.
HELD_FAULTS = (
    DriveFault.OVER_TEMPERATURE
    | DriveFault.OVER_CURRENT
    | DriveFault.OVER_VOLTAGE
    | DriveFault.UNDER_VOLTAGE
    | DriveFault.OVERLOAD
    | DriveFault.LOST_COMMUNICATION
    | DriveFault.UNEXPECTEDLY_DISABLED
)
# The drive's own law can't be trusted any more: stiffness about a wrong angle pushes the leg.
DAMPED_FAULTS = DriveFault.ENCODER | DriveFault.PHASE | DriveFault.WRONG_RANGE | DriveFault.OTHER
HELD_BUS_FAULTS = BusFault.SEND_FAILED | BusFault.BUS_OFF | BusFault.INTERFACE_GONE | BusFault.DUPLICATE_ID
NOTED_BUS_FAULTS = BusFault.ERROR_FRAME | BusFault.ARBITRATION_LOST | BusFault.UNKNOWN_ID | BusFault.MALFORMED


def _any_of(flags: Flag, wanted: Flag) -> bool:
    return flags.value & wanted.value != 0


class Event(Enum):
    """Names of the rows, as they stand in the audit trail."""

    STOP = "STOP"
    STOP_AGAIN = "STOP pressed again"
    SHUTTING_DOWN = "shutting down"
    GIVING_WAY = "shutting down, giving way"
    NOT_ARMED = "not armed"
    NO_PATIENT = "no patient confirmed"
    NO_PREFLIGHT = "pre-flight missing"
    NOT_HOMED = "joint not homed"
    LEGS_MOVING = "legs moving"
    FAR_FROM_POSE = "far from the state's pose"
    CAMERA_STALE = "camera stale"
    PERCEPTION_GONE = "perception gone"
    CONSOLE_SILENT = "console silent"
    AUDIT_BEHIND = "audit behind"
    AUDIT_FULL = "audit queue full"
    AUDIT_GONE = "audit gone"
    AUDIT_FAULT = "audit can't write"
    TICK_LATE = "tick late"
    TICK_STALLED = "control stalled"
    HOST_SLEPT = "host slept"
    CLOCK_JUMP = "clock jump"
    JOINT_SILENT = "joint silent"
    DRIVE_FAULT = "drive fault"
    DRIVE_ASTRAY = "drive astray"
    DRIVES_LOST = "drives lost power"
    DRIVE_ORDER_FAILED = "drives don't obey"
    OVER_TEMPERATURE_WARNING = "joint warm"
    OVER_TEMPERATURE = "joint too hot"
    FOLLOWING_WARNING = "following error"
    FOLLOWING_LIMIT = "following error too large"
    OUT_OF_RANGE = "joint beyond its range"
    OVER_SPEED = "joint too fast"
    OVER_TORQUE = "torque too high"
    GUARD_REFUSAL = "guard refusal"
    BUS_FAULT = "bus fault"
    BUS_DISTURBED = "bus disturbed"
    UNEXPECTED_MOTION = "unexpected motion"
    GUARDIAN_GONE = "guardian gone"
    GUARDIAN_ACTED = "guardian acted"
    PLANNER_STARTING = "planner starting"
    PLANNER_SILENT = "planner silent"
    WALK_BROKEN = "next step missing"
    MESSAGE_REJECTED = "message rejected"


class Latch(Enum):
    """Whether an event stays when its condition has gone."""

    NEVER = auto()
    POWERED = auto()
    ALWAYS = auto()


BOTH = frozenset(Source)
GESTURES = frozenset({Source.GESTURE})


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One event: what makes it present, what it does, what the operator reads."""

    event: Event
    effect: Effect
    text: str
    present: Callable[[Facts], bool]
    latch: Latch = Latch.NEVER
    blocks: frozenset[Source] = BOTH  # whose wishes it refuses, from `refuse` upwards
    detail: Callable[[Facts], str] = lambda _: ""  # the numbers, at the moment when it is raised
    displaces: bool = False  # afterwards nobody knows the gait state: it becomes BETWEEN
    settles: bool = False  # keeps its effect while it lingers: its condition may come back at any moment


E, F = Event, Effect
TABLE = (
    Row(
        event=E.STOP,
        effect=F.HOLD,
        latch=Latch.ALWAYS,
        present=lambda f: f.stop_presses == 1,
        text="STOP: the legs are held. Look at the wearer, then acknowledge.",
    ),
    Row(
        event=E.STOP_AGAIN,
        effect=F.DAMP,
        latch=Latch.ALWAYS,
        present=lambda f: f.stop_presses > 1,
        text="STOP twice: the joints give way slowly. Support the wearer; then torque off or acknowledge.",
    ),
    Row(
        event=E.SHUTTING_DOWN,
        effect=F.HOLD,
        present=lambda f: f.ending and not f.ending_slack,
        text="The session ends: the legs are held, then the joints give way slowly and are switched off.",
    ),
    Row(
        event=E.GIVING_WAY,
        effect=F.DAMP,
        present=lambda f: f.ending and f.ending_slack,
        text="The session ends: the joints give way slowly and are switched off.",
    ),
    Row(
        event=E.NOT_ARMED,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: not f.armed,
        text="Gestures are not armed: arm them when the wearer is ready.",
    ),
    Row(
        event=E.NO_PATIENT,
        effect=F.REFUSE,
        present=lambda f: not f.patient_confirmed,
        text="No patient is confirmed: check who wears the device, then confirm.",
    ),
    Row(
        event=E.NO_PREFLIGHT,
        effect=F.REFUSE,
        present=lambda f: f.uncleared,
        text="No passed pre-flight of this action with this profile: run `rleex simulate all --preflight`.",
    ),
    Row(
        event=E.NOT_HOMED,
        effect=F.REFUSE,
        present=lambda f: not f.powered and f.answering and f.beyond_range,
        text="A joint reads an angle that it can't have: check its zero before power is switched on.",
    ),
    Row(
        event=E.LEGS_MOVING,
        effect=F.REFUSE,
        settles=True,  # a swinging leg is slow for a moment at each turning point
        present=lambda f: not f.powered and f.fastest_rad_s > STILL_RAD_S,
        text="The legs are moving: power comes only when they are still. Wait, or hold them.",
    ),
    Row(
        event=E.FAR_FROM_POSE,
        effect=F.REFUSE,
        latch=Latch.POWERED,
        displaces=True,
        present=lambda f: f.pose_error_rad > POSE_LIMIT_RAD,
        text="The legs are not where their state says: acknowledge, then gesture 0 brings them back slowly.",
        detail=lambda f: f"{degrees(f.pose_error_rad):.0f}°",
    ),
    Row(
        event=E.CAMERA_STALE,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: f.camera_fault != "" or f.picture_age_ms > TRIGGER.stale_ms,
        text="The camera gives no fresh picture: check its cable and light. The therapist's keys still act.",
        detail=lambda f: f.camera_fault,
    ),
    Row(
        event=E.PERCEPTION_GONE,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: f.perception_age_ms > TRIGGER.stale_ms,
        text="Gesture recognition has gone silent; it is started again. The therapist's keys still act.",
    ),
    Row(
        event=E.CONSOLE_SILENT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.console_age_ms > OPERATOR.stale_ms,
        text="The console was silent and STOP could not have been heard: the legs are held.",
    ),
    Row(
        event=E.AUDIT_BEHIND,
        effect=F.REFUSE,
        present=lambda f: f.audit_waiting > AUDIT_WAITING_LIMIT,
        text="The audit trail can't keep up: wait until it has written what is queued.",
        detail=lambda f: f"{f.audit_waiting} records",
    ),
    Row(
        event=E.AUDIT_FULL,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.audit_full,
        text="The audit queue is full, records were lost: the legs are held. End the session.",
    ),
    Row(
        event=E.AUDIT_GONE,
        effect=F.REFUSE,
        present=lambda f: f.audit_age_ms > AUDIT_HEALTH.stale_ms,
        text="Nobody writes the audit trail: no new action without a record. End the session.",
    ),
    Row(
        event=E.AUDIT_FAULT,
        effect=F.REFUSE,
        present=lambda f: f.audit_fault != "",
        text="The audit trail can't be written: free some space on the disk or end the session.",
        detail=lambda f: f.audit_fault,
    ),
    Row(
        event=E.TICK_LATE,
        effect=F.NOTE,
        present=lambda f: f.missed_ticks > 0 or f.late_ms > TICK_LATE_MS,
        text="Control was late by a tick or more: close other programs if it happens again.",
        detail=lambda f: f"{f.late_ms:.1f} ms late, {f.missed_ticks} left out",
    ),
    Row(
        event=E.TICK_STALLED,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.late_ms > TICK_STALLED_MS,
        text="Control stood still for a moment: the legs are held. Close other programs.",
        detail=lambda f: f"{f.late_ms:.0f} ms",
    ),
    Row(
        event=E.HOST_SLEPT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.slept_s > HOST_SLEPT_S,
        text="The computer slept: the legs are held. Switch its sleep off.",
        detail=lambda f: f"{f.slept_s:.1f} s",
    ),
    Row(
        event=E.CLOCK_JUMP,
        effect=F.NOTE,
        present=lambda f: abs(f.clock_step_s) > CLOCK_STEP_S,
        text="The wall clock was moved: times in the audit trail step here.",
        detail=lambda f: f"{f.clock_step_s:+.1f} s",
    ),
    Row(
        event=E.JOINT_SILENT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.joint_age_ms > JOINT_SILENT_MS if f.powered else not f.answering,
        text="A joint does not answer: the legs are held. Check its cable and supply.",
        detail=lambda f: f.drive_detail,
    ),
    Row(
        event=E.DRIVE_FAULT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.drive_faults, HELD_FAULTS),
        text="A drive reports a fault: the other joints hold. Support the wearer.",
        detail=lambda f: f.drive_detail,
    ),
    Row(
        event=E.DRIVE_ASTRAY,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.drive_faults, DAMPED_FAULTS),
        text="A drive can't be trusted: the joints give way slowly. Support the wearer.",
        detail=lambda f: f.drive_detail,
    ),
    Row(
        event=E.DRIVES_LOST,
        effect=F.HOLD,
        latch=Latch.ALWAYS,
        present=lambda f: f.drives_lost,
        text="The drives lost power: support the wearer. Acknowledge, then gesture 0 powers them again.",
        detail=lambda f: f.drive_detail,
    ),
    Row(
        event=E.DRIVE_ORDER_FAILED,
        effect=F.REFUSE,
        latch=Latch.ALWAYS,
        present=lambda f: f.drive_error != "",
        text="The drives did not do what they were told.",
        detail=lambda f: f.drive_error,
    ),
    Row(
        event=E.OVER_TEMPERATURE_WARNING,
        effect=F.NOTE,
        present=lambda f: f.warm,
        text="A joint is getting warm: plan a pause.",
        detail=lambda f: f"{f.hottest_c:.0f} °C",
    ),
    Row(
        event=E.OVER_TEMPERATURE,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.hot,
        text="A joint is too hot: the legs are held. Support the wearer, STOP twice and let it cool.",
        detail=lambda f: f"{f.hottest_c:.0f} °C",
    ),
    Row(
        event=E.FOLLOWING_WARNING,
        effect=F.NOTE,
        present=lambda f: f.following_rad > FOLLOWING_WARN_RAD,
        text="A joint lags behind its target: is something in the way, or the wearer tense?",
        detail=lambda f: f"{degrees(f.following_rad):.0f}°",
    ),
    Row(
        event=E.FOLLOWING_LIMIT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.following_rad > FOLLOWING_LIMIT_RAD,
        text="A joint can't follow: the legs are held. Something is in the way.",
        detail=lambda f: f"{degrees(f.following_rad):.0f}°",
    ),
    Row(
        event=E.OUT_OF_RANGE,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.beyond_range,
        text="A joint went beyond its range: the legs are held.",
    ),
    Row(
        event=E.OVER_SPEED,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.beyond_speed,
        text="A joint moved faster than it may: the joints give way slowly. Support the wearer.",
    ),
    Row(
        event=E.OVER_TORQUE,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.beyond_torque,
        text="A joint pushed harder than it may: the joints give way slowly. Support the wearer.",
    ),
    Row(
        event=E.GUARD_REFUSAL,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.guard_refusal != "",
        text="The guard refused a joint command: the legs are held. Tell the engineer.",
        detail=lambda f: f.guard_refusal,
    ),
    Row(
        event=E.BUS_FAULT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.bus, HELD_BUS_FAULTS),
        text="The bus to the drives fails: the legs are held as far as commands arrive.",
        detail=lambda f: f.drive_detail,
    ),
    Row(
        event=E.BUS_DISTURBED,
        effect=F.NOTE,
        present=lambda f: _any_of(f.bus, NOTED_BUS_FAULTS),
        text="The bus to the drives is disturbed: check termination and plugs.",
        detail=lambda f: f.drive_detail,
    ),
    Row(
        event=E.UNEXPECTED_MOTION,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.drift_rad_s > DRIFT_RAD_S,
        text="A joint moved while it was held: the joints give way slowly. Support the wearer.",
    ),
    Row(
        event=E.GUARDIAN_GONE,
        effect=F.REFUSE,
        present=lambda f: f.guardian_age_ms > GUARDIAN.stale_ms or f.guardian_fault != "",
        detail=lambda f: f.guardian_fault,
        text="The guardian is gone, nobody would stop the joints if control died: end the session.",
    ),
    Row(
        event=E.GUARDIAN_ACTED,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.guardian_acted,
        text="Control was silent: the guardian lets the joints give way. Support the wearer; torque off, acknowledge.",
    ),
    Row(
        event=E.PLANNER_STARTING,
        effect=F.REFUSE,
        present=lambda f: not f.planner_ready,
        text="The planner is getting ready: a few seconds yet.",
    ),
    Row(
        event=E.PLANNER_SILENT,
        effect=F.REFUSE,
        latch=Latch.POWERED,
        present=lambda f: f.planner_silent,
        text="The planner did not answer: the action was given up. Acknowledge and try again.",
    ),
    Row(
        event=E.WALK_BROKEN,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.walk_broken,
        text="The next step was not planned in time: the legs are held. Acknowledge, then gesture 0.",
    ),
    Row(
        event=E.MESSAGE_REJECTED,
        effect=F.NOTE,
        present=lambda f: f.rejected_messages > 0,
        text="A message between the programs did not make sense and was left out.",
    ),
)
ROW = {row.event: row for row in TABLE}
ORDER = {row.event: place for place, row in enumerate(TABLE)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Active:
    """An event in force, or one that has just gone and is shown a little longer."""

    event: Event
    since_ns: int
    last_ns: int  # when its condition held last
    latched: bool
    present: bool = True
    acknowledged: bool = False
    detail: str = ""

    @property
    def in_force(self) -> bool:
        """Its condition holds, or held so lately that it may again, or it waits for its acknowledgement."""
        return self.present or ROW[self.event].settles or (self.latched and not self.acknowledged)


Actives = tuple[Active, ...]


def advance(active: Actives, facts: Facts, acknowledged_ns: int = 0) -> Actives:
    """The events after a tick, strongest first.

    acknowledged_ns: when the operator acknowledged, 0 if not in this tick; it covers only what was raised before.
    """
    present = [row for row in TABLE if row.present(facts)]
    if not present and not active:
        return active
    raised = {row.event for row in present}
    kept = [_updated(one, facts, acknowledged_ns, present=one.event in raised) for one in active]
    known = {one.event for one in kept if one is not None}
    new = (_raised(row, facts) for row in present if row.event not in known)
    return tuple(sorted((one for one in (*kept, *new) if one is not None), key=_place))


def effect_of(active: Actives) -> Effect:
    """What all events in force together do: the strongest wins."""
    return max((ROW[one.event].effect for one in active if one.in_force), default=Effect.NOTE)


def blocker(active: Actives, source: Source) -> Active | None:
    """The strongest event in force that refuses this source's wishes."""
    return next((one for one in active if one.in_force and _blocks(ROW[one.event], source)), None)


def displaced(active: Actives) -> bool:
    """Whether the legs may be anywhere."""
    return any(one.in_force and ROW[one.event].displaces for one in active)


def sentence(one: Active) -> str:
    """For the operator: what happened, what to do, and the numbers."""
    return f"{ROW[one.event].text} ({one.detail})" if one.detail else ROW[one.event].text


def _blocks(row: Row, source: Source) -> bool:
    return row.effect >= Effect.REFUSE and source in row.blocks


def _place(one: Active) -> tuple[int, int]:
    return (-ROW[one.event].effect, ORDER[one.event])


def _latches(row: Row, facts: Facts) -> bool:
    return row.latch is Latch.ALWAYS or (row.latch is Latch.POWERED and facts.powered)


def _raised(row: Row, facts: Facts) -> Active:
    return Active(
        event=row.event,
        since_ns=facts.now_ns,
        last_ns=facts.now_ns,
        latched=_latches(row, facts),
        detail=row.detail(facts),
    )


def _updated(one: Active, facts: Facts, acknowledged_ns: int, *, present: bool) -> Active | None:
    """The event a tick later; None when it is over."""
    acknowledged = one.acknowledged or (one.latched and acknowledged_ns > one.since_ns)
    if present:
        return replace(
            one,
            present=True,
            last_ns=facts.now_ns,
            latched=one.latched or _latches(ROW[one.event], facts),
            acknowledged=acknowledged,
        )
    if one.latched:
        return None if acknowledged else replace(one, present=False)
    return replace(one, present=False) if facts.now_ns - one.last_ns < LINGER_NS else None
