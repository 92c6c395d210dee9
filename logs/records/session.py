"""Records of the session: what runs, who sits in the device, who operates it, what was lost."""

from __future__ import annotations

from enum import Enum, auto
from typing import Annotated, Any

from msgspec import Meta, Struct

from logs.reason import Cause, Hex, Measured, Reason


class SessionStart(Struct, frozen=True, kw_only=True, tag_field="kind", tag="session-start"):
    """First record of a session: what runs, how it is set up, and where the console's history stood."""

    versions: dict[str, str]  # program, Python, operating system, libraries; SHA-256 of program, rules, models
    configuration: dict[str, Any]
    simulated: bool
    role: str = ""
    purpose: str = ""  # session, training or enrolment; empty in trails from before it was recorded
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
    """An operator was added, disabled or given another PIN; a `Change` since there is a journal of changes."""

    name: str
    role: str
    change: str


class Change(Struct, frozen=True, kw_only=True, tag_field="kind", tag="change"):
    """A patient, calibration, configuration, operator or joint was changed; the envelope names by whom."""

    subject: str  # patient, calibration, configuration, operator, joint
    name: str  # pseudonym, camera, file, operator's name, joint
    values: dict[str, tuple[Any, Any]]  # field → before, after; null: absent
    proof: str  # how who did it was known: pin, token; none: unsigned
    role: str = ""  # of who did it
    reason: Cause = None


class VocabularyEnrolled(Struct, frozen=True, kw_only=True, tag_field="kind", tag="vocabulary"):
    """A patient was enrolled with the gestures that command, or the enrolment was refused and the old ones stay.

    Columns hold a value a gesture that was shown; bounds are exact, one-sided, of 95 %.
    """

    patient: str
    reason: Cause = None  # of a refusal
    vocabulary: tuple[str, ...]  # in force from the next session
    model: Hex = ""  # SHA-256 of what recognised
    gestures: tuple[str, ...] = ()
    frames: tuple[int, ...] = ()
    recognised: tuple[int, ...] = ()
    mistaken: tuple[int, ...] = ()
    recognised_at_least: tuple[float, ...] = ()
    mistaken_at_most: tuple[float, ...] = ()
    idle_frames: int = 0
    idle_taken: int = 0
    idle_at_most: float | None = None


class Note(Struct, frozen=True, kw_only=True, tag_field="kind", tag="note"):
    """What the therapist wrote, or what a process reports."""

    text: Reason | str


class Discomfort(Struct, frozen=True, kw_only=True, tag_field="kind", tag="discomfort"):
    """The patient's rating, 0 (none) to 10 (worst)."""

    rating: Annotated[int, Meta(ge=0, le=10)]


class Pain(Struct, frozen=True, kw_only=True, tag_field="kind", tag="pain"):
    """The patient's pain on the numerical rating scale, 0 (none) to 10 (worst)."""

    rating: Annotated[int, Meta(ge=0, le=10)]


class Exertion(Struct, frozen=True, kw_only=True, tag_field="kind", tag="exertion"):
    """The patient's perceived exertion on Borg's scale, 6 (none) to 20 (maximal)."""

    rating: Annotated[int, Meta(ge=6, le=20)]


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


class RecordingFile(Struct, frozen=True, kw_only=True, tag_field="kind", tag="recording-file"):
    """A file of the session's recording was finished: its hash, and how many messages it holds and lacks, by topic."""

    file: str
    sha256: Hex
    size_bytes: int
    messages: dict[str, int]
    lost: dict[str, int] = {}  # a slow or full disk, or a full queue, cost them
    whole: bool  # index and footer are there
    fault: Cause = None


class RecordingSent(Struct, frozen=True, kw_only=True, tag_field="kind", tag="recording-sent"):
    """A process ended that hands messages to the recording: how many it made since its start, by topic."""

    messages: dict[str, int]


class RecordingDeleted(Struct, frozen=True, kw_only=True, tag_field="kind", tag="recording-deleted"):
    """A file of the session's recording was deleted: the patient withdrew the consent."""

    file: str
    size_bytes: int
    messages: int


class GuidedTestResult(Struct, frozen=True, kw_only=True, tag_field="kind", tag="guided-test"):
    """A guided test of a session ended: distance and steps as control counted them, of completed steps."""

    test: str  # ten metre walk, six minute walk, timed up and go
    outcome: str  # completed, stopped
    reason: Cause = None  # why it was stopped
    started_ns: int  # by the operator's key
    began_ns: int = 0  # its clock started; 0: it never did
    ended_ns: int
    duration_s: float
    distance_m: float
    steps: int
    speed_m_s: Measured = None  # null where the time is not all walking


class TrailEnd(Struct, frozen=True, kw_only=True):
    """The newest record of a trail that is on the medium, and which trail it is: what one host tells the other."""

    session: str
    key: Hex  # SHA-256 of the public key that signs it
    first_hash: Hex  # of its first record: a session whose audit process was started again has several trails
    sequence: int
    hash: Hex


# Between two monotonic clocks, which follow NTP (clock_gettime(2)): it changes the frequency of each by at most 500 ppm
# (adjtimex(2), ADJ_FREQUENCY); quartz alone keeps ±100 ppm. An offset that is slewed away may be quicker.
DRIFT_PPM = 1_000


class OtherTrail(TrailEnd, frozen=True, kw_only=True, tag_field="kind", tag="other-trail"):
    """How far the trail of the other computer was, about once a second: neither can be rewritten alone."""

    offset_ns: int  # its monotonic clock minus ours, at this record's moment
    uncertainty_ns: int  # the truth is so far away from `offset_ns` at most


Rating = Discomfort | Pain | Exertion
SessionBody = (
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
    | Change
    | Note
    | Discomfort
    | ClockStep
    | RecordsLost
    | RecordingFile
    | RecordingDeleted
    | Pain
    | Exertion
    | GuidedTestResult
    | VocabularyEnrolled
    | OtherTrail
    | RecordingSent
)
