"""Records of control: requests and their answers, actions, events, drives, timing."""

from __future__ import annotations

from msgspec import Struct

from logs.reason import Cause, Measured, Quad


class Command(Struct, frozen=True, kw_only=True, tag_field="kind", tag="command"):
    """An action was accepted; `source` is who requested it."""

    number: int
    action: str
    source: str
    state: str
    gesture: str | None = None
    recognised_ns: int = 0
    released_ns: int = 0
    accepted_ns: int = 0
    pressed_ns: int = 0  # when the push that was released had pressed; 0: a key's request, or an older trail
    requested_ns: int = 0  # a key's request: when it was pressed
    settled: bool = False  # the legs were at rest
    in_force: tuple[str, ...] = ()  # events, strongest first


class Refusal(Struct, frozen=True, kw_only=True, tag_field="kind", tag="refusal"):
    """A request was refused, with the reason that the operator saw."""

    reason: Cause
    source: str
    state: str = ""
    action: str | None = None
    gesture: str | None = None
    number: int = 0
    recognised_ns: int = 0
    released_ns: int = 0
    refused_ns: int = 0
    event: str = ""  # that refuses it; empty: the gait table or the plan's check does
    raised_ns: int = 0  # since when that event is in force
    quantity: str = ""  # compared when it was raised
    value: Measured = None
    limit: Measured = None
    joint: str = ""
    pressed_ns: int = 0  # as of a command; 0 where it had been granted as well
    requested_ns: int = 0  # a key's request: when it was pressed
    settled: bool = False  # the legs were at rest
    in_force: tuple[str, ...] = ()  # events, strongest first


class GuardRefusal(Struct, frozen=True, kw_only=True, tag_field="kind", tag="guard-refusal"):
    """The guard before the drives refused a joint command."""

    reason: Cause
    joint: str = ""
    quantity: str = ""
    value: Measured = None
    limit: Measured = None


class PlanChecked(Struct, frozen=True, kw_only=True, tag_field="kind", tag="plan"):
    """A planned motion and the check that it passed or failed as a whole."""

    number: int
    action: str
    phase: str
    ok: bool
    reason: Cause
    duration_s: float
    peak_speed_rad_s: Quad = (None, None, None, None)
    peak_torque_nm: Quad = (None, None, None, None)
    min_clearance_m: Measured = None
    steps: int = 0
    advance_m: float = 0.0
    command: int = 0  # number of the action that it is for


class Transition(Struct, frozen=True, kw_only=True, tag_field="kind", tag="transition"):
    """The gait state changed."""

    from_state: str
    to_state: str
    action: str | None = None
    number: int = 0


class GaitChanged(Struct, frozen=True, kw_only=True, tag_field="kind", tag="gait"):
    """The gait machine's gait after a change; `transition` tells where its state changed with it."""

    change: str
    action: str | None = None  # that was requested
    state: str
    running: str | None = None
    phase: str
    closing: bool = False


class ActionEnd(Struct, frozen=True, kw_only=True, tag_field="kind", tag="action-end"):
    """An action ended; moments that never came are 0. steps, distance_m: walked in the session so far."""

    number: int
    action: str
    source: str
    from_state: str
    to_state: str | None
    outcome: str  # completed, refused, stopped
    reason: Cause = None
    recognised_ns: int = 0
    released_ns: int = 0
    accepted_ns: int = 0
    first_command_ns: int = 0
    first_motion_ns: int = 0
    ended_ns: int = 0
    tracking_rms_rad: Measured = None
    steps: int = 0
    distance_m: float = 0.0


class EventRaised(Struct, frozen=True, kw_only=True, tag_field="kind", tag="event-raised"):
    """A row of the table of events came into force; quantity, value, limit: what it compared, where it is a number."""

    event: str
    effect: str
    text: Cause
    raised_ns: int = 0
    quantity: str = ""  # its unit is in its name
    value: Measured = None
    limit: Measured = None
    joint: str = ""


class EventCleared(Struct, frozen=True, kw_only=True, tag_field="kind", tag="event-cleared"):
    """The condition of an event has ended; its effect may stay until acknowledged."""

    event: str
    effect: str
    lasted_s: float = 0.0
    total: Measured = None  # of an event that counts, since it was raised: rejected messages, foreign peers


