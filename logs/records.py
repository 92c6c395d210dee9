"""The records of the audit trail: one frozen struct a kind of record, and the envelope that chains them.

Values are plain types with units in their names. States, actions, gestures, effects and events are recorded as the
values of the program's enumerations (those of former versions: `logs/legacy.py`), reasons as a code with values
(`logs/reason.py`): text for people is made when a trail is read. A quantity that was not measured (NaN, or a drive
that does not report it) is null.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from logs.reason import Reason

Measured = float | None  # null: not measured
Quad = tuple[Measured, Measured, Measured, Measured]  # left hip, left knee, right hip, right knee
Cause = Reason | str | None  # a code with values; text as schema 1 recorded it; null: none
Hex = Annotated[str, Meta(pattern="^[0-9a-f]*$")]


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


class ActionEnd(Struct, frozen=True, kw_only=True, tag_field="kind", tag="action-end"):
    """An action ended; moments that never came are 0."""

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


class EffectChanged(Struct, frozen=True, kw_only=True, tag_field="kind", tag="effect"):
    """What all active events together do to the legs has changed."""

    from_effect: str
    to_effect: str


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


class Stop(Struct, frozen=True, kw_only=True, tag_field="kind", tag="stop"):
    """STOP was pressed. Recorded a tick later, when its first joint command was written.

    Older trails hold the moment it was seen in `command_ns`, too: there the command's moment is not known.
    """

    state: str
    effect: str
    sent_ns: int = 0
    seen_ns: int = 0
    command_ns: int = 0  # the first joint command under it was written; 0: none was any more


class Arming(Struct, frozen=True, kw_only=True, tag_field="kind", tag="arming"):
    """The operator armed or disarmed the device."""

    armed: bool


class Camera(Struct, frozen=True, kw_only=True, tag_field="kind", tag="camera"):
    """A camera was opened, with the intrinsics in use."""

    camera: str
    camera_kind: str = ""
    width_px: int
    height_px: int
    rate_hz: float
    focal_px: float
    intrinsics_source: str
    mirrored: bool = False
    measured_hz: Measured = None  # over `frames` captures; the record is repeated with it, after seconds and at the end
    frames: int = 0


class Calibration(Struct, frozen=True, kw_only=True, tag_field="kind", tag="calibration"):
    """The palm anchor in use and where it comes from."""

    method: str
    anchor_m: float
    focal_px: float
    residual_m: Measured = None  # of a calibration's fit, on the anchor
    sd_m: Measured = None  # expected error of the anchor
    focal_source: str = ""
    text: Cause = None


class Recording(Struct, frozen=True, kw_only=True, tag_field="kind", tag="recording"):
    """Recording of the camera's frames began or ended, and whether the patient's consent was noted."""

    on: bool
    consent: bool
    path: str = ""


class _Decided(Struct, frozen=True, kw_only=True):
    """What recognition and button compared in the frame that decided, and the calibration in force.

    Distances of one frame: shown on the screen, and the safe one, by which the button decides.
    """

    captured_ns: int = 0  # of that frame
    recognised_ns: int = 0  # capture of the frame whose vote made the gesture
    vote_ns: tuple[int, ...] = ()  # captures of the frames that voted
    distance_m: Measured = None
    safe_distance_m: Measured = None
    previous_m: Measured = None  # safe distance of the frame before
    threshold_m: Measured = None  # nearer is pressed
    release_m: Measured = None  # farther is released
    nearer_m: Measured = None  # since the frame before
    nearer_limit_m: Measured = None
    beside_px: Measured = None  # from the hand's box to the button's centre
    beside_limit_px: Measured = None
    elapsed_ns: int = 0  # since the frame before
    held_ns: int = 0  # since the press
    gap_frames: int = 0
    elapsed_limit_ns: int = 0
    held_limit_ns: int = 0
    gap_limit_frames: int = 0
    anchor_m: Measured = None
    anchor_method: str = ""
    focal_px: Measured = None
    focal_source: str = ""


class GestureOnset(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="gesture"):
    """The voted gesture became another one; null is none of the twelve."""

    gesture: str | None
    confidence: float = 0.0
    explanation: Cause = None
    votes: int = 0


class Hint(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="hint"):
    """A hand came near and did not press, with the reason that the screen showed."""

    reason: Cause
    gesture: str | None = None


class Press(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="press"):
    """The virtual button went down."""

    gesture: str | None


class Cancel(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="cancel"):
    """A press ended without a command."""

    reason: Cause
    gesture: str | None = None
    pressed_ns: int = 0


class Release(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="release"):
    """A press ended by withdrawal: the wearer's command."""

    gesture: str | None
    number: int = 0  # release count of the perception process
    pressed_ns: int = 0


