"""What the audit trail can say: one frozen struct a kind of record, and the envelope that chains them.

Values are plain types with units in their names. States, actions, gestures, effects and events stand as the
strings that the rest of the program uses, because a trail must outlive the program's enumerations.
A quantity that was not measured (NaN, or a drive that does not tell) is null.
"""

from __future__ import annotations

from msgspec import Struct

from logs.bodies.control import (
    Acknowledgement,
    ActionEnd,
    Arming,
    Command,
    EffectChanged,
    EventCleared,
    EventRaised,
    GuardRefusal,
    PlanChecked,
    Refusal,
    Stop,
    Transition,
)
from logs.bodies.machine import (
    ClockStep,
    Drives,
    HeartbeatFound,
    HeartbeatLost,
    JointStatistics,
    RealTimePrivilege,
    RecordsLost,
    TickLateness,
)
from logs.bodies.perception import Calibration, Camera, Cancel, GestureOnset, Press, Recording, Release
from logs.bodies.proof import Checkpoint, Comment, LogClosed, LogOpened, LogRecovered
from logs.bodies.session import (
    Discomfort,
    Note,
    OperatorChanged,
    PatientChosen,
    PatientConfirmed,
    ProcessEnd,
    ProcessStart,
    SessionEnd,
    SessionStart,
    SignIn,
    SignInFailed,
    SignOut,
)
from logs.bodies.values import Hex, Measured, Quad

__all__ = [
    "SCHEMA",
    "Acknowledgement",
    "ActionEnd",
    "Arming",
    "Body",
    "Calibration",
    "Camera",
    "Cancel",
    "Checkpoint",
    "ClockStep",
    "Command",
    "Comment",
    "Discomfort",
    "Drives",
    "EffectChanged",
    "Entry",
    "EventCleared",
    "EventRaised",
    "GestureOnset",
    "GuardRefusal",
    "HeartbeatFound",
    "HeartbeatLost",
    "Hex",
    "JointStatistics",
    "LogClosed",
    "LogOpened",
    "LogRecovered",
    "Measured",
    "Note",
    "OperatorChanged",
    "PatientChosen",
    "PatientConfirmed",
    "PlanChecked",
    "Press",
    "ProcessEnd",
    "ProcessStart",
    "Quad",
    "RealTimePrivilege",
    "Record",
    "Recording",
    "RecordsLost",
    "Refusal",
    "Release",
    "SessionEnd",
    "SessionStart",
    "SignIn",
    "SignInFailed",
    "SignOut",
    "Stop",
    "TickLateness",
    "Transition",
]

SCHEMA = 1  # raised whenever an older reader could misread a newer record

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


class Record(Struct, frozen=True, kw_only=True):
    """One line of a trail. `hash` covers the line as it stands without its own field (see docs/audit.md)."""

    body: Body
    monotonic_ns: int
    operator: str
    previous: Hex  # hash of the record before; 64 zeros in the first
    process: str
    schema: int
    sequence: int  # from 0, without gaps
    session: str
    wall: str  # UTC, ISO 8601 with microseconds
    hash: Hex