class EffectChanged(Struct, frozen=True, kw_only=True, tag_field="kind", tag="effect"):
    """What all active events together do to the legs has changed."""

    from_effect: str
    to_effect: str
    in_force: tuple[str, ...] = ()  # events, strongest first


class Pause(Struct, frozen=True, kw_only=True, tag_field="kind", tag="pause"):
    """A running action stood still for a passing cause; `resumed`: it went on by itself, else the legs were held."""

    cause: str
    began_ns: int
    duration_s: float
    state: str
    action: str
    progress: float  # of the running plan, 0-1, when it began
    resumed: bool = True


class Acknowledgement(Struct, frozen=True, kw_only=True, tag_field="kind", tag="acknowledgement"):
    """The operator acknowledged what was held or damped."""

    events: tuple[str, ...]
    waited_s: float = 0.0  # since the oldest of them was raised
    accepted: bool = True
    reason: Cause = None
    at_ns: int = 0  # a push that began before commands nothing; 0 in older trails


class Stop(Struct, frozen=True, kw_only=True, tag_field="kind", tag="stop"):
    """STOP was pressed or said. Recorded a tick later, when its first joint command was written.

    Older trails hold the moment it was seen in `command_ns`, too: there the command's moment is not known.
    """

    state: str
    effect: str
    sent_ns: int = 0
    seen_ns: int = 0
    command_ns: int = 0  # the first joint command under it was written; 0: none was any more
    by: str = "key"  # or voice, takeover


class StopInput(Struct, frozen=True, kw_only=True, tag_field="kind", tag="stop-input"):
    """A button that stops opened or closed; `contact`: closed, open (pressed or wire broken), silent (with why)."""

    name: str
    role: str
    contact: str
    at_ns: int = 0  # when it was read
    reason: Cause = None


class Arming(Struct, frozen=True, kw_only=True, tag_field="kind", tag="arming"):
    """The operator armed or disarmed the device."""

    armed: bool
    at_ns: int = 0


class JointLimits(Struct, frozen=True, kw_only=True, tag_field="kind", tag="limits"):
    """What control compares the joints with, as it starts: the device's limits, or the patient's where narrower."""

    low_rad: Quad
    high_rad: Quad
    speed_rad_s: Quad
    torque_nm: Quad
    warn_c: Quad
    limit_c: Quad


class Drives(Struct, frozen=True, kw_only=True, tag_field="kind", tag="drives"):
    """The drives' life cycle as the driver confirmed it."""

    state: str
    detail: Cause = None


class JointStatistics(Struct, frozen=True, kw_only=True, tag_field="kind", tag="joints"):
    """A second of the four joints."""

    period_s: float
    angle_min_rad: Quad
    angle_mean_rad: Quad
    angle_max_rad: Quad
    target_mean_rad: Quad  # null where the joint was held nowhere at some time of it: off, or damped
    torque_min_nm: Quad
    torque_mean_nm: Quad
    torque_max_nm: Quad
    temperature_c: Quad
    tracking_rms_rad: Quad = (None, None, None, None)
    state: str = ""


class TickLateness(Struct, frozen=True, kw_only=True, tag_field="kind", tag="lateness"):
    """How late control's ticks began, since the session's start."""

    ticks: int
    missed: int
    p50_ms: float
    p99_ms: float
    p999_ms: float
    max_ms: float


class RealTimePrivilege(Struct, frozen=True, kw_only=True, tag_field="kind", tag="real-time"):
    """Which real-time privileges control got."""

    fifo: bool
    memory_locked: bool
    core: int | None = None
    cores_awake: bool = False


class HeartbeatLost(Struct, frozen=True, kw_only=True, tag_field="kind", tag="heartbeat-lost"):
    """A stream's heartbeat is overdue."""

    stream: str
    age_ms: float


class HeartbeatFound(Struct, frozen=True, kw_only=True, tag_field="kind", tag="heartbeat-found"):
    """A stream's heartbeat is back."""

    stream: str
    silent_ms: float


ControlBody = (
    Command
    | Refusal
    | GuardRefusal
    | PlanChecked
    | Transition
    | GaitChanged
    | ActionEnd
    | EventRaised
    | EventCleared
    | EffectChanged
    | Pause
    | Acknowledgement
    | Stop
    | StopInput
    | Arming
    | JointLimits
    | Drives
    | JointStatistics
    | TickLateness
    | RealTimePrivilege
    | HeartbeatLost
    | HeartbeatFound
)
