"""What a tick is given and what it gives back: values only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from msgspec import Struct

from app.ipc.messages import AuditHealth, GuardianHealth, OperatorCommand, TriggerReport
from app.ipc.states import Action, GaitState
from app.motion.follower import Gains
from app.motion.plan import Plan, PlanRequest
from hal.joints.guard import Limits, Refusal
from hal.joints.protocol import JointArray, JointCommand, JointFeedback
from logs.reason import Reason
from logs.records import Body


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """One session's constants; poses (4,) a state, radians."""

    limits: Limits
    gains: Gains
    poses: Mapping[GaitState, JointArray]
    warn_c: JointArray
    limit_c: JointArray
    patient: str
    simulated: bool = True


class Inputs(Struct, frozen=True, kw_only=True):
    """Everything that one tick may know; what is None or empty has not come since the tick before."""

    now_ns: int  # monotonic, read once at the tick's start
    wall_ns: int
    boot_ns: int  # as monotonic, but going on while the host sleeps
    feedback: JointFeedback
    report: TriggerReport | None = None
    commands: tuple[OperatorCommand, ...] = ()
    plans: tuple[Plan, ...] = ()
    audit: AuditHealth | None = None
    guardian: GuardianHealth | None = None
    late_ns: int = 0  # how late this tick began
    missed_ticks: int = 0  # left out before this one
    written: JointCommand | None = None  # the command that really left, in the tick before
    written_ns: int = 0  # when
    guard_refusal: Refusal | None = None  # of the command of the tick before
    audit_full: bool = False  # a record of the tick before found the queue full
    rejected_messages: int = 0  # since the tick before
    drive_error: Reason | None = None  # why the order of the tick before to the drives failed
    must_end: bool = False  # the console is gone, or a signal asked for the end
    cleared: frozenset[Action] | None = None  # passed the pre-flight; None: none is needed (simulated joints)


class DriveOrder(Enum):
    """What the shell has to do with the drives beside writing the command."""

    NONE = "none"
    ENABLE = "enable"
    DISABLE = "disable"


class Outputs(Struct, frozen=True, kw_only=True):
    """What the shell has to do after a tick."""

    command: JointCommand
    drives: DriveOrder = DriveOrder.NONE
    requests: tuple[PlanRequest, ...] = ()
    audit: tuple[Body, ...] = ()
    finished: bool = False  # the drives are off and the process may end
