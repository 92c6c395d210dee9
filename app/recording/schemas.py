"""The topics of a recording and their messages: Foxglove's schemas where they exist, else ours, as JSON Schema.

Units stand in the names. Joints: hip and knee flexion positive, standing = 0. The hand: MediaPipe's axes (x right,
y down, z away from the camera). Time: `at_ns`'s clock is the file's (`writer.py`).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from msgspec import UNSET, Struct, UnsetType

from logs.reason import Reason
from logs.records import json_schema as trail_schema
from logs.records import schema_of_struct

Four = tuple[float | None, float | None, float | None, float | None]  # left hip, left knee, right hip, right knee
Point2 = tuple[float, float]
Point3 = tuple[float, float, float]


class Time(Struct, frozen=True):
    """Foxglove's: UTC since 1970."""

    sec: int
    nsec: int


def time_of(epoch_ns: int) -> Time:
    return Time(*divmod(epoch_ns, 1_000_000_000))


class JointState(Struct, frozen=True):
    """Foxglove's: rad, rad/s, Nm; what was not measured is left out."""

    name: str
    position: float | UnsetType = UNSET
    velocity: float | UnsetType = UNSET
    effort: float | UnsetType = UNSET


JOINT_FIELDS = ("position", "velocity", "effort")


class JointStates(Struct, frozen=True):
    timestamp: Time
    joints: tuple[JointState, ...]


class Log(Struct, frozen=True, kw_only=True):
    """Foxglove's."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


class CompressedImage(Struct, frozen=True, kw_only=True):
    """Foxglove's; data: base64 in the file."""

    timestamp: Time
    frame_id: str
    data: bytes
    format: str  # jpeg, png


class Gains(Struct, frozen=True, kw_only=True):
    """Stiffness and damping of the command; written when they change."""

    stiffness_nm_rad: Four
    damping_nm_s_rad: Four


class DriveHealth(Struct, frozen=True, kw_only=True):
    """Temperature, and how old each joint's newest measurement is."""

    temperature_c: Four
    age_ms: Four
    faults: tuple[str, ...]


class FootContact(Struct, frozen=True, kw_only=True):
    """Vertical force on each foot; simulated joints only, drives measure none."""

    left_n: float
    right_n: float


class Gait(Struct, frozen=True, kw_only=True):
    """The gait machine and what the legs may do, 20 times a second."""

    state: str
    action: str | None
    progress: float
    effect: str
    armed: bool
    powered: bool
    steps: int
    distance_walked_m: float
    events: tuple[str, ...]  # in force or unacknowledged
    refusal: Reason | None
    refusal_count: int
    allowed: tuple[str, ...] = ()  # actions that a push or key may begin; older recordings lack these three
    pending: str | None = None  # gesture 6, latched
    why_not: Reason | None = None  # why nothing is allowed, when nothing is


class Operator(Struct, frozen=True, kw_only=True):
    """A command of the console to control."""

    command: str
    operator: str
    sequence: int
    lease: int
    action: str | None


class LinkHealth(Struct, frozen=True, kw_only=True):
    """Age of control's newest message of each stream, and how late its ticks begin, since the session's start."""

    report_age_ms: float
    console_age_ms: float
    audit_age_ms: float
    guardian_age_ms: float
    audit_waiting: int
    missed_ticks: int
    late_p99_ms: float
    late_max_ms: float


class Keypoints(Struct, frozen=True, kw_only=True):
    """The commanding hand's 21 keypoints: on the image, and in metres about the hand's centre; empty: no hand."""

    frame: int
    image_px: tuple[Point2, ...]
    world_m: tuple[Point3, ...]


class Verdict(Struct, frozen=True, kw_only=True):
    """What one frame's gesture is, and the vote over frames."""

    frame: int
    hand: bool
    gesture: str | None  # voted
    raw_gesture: str | None  # of this frame alone
    confidence: float
    votes: int
    explanation: Reason | None
    refusal: Reason | None


class Button(Struct, frozen=True, kw_only=True):
    """The palm's distance and the virtual button."""

    frame: int
    distance_m: float | None  # as shown
    sd_m: float
    safe_distance_m: float | None  # by which the button decides
    depth_distance_m: float | None
    threshold_m: float
    pressed: bool
    release_count: int
    released_gesture: str | None
    cancel_count: int
    fps: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One channel of the file. schema: Foxglove's name, or a type of ours."""

    name: str
    schema: str | type[Struct]
    about: str

    @property
    def schema_name(self) -> str:
        """As it stands in the file."""
        return self.schema if isinstance(self.schema, str) else f"rleex.{self.schema.__name__}"