class SessionStart(Struct, frozen=True, kw_only=True, tag_field="kind", tag="session-start"):
    """First record of a session: what runs, how it is set up, and where the console's history stood."""

    versions: dict[str, str]  # program, Python, operating system, libraries, models' SHA-256
    configuration: dict[str, Any]
    simulated: bool
    role: str = ""
    history_entries: int = 0  # entries of the console's manifest before this session
    history_hash: Hex = ""  # hash of its newest entry


class SessionEnd(Struct, frozen=True, kw_only=True, tag_field="kind", tag="session-end"):
    """The session ends in good order."""

    reason: Cause = None


class ProcessStart(Struct, frozen=True, kw_only=True, tag_field="kind", tag="process-start"):
    """A process of the session has started; the envelope names it."""

    pid: int


class ProcessEnd(Struct, frozen=True, kw_only=True, tag_field="kind", tag="process-end"):
    """A process ended, reported by itself or by who found it missing."""

    pid: int
    reason: Cause = None
    ended: str = ""  # the process, when another one reports it


class PatientChosen(Struct, frozen=True, kw_only=True, tag_field="kind", tag="patient"):
    """Which patient, by pseudonym only, and with which profile."""

    patient: str
    profile_sha256: Hex = ""
    parameters: dict[str, Any] = {}  # gait parameters and limits as used; never a name


class PatientConfirmed(Struct, frozen=True, kw_only=True, tag_field="kind", tag="patient-confirmed"):
    """The operator has confirmed who sits in the device."""

    patient: str


class SignIn(Struct, frozen=True, kw_only=True, tag_field="kind", tag="sign-in"):
    """An operator signed in or unlocked the console."""

    name: str
    role: str
    unlocked: bool = False


class SignOut(Struct, frozen=True, kw_only=True, tag_field="kind", tag="sign-out"):
    """An operator signed out, or the console locked itself."""

    name: str
    reason: Cause = None


class SignInFailed(Struct, frozen=True, kw_only=True, tag_field="kind", tag="sign-in-failed"):
    """A refused attempt to sign in."""

    name: str
    reason: Cause
    failures: int
    wait_s: float


class OperatorChanged(Struct, frozen=True, kw_only=True, tag_field="kind", tag="operator-changed"):
    """An operator was added, disabled or given another PIN."""

    name: str
    role: str
    change: str


class Note(Struct, frozen=True, kw_only=True, tag_field="kind", tag="note"):
    """What the therapist wrote, or what a process reports."""

    text: Reason | str


class Discomfort(Struct, frozen=True, kw_only=True, tag_field="kind", tag="discomfort"):
    """The patient's rating, 0 (none) to 10 (worst)."""

    rating: Annotated[int, Meta(ge=0, le=10)]


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
    target_mean_rad: Quad
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


class ClockStep(Struct, frozen=True, kw_only=True, tag_field="kind", tag="clock-step"):
    """The wall clock was moved against the monotonic one."""

    step_s: float


class Loss(Enum):
    """Why records are not in the trail."""

    QUEUE_FULL = auto()
    NOT_A_RECORD = auto()
    NOT_ENCODABLE = auto()  # kind, detail
    TOO_LONG = auto()  # kind, size_bytes


