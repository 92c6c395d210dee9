"""The records of the audit trail: one frozen struct a kind of record, and the envelope that chains them.

The one door to all of them: who records imports from here.

Values are plain types with units in their names. States, actions, gestures, effects and events are recorded as the
values of the program's enumerations (those of former versions: `logs/show.py`), reasons as a code with values
(`logs/reason.py`): text for people is made when a trail is read. A quantity that was not measured (NaN, or a drive
that does not report it) is null.
"""

from __future__ import annotations

import inspect
from typing import Any

import msgspec
from msgspec import Struct

from logs.reason import Hex
from logs.records.control import (
    Acknowledgement,
    ActionEnd,
    Arming,
    Command,
    ControlBody,
    Drives,
    EffectChanged,
    EventCleared,
    EventRaised,
    GaitChanged,
    GuardRefusal,
    HeartbeatFound,
    HeartbeatLost,
    JointLimits,
    JointStatistics,
    Pause,
    PlanChecked,
    RealTimePrivilege,
    Refusal,
    Stop,
    StopInput,
    TickLateness,
    Transition,
)
from logs.records.perception import (
    Button,
    Calibration,
    Camera,
    CameraComparison,
    Cancel,
    Frames,
    GestureOnset,
    Hint,
    PerceptionBody,
    Press,
    Recording,
    Release,
)
from logs.records.session import (
    Change,
    ClockStep,
    Discomfort,
    Exertion,
    GuidedTestResult,
    Loss,
    Note,
    OperatorChanged,
    OtherTrail,
    Pain,
    PatientChosen,
    PatientConfirmed,
    ProcessEnd,
    ProcessStart,
    Rating,
    RecordingDeleted,
    RecordingFile,
    RecordingSent,
    RecordsLost,
    SessionBody,
    SessionEnd,
    SessionStart,
    SignIn,
    SignInFailed,
    SignOut,
    TrailEnd,
    VocabularyEnrolled,
)
from logs.records.signed import Checkpoint, Comment, LogClosed, LogOpened, LogRecovered, SignedBody

SCHEMA = 2  # 2: reasons are codes with values. Raised whenever an older reader could misread a newer record

Body = SessionBody | PerceptionBody | ControlBody | SignedBody


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


decode_record = msgspec.json.Decoder(Record).decode


def json_schema() -> dict[str, Any]:
    """The schema of one line of a trail."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"rleex audit record, schema {SCHEMA}",
        **schema_of_struct(Record),
    }


def schema_of_struct(struct: type[msgspec.Struct]) -> dict[str, Any]:
    """msgspec's JSON Schema. Its descriptions are docstrings, which Python indents as in the source before 3.13."""
    schema: dict[str, Any] = msgspec.json.schema(struct)
    for definition in schema["$defs"].values():
        if "description" in definition:
            definition["description"] = inspect.cleandoc(definition["description"])
    return schema


def schema_text() -> str:
    """As it stands in the documents."""
    return msgspec.json.format(msgspec.json.encode(json_schema()), indent=1).decode() + "\n"
