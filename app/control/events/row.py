"""What a row of the table of events consists of, and the names of all rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto

from app.control.diagnostics import Diagnostics
from app.ipc.states import Effect, Source


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
    present: Callable[[Diagnostics], bool]
    latch: Latch = Latch.NEVER
    blocks: frozenset[Source] = BOTH  # whose wishes it refuses, from `refuse` upwards
    detail: Callable[[Diagnostics], str] = lambda _: ""  # the numbers, at the moment when it is raised
    displaces: bool = False  # afterwards nobody knows the gait state: it becomes BETWEEN
    settles: bool = False  # keeps its effect while it lingers: its condition may come back at any moment