class RecordsLost(Struct, frozen=True, kw_only=True, tag_field="kind", tag="records-lost"):
    """Records that a full queue or a malformed message kept from the trail: their number is known, at least."""

    count: int
    reason: Cause


class Checkpoint(Struct, frozen=True, kw_only=True, tag_field="kind", tag="checkpoint"):
    """The console's signature over everything before it in this file."""

    records: int
    closing: bool
    key: Hex  # SHA-256 of the public key's DER
    signature: Hex = ""


class LogOpened(Struct, frozen=True, kw_only=True, tag_field="kind", tag="log-opened"):
    """Manifest: a session's file was begun."""

    file: str
    key: Hex
    signature: Hex = ""


class LogClosed(Struct, frozen=True, kw_only=True, tag_field="kind", tag="log-closed"):
    """Manifest: a session's file was closed in good order."""

    file: str
    records: int
    last_hash: Hex
    key: Hex
    signature: Hex = ""


class LogRecovered(Struct, frozen=True, kw_only=True, tag_field="kind", tag="log-recovered"):
    """Manifest: a file was found unclosed at the next start; how it was found, torn tail included."""

    file: str
    records: int
    last_hash: Hex
    torn_bytes: int
    torn_sha256: Hex
    text: Cause
    key: Hex
    signature: Hex = ""


class Comment(Struct, frozen=True, kw_only=True, tag_field="kind", tag="comment"):
    """A reviewer's comment on one record of a session, in a signed file of its own."""

    about_sequence: int
    about_hash: Hex
    text: str
    key: Hex
    signature: Hex = ""


SCHEMA = 2  # 2: reasons are codes with values. Raised whenever an older reader could misread a newer record

Body = (
    SessionStart
    | SessionEnd
    | ProcessStart
    | ProcessEnd
    | PatientChosen
    | PatientConfirmed
    | SignIn
    | SignOut
    | SignInFailed
    | OperatorChanged
    | Camera
    | Calibration
    | Recording
    | GestureOnset
    | Hint
    | Press
    | Cancel
    | Release
    | Command
    | Refusal
    | GuardRefusal
    | PlanChecked
    | Transition
    | ActionEnd
    | EventRaised
    | EventCleared
    | EffectChanged
    | Pause
    | Acknowledgement
    | Stop
    | Arming
    | Drives
    | JointStatistics
    | TickLateness
    | RealTimePrivilege
    | HeartbeatLost
    | HeartbeatFound
    | ClockStep
    | RecordsLost
    | Note
    | Discomfort
    | Checkpoint
    | LogOpened
    | LogClosed
    | LogRecovered
    | Comment
)


class Entry(Struct, frozen=True, kw_only=True, tag="audit-entry"):
    """What a process hands to the audit process: a body with both clocks and whose doing it was."""

    process: str
    operator: str
    wall_ns: int  # UTC, since 1970
    monotonic_ns: int
    body: Body


class Payload(Struct, frozen=True, kw_only=True):
    """A record without its hash: what is hashed, with its fields in sorted order (see docs/reference/audit.md)."""

    body: Body
    monotonic_ns: int
    operator: str
    previous: Hex  # hash of the record before; 64 zeros in the first
    process: str
    schema: int
    sequence: int  # from 0, without gaps
    session: str
    wall: str  # UTC, ISO 8601 with microseconds


class Record(Payload, frozen=True, kw_only=True):
    """One line of a trail."""

    hash: Hex


def json_schema() -> dict[str, Any]:
    """The schema of one line of a trail."""
    schema: dict[str, Any] = msgspec.json.schema(Record)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"rleex audit record, schema {SCHEMA}",
        **schema,
    }


def schema_text() -> str:
    """As it stands in the documents."""
    return msgspec.json.format(msgspec.json.encode(json_schema()), indent=1).decode() + "\n"