JOINT_STATE = "/joints/state"
JOINT_SETPOINT = "/joints/setpoint"
JOINT_GAINS = "/joints/gains"
JOINT_HEALTH = "/joints/health"
CONTACT = "/feet/contact"
GAIT = "/gait"
OPERATOR = "/operator"
LINKS = "/links"
KEYPOINTS = "/hand/keypoints"
VERDICT = "/hand/verdict"
BUTTON = "/hand/button"
HAND_TOPICS = (KEYPOINTS, VERDICT, BUTTON)  # a message of each for each frame
TRAIL = "/trail"
LOG = "/log"

TOPICS = (
    Topic(name=JOINT_STATE, schema="foxglove.JointStates", about="measured, 500 Hz"),
    Topic(name=JOINT_SETPOINT, schema="foxglove.JointStates", about="commanded, 500 Hz; effort: feed-forward torque"),
    Topic(name=JOINT_GAINS, schema=Gains, about="of the command, on change"),
    Topic(name=JOINT_HEALTH, schema=DriveHealth, about="20 Hz"),
    Topic(name=CONTACT, schema=FootContact, about="50 Hz, simulated joints only"),
    Topic(name=GAIT, schema=Gait, about="20 Hz"),
    Topic(name=OPERATOR, schema=Operator, about="each command, without heartbeats"),
    Topic(name=LINKS, schema=LinkHealth, about="20 Hz"),
    Topic(name=KEYPOINTS, schema=Keypoints, about="each frame"),
    Topic(name=VERDICT, schema=Verdict, about="each frame"),
    Topic(name=BUTTON, schema=Button, about="each frame"),
    Topic(name=TRAIL, schema="rleex.AuditRecord", about="each line of the trail up to the recording's end"),
    Topic(name=LOG, schema="foxglove.Log", about="the same, as lines of a log"),
)

# In a file of their own, which the patient's consent may delete.
IMAGE = "/camera/image"
DEPTH = "/camera/depth"
PICTURE_TOPICS = (
    Topic(name=IMAGE, schema="foxglove.CompressedImage", about="JPEG, at most 640 px wide, 10 Hz, with consent"),
    Topic(name=DEPTH, schema="foxglove.CompressedImage", about="PNG of 16 bits, mm, 0: no measurement; as the image"),
)

_TIME = {
    "type": "object",
    "title": "time",
    "properties": {
        "sec": {"type": "integer", "minimum": 0},
        "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
    },
}


_NUMBER, _TEXT = {"type": "number"}, {"type": "string"}
_JOINT = {
    "title": "foxglove.JointState",
    "type": "object",
    "properties": {"name": _TEXT, "position": _NUMBER, "velocity": _NUMBER, "effort": _NUMBER},
    "required": ["name"],
}
# Fields that Foxglove's readers know by these schemas' names (docs.foxglove.dev, Schemas).
_PROPERTIES: dict[str, dict[str, Any]] = {
    "foxglove.JointStates": {"joints": {"type": "array", "items": _JOINT}},
    "foxglove.CompressedImage": {
        "frame_id": _TEXT,
        "data": {"type": "string", "contentEncoding": "base64"},
        "format": _TEXT,
    },
    "foxglove.Log": {
        "level": {"type": "integer", "minimum": 0, "maximum": 5},
        "message": _TEXT,
        "name": _TEXT,
        "file": _TEXT,
        "line": {"type": "integer"},
    },
}
FOXGLOVE = {
    title: {"title": title, "type": "object", "properties": {"timestamp": _TIME, **properties}}
    for title, properties in _PROPERTIES.items()
}


def schema_of(topic: Topic) -> dict[str, Any]:
    """A topic's JSON Schema."""
    if not isinstance(topic.schema, str):
        return {"title": topic.schema_name, **schema_of_struct(topic.schema)}
    return trail_schema() if topic.schema == "rleex.AuditRecord" else FOXGLOVE[topic.schema]


def schemas_text() -> str:
    """Every topic with its schema, as it stands in the documents; the trail's is docs/reference/audit-schema.json."""
    topics = {
        topic.name: {
            "about": topic.about,
            "schema": topic.schema_name,
            **({} if topic.name == TRAIL else {"json_schema": schema_of(topic)}),
        }
        for topic in (*TOPICS, *PICTURE_TOPICS)
    }
    return json.dumps(topics, indent=1) + "\n"
