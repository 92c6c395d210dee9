"""Control's snapshot, and what it is made of: joints, events in force, actions from recognition to end, pauses.

A receiver is given the newest only: what may not be missed is counted, or stays in the newest few.
"""

from __future__ import annotations

from msgspec import Struct

from app.ipc.messages import TriggerReport
from app.ipc.states import ACTION_OF, Action, Effect, Event, GaitState, Outcome, PauseCause, Source
from hal.inputs.device import InputRole
from logs.reason import Reason, Value, key_of

Quad = tuple[float, float, float, float]  # in the order of hal.joints.protocol.Joint


class JointSnapshot(Struct, frozen=True, kw_only=True):
    """One joint as the screen shows it."""

    angle_rad: float
    target_rad: float
    speed_rad_s: float
    torque_nm: float
    temperature_c: float
    age_ms: float
    faults: tuple[Reason, ...] = ()


class ActiveEvent(Struct, frozen=True, kw_only=True):
    """An event in force, or waiting for its acknowledgement."""

    event: Event
    detail: dict[str, Value] = {}  # when it was raised; units in the names
    effect: Effect
    since_ns: int
    number: int  # of its identity: `since_ns` by control's clock, which no link converts
    present: bool  # the condition still holds
    acknowledged: bool

    @property
    def identity(self) -> tuple[Event, int]:
        """The same in every snapshot until the event is raised again; over a link `since_ns` is not."""
        return self.event, self.number

    @property
    def reason(self) -> Reason:
        """The event with its values, to be rendered."""
        return Reason(key_of(self.event), self.detail)


class ActionReport(Struct, frozen=True, kw_only=True):
    """One action from recognition to its end; 0 where a moment has not come (or there was no gesture)."""

    number: int
    action: Action
    source: Source
    from_state: GaitState
    to_state: GaitState | None = None
    outcome: Outcome = Outcome.RUNNING
    reason: Reason | None = None
    recognised_ns: int = 0
    released_ns: int = 0
    accepted_ns: int = 0
    first_command_ns: int = 0
    first_motion_ns: int = 0
    ended_ns: int = 0
    tracking_rms_rad: float = 0.0


class PauseSummary(Struct, frozen=True, kw_only=True):
    """The session's pauses that are over, and the newest of them."""

    count: int = 0
    total_s: float = 0.0
    cause: PauseCause | None = None
    duration_s: float = 0.0
    ended_ns: int = 0
    resumed: bool = True  # the action went on


class Lateness(Struct, frozen=True, kw_only=True):
    """How late ticks began, over the session."""

    ticks: int = 0
    missed: int = 0
    p50_ms: float = 0.0
    p99_ms: float = 0.0
    p999_ms: float = 0.0
    max_ms: float = 0.0


class RealTime(Struct, frozen=True, kw_only=True):
    """Which real-time privileges control got."""

    fifo: bool = False
    memory_locked: bool = False
    cores_awake: bool = False
    core: int | None = None


class StopInputSnapshot(Struct, frozen=True, kw_only=True):
    """One button that stops."""

    name: str
    role: InputRole
    open: bool  # pressed, unplugged or without an answer: it stops
    pressed_once: bool  # and let go, in this session


class ControlSnapshot(Struct, frozen=True, kw_only=True, tag="control"):
    """Control to console and demo."""

    incarnation: int
    sequence: int
    at_ns: int
    state: GaitState
    effect: Effect
    armed: bool
    patient_confirmed: bool
    enabled: bool  # the drives are powered
    damped: bool = False  # or on the way to it, by an event in force or one that has been acknowledged
    action: Action | None = None
    progress: float = 0.0  # of the running plan, 0-1
    pending: Action | None = None  # gesture 6, latched
    allowed: tuple[Action, ...] = ()
    by_key_only: tuple[Action, ...] = ()  # their gestures are not in the patient's vocabulary
    uncleared: tuple[Action, ...] = ()  # refused until they have passed the pre-flight of real joints
    why_not: Reason | None = None  # why nothing is allowed, when nothing is
    joints: tuple[JointSnapshot, JointSnapshot, JointSnapshot, JointSnapshot]
    events: tuple[ActiveEvent, ...] = ()
    stop_inputs: tuple[StopInputSnapshot, ...] = ()
    reports: tuple[ActionReport, ...] = ()  # the newest few, oldest first
    refusal: Reason | None = None  # the newest
    refusal_count: int = 0
    lease: int = 1  # of the console that control hears
    stop_received_ns: int = 0
    stop_command_ns: int = 0
    stop_lease: int = 0  # of the console whose STOP was the newest that control acted on
    stop_sequence: int = 0  # of that STOP
    pauses: PauseSummary = PauseSummary()
    steps: int = 0
    distance_walked_m: float = 0.0
    lateness: Lateness = Lateness()
    real_time: RealTime = RealTime()
    report_age_ms: float = 0.0


def coming(snapshot: ControlSnapshot | None, report: TriggerReport | None) -> Action | None:
    """What runs, or what a push would begin now. report: None where it is stale."""
    if snapshot is None or snapshot.action is not None:
        return snapshot.action if snapshot is not None else None
    action = ACTION_OF.get(report.gesture) if report is not None and report.gesture else None
    return action if action in snapshot.allowed and action not in snapshot.by_key_only else None
