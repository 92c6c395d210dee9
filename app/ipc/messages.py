"""The messages between processes: frozen, validated on arrival, units in the names. Rates: `app/ipc/streams.py`.

Control's snapshot is in `snapshot`. A reason is a code with values, rendered where it is shown.

Latest-only messages survive conflation: they carry counts (`release_count`, `action_count`), so a lost one
loses no command and a repeated one repeats none. A sender that restarts starts a new `incarnation`.
"""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from app.ipc.states import Action
from kgdfa.distance import DistanceSource
from kgdfa.gesture import Gesture
from kgdfa.press_zone import PressZone
from logs.reason import Reason
from logs.records import TrailEnd


class TriggerReport(Struct, frozen=True, kw_only=True, tag="trigger"):
    """Perception to control and console, one per frame. "No hand" is sent, so absence differs from silence.

    While none comes, ten a second: a slow camera's last one with its `captured_ns`, after STALE_NS without a hand.
    """

    incarnation: int
    sequence: int
    captured_ns: int  # monotonic, when the frame was captured
    sent_ns: int
    hand: bool
    gesture: Gesture | None  # voted
    recognised_ns: int = 0  # capture of the frame whose vote made `gesture` what it is
    raw_gesture: Gesture | None = None  # of this frame alone
    confidence: float = 0.0
    explanation: Reason | None = None
    hand_refusal: Reason | None = None  # why no hand in view commands
    votes: int = 0
    distance_m: float | None = None  # as shown
    distance_sd_m: float = 0.0
    safe_distance_m: float | None = None  # as the button uses it: may read far, never near
    threshold_m: float = 0.20
    pressed: bool = False
    release_count: int = 0
    released_gesture: Gesture | None = None
    released_recognised_ns: int = 0
    released_ns: int = 0  # capture of the frame that released
    released_pressed_ns: int = 0  # capture of the frame that had pressed
    cancel_count: int = 0
    cancel_reason: Reason | None = None
    press_hint: Reason | None = None  # why a hand that is near, or just was, does not press
    fps: float = 0.0
    camera: str = ""
    camera_fault: Reason | None = None  # while the camera delivers nothing
    hint: Reason | None = None  # for the therapist: dark, blurred, too near
    detector_ready: bool = True  # False while the hand model is loading
    distance_source: DistanceSource | None = None  # what measured distance_m; None: nothing did
    depth_distance_m: float | None = None  # whichever source decides
    depth_fault: Reason | None = None  # why depth measured nothing, or does not decide
    pictures_recorded: bool = False  # with the patient's consent
    focal_assumed: bool = False  # distances rest on an assumed focal length, no calibration corrects it
    press_zone: PressZone | None = None  # None until a frame has told the focal length


class Preview(Struct, frozen=True, kw_only=True, tag="preview"):
    """Perception to console: a small picture with everything drawn in."""

    sequence: int
    captured_ns: int
    width_px: int
    height_px: int
    rgb: bytes


class HandPose(Enum):
    """What the digital hand does between gestures."""

    REST = "rest"  # relaxed, open
    AWAY = "none"  # out of the picture


class HandCommand(Struct, frozen=True, kw_only=True, tag="hand"):
    """Console or demo to perception: moves the digital hand; None leaves a thing as it is."""

    gesture: Gesture | None = None
    pose: HandPose | None = None  # instead of a gesture
    press: bool | None = None  # push towards the camera (True), draw back (False)
    click_s: float | None = None  # press and withdraw within this time
    move_x_m: float = 0.0
    move_y_m: float = 0.0
    move_z_m: float = 0.0


class PerceptionCommand(Struct, frozen=True, kw_only=True, tag="perception"):
    """Console to perception: what the preview looks like, and whether pictures are recorded.

    None leaves a thing as it is.
    """

    preview_width_px: int | None = None
    preview_hz: float | None = None
    record_pictures: bool | None = None


class OperatorKind(Enum):
    """What the operator can command."""

    HEARTBEAT = "heartbeat"
    STOP = "stop"  # hold; a second one damps
    VOICE_STOP = "voice stop"  # the word from a microphone: hold, and never more
    ACKNOWLEDGE = "acknowledge"
    ARM = "arm"
    DISARM = "disarm"
    ACT = "act"  # the therapist's key for one of the twelve actions
    TORQUE_OFF = "torque off"  # after damp: the joints off, on the operator's command
    CONFIRM_PATIENT = "confirm patient"
    SHUT_DOWN = "shut down"  # damp, disable, end the process
    TAKE_OVER = "take over"  # a console with the next lease: from now on it alone commands; the legs are held


STOP_KINDS = frozenset({OperatorKind.STOP, OperatorKind.VOICE_STOP})  # heard from everybody, never too old


class OperatorCommand(Struct, frozen=True, kw_only=True, tag="operator"):
    """Console to control."""

    sequence: int
    lease: int = 1  # of the console that sends it; control hears the newest
    kind: OperatorKind
    sent_ns: int  # when its key was pressed; of one without a key, when it was sent
    operator: str = ""
    action: Action | None = None  # with ACT


class Heartbeat(Struct, frozen=True, kw_only=True, tag="heartbeat"):
    """Control to guardian: alive, and whether the drives are powered."""

    at_ns: int
    enabled: bool
    last: bool = False  # control ends in good order
    unconfirmed: bool = False  # a drive has not confirmed that it is off: it may still be stiff
    awaits_drives: bool = False  # the next one comes when the drives have answered an order, or have not


class AuditHealth(Struct, frozen=True, kw_only=True, tag="audit-health"):
    """Audit to control and console: how many records are written, and whether it can still write."""

    at_ns: int
    written: int
    waiting: int
    newest: TrailEnd | None = None  # what of the trail is on the medium; None: nothing yet
    fault: Reason | None = None
    foreign_peers: int = 0  # without the session's key, turned away so far


class GuardianHealth(Struct, frozen=True, kw_only=True, tag="guardian-health"):
    """Guardian to control and console."""

    at_ns: int
    acted: bool = False
    off: bool = False  # it has damped the joints and is switching them off
    fault: Reason | None = None  # why it can't reach the drives
    unanswered: tuple[str, ...] = ()  # joints whose drives have not answered its damping, or its switching off
    foreign_peers: int = 0  # without the session's key, turned away so far


class ProcessStatus(Struct, frozen=True, kw_only=True):
    """One process of the session."""

    name: str
    pid: int
    alive: bool
    restarts: int
    exit_code: int | None


class SessionStatus(Struct, frozen=True, kw_only=True, tag="session"):
    """The session's own process to consoles: each of its processes."""

    at_ns: int
    processes: tuple[ProcessStatus, ...]


class LinkHealth(Struct, frozen=True, kw_only=True, tag="link"):
    """The link's process to control or console of its own host: the other computer, and the way to it.

    Absent where everything runs on one host.
    """

    at_ns: int
    host: str
    connected: bool
    round_trip_ms: float = 0.0
    jitter_ms: float = 0.0
    loss: float = 1.0  # of packets, of the worse direction; 0 to 1
    offset_ns: int = 0  # the other host's monotonic clock minus ours
    uncertainty_ns: int | None = None  # None: not known yet
    steps: int = 0  # of a clock against the other one, so far
    fault: Reason | None = None  # why there is no session
    stop_lease: int = 0  # of the console whose STOP was the newest that control acknowledged, by packet
    stop_sequence: int = 0
    audit: AuditHealth | None = None  # of the other host's trail
    processes: tuple[ProcessStatus, ...] = ()  # of the other host
    foreign_peers: int = 0  # turned away so far
