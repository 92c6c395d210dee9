"""Reading trails for people: records, lines that are none, and a session in a line."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import msgspec

from logs.errors import AuditError, AuditFault
from logs.journal import is_journal, parted
from logs.line import MAX_LINE, is_whole
from logs.manifest import begun_last
from logs.reading.errors import UNDECODABLE, cause_of
from logs.reading.regular import open_regular
from logs.records import (
    ActionEnd,
    Command,
    EventRaised,
    PatientChosen,
    Record,
    Refusal,
    SessionStart,
    Stop,
    VocabularyEnrolled,
    decode_record,
)
from logs.scan import Scan, in_tear, scan_file
from logs.verify import is_session

_BEGINNING = 200  # records; every process begins and the patient is chosen within the first dozens
_ENROLMENT = f'"kind":"{VocabularyEnrolled.__struct_config__.tag}"'.encode()
NOT_A_RECORD = "not-a-record"  # kinds of what is none
NOT_UNDERSTOOD = "not-understood"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnreadableLine:
    """A line that is no record of this version: another version's, torn, or not a record at all."""

    line: int
    kind: str
    wall: str
    text: str


def read(path: Path) -> Iterator[Record | UnreadableLine]:
    """Every line of a trail, in order. Raises AuditError when the file can't be read.

    In a journal's torn tail that a later record explains, as far as the chain alone shows, no line is a record.
    """
    try:
        scan = scan_file(path, {}) if is_journal(path) else Scan()
        with open_regular(path) as file:
            for number, line in enumerate(iter(partial(file.readline, MAX_LINE), b""), start=1):
                if in_tear(scan, number):
                    yield _unreadable_line(line, number, "torn")
                elif line != b"\n":
                    yield understand(line, number)
    except OSError as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=path, detail=cause_of(error)) from error


def records(path: Path) -> list[Record]:
    """The records of a trail that this version understands."""
    return [record for record in read(path) if isinstance(record, Record)]


def understand(line: bytes, number: int) -> Record | UnreadableLine:
    """One line, with or without its line end. What does not match its hash is no record, even if it reads like one."""
    if not is_whole(line.removesuffix(b"\n") + b"\n"):
        return _unreadable_line(line, number, "not whole")
    try:
        return decode_record(line)
    except UNDECODABLE as error:
        return _unreadable_line(line, number, str(error))


def follow(path: Path, is_over: Callable[[], bool], pause_s: float = 0.2) -> Iterator[Record | UnreadableLine]:
    """What is in a trail and what is still being added, until it is over."""
    number, rest = 0, b""
    with open_regular(path) as file:
        while True:
            over = is_over()  # first, so that what was added meanwhile is still read
            for line in iter(partial(file.readline, MAX_LINE), b""):
                rest += line
                if not line.endswith(b"\n"):
                    break
                number, whole, rest = number + 1, rest, b""
                yield understand(whole, number)
            if over:
                return
            time.sleep(pause_s)


def session_paths(folder: Path) -> list[Path]:
    """The sessions of a folder, oldest first; one that goes on in further files in their order.

    A name that can't be shown is none that this program gave, and no database or JSON takes one that is no UTF-8.
    """
    paths = sorted(folder.glob("*.jsonl"), key=lambda path: parted(path.stem))
    return [path for path in paths if is_session(path) and path.name.isprintable() and path.is_file()]


def patient_and_purpose(path: Path) -> tuple[str, str]:
    """Of a session, from the trail's beginning; empty: none is named there. Raises AuditError."""
    purpose = ""
    for record in islice(read(path), _BEGINNING):
        body = record.body if isinstance(record, Record) else None
        if isinstance(body, SessionStart):
            purpose = body.purpose
        elif isinstance(body, PatientChosen):
            return body.patient, purpose
    return "", purpose


def holds_enrolment(path: Path) -> bool:
    """Whether the end of an enrolment is in the trail: by it one is known that names no purpose. Raises AuditError."""
    try:
        with open_regular(path) as file:
            lines = (line for line in iter(partial(file.readline, MAX_LINE), b"") if _ENROLMENT in line)
            found = (understand(line, 0) for line in lines)
            return any(isinstance(one, Record) and isinstance(one.body, VocabularyEnrolled) for one in found)
    except OSError as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=path, detail=cause_of(error)) from error


def find_session(folder: Path, name: str) -> Path:
    """A session by path, by name or its beginning, or "last". Raises AuditError when it is none, or several."""
    direct = Path(name)
    if direct.is_file():
        return direct
    paths = session_paths(folder)
    if not paths:
        raise AuditError(AuditFault.NO_TRAILS, places=folder)
    if name == "last":
        return begun_last(folder, paths)
    exact = [path for path in paths if path.stem == name]
    found = exact or [path for path in paths if name and path.stem.startswith(name)]
    if len(found) == 1:
        return found[0]
    if not found:
        raise AuditError(AuditFault.NO_SESSION, name=name, folder=folder)
    raise AuditError(AuditFault.AMBIGUOUS_SESSION, name=name, matches=len(found), folder=folder)


def _unreadable_line(line: bytes, number: int, why: str) -> UnreadableLine:
    try:
        decoded = msgspec.json.decode(line)
    except UNDECODABLE:
        return UnreadableLine(line=number, kind=NOT_A_RECORD, wall="", text=line[:200].decode("utf-8", "replace"))
    if not isinstance(decoded, dict):
        return UnreadableLine(line=number, kind=NOT_A_RECORD, wall="", text=str(decoded)[:200])
    body = decoded.get("body")
    kind = body.get("kind") if isinstance(body, dict) else None
    text = f"{why}: {msgspec.json.encode(body)[:300].decode('utf-8', 'replace')}"
    return UnreadableLine(line=number, kind=str(kind or NOT_UNDERSTOOD), wall=str(decoded.get("wall", "")), text=text)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """What a list of sessions shows."""

    patient: str
    operator: str
    began: str
    duration_s: float
    records: int
    joints_host: str  # the other computer, whose trail holds what control recorded: the following are None then
    actions: int | None
    completed: int | None
    refusals: int | None
    events: int | None
    stops: int | None
    steps: int | None
    distance_m: float | None


def outline(path: Path) -> Outline:
    """The outline of a session's file. Raises AuditError when it can't be read."""
    return outline_of(records(path))


def outline_of(found: list[Record]) -> Outline:
    """The same from records already read."""
    bodies = [record.body for record in found]
    ends = [body for body in bodies if isinstance(body, ActionEnd)]
    whole = Outline(
        patient=next((body.patient for body in bodies if isinstance(body, PatientChosen)), ""),
        operator=next((record.operator for record in found if record.operator), ""),
        began=found[0].wall if found else "",
        duration_s=duration_s(found),
        records=len(found),
        joints_host=joints_host(found),
        actions=sum(isinstance(body, Command) for body in bodies),
        completed=sum(end.outcome == "completed" for end in ends),
        refusals=sum(isinstance(body, Refusal) for body in bodies),
        events=sum(isinstance(body, EventRaised) for body in bodies),
        stops=sum(isinstance(body, Stop) for body in bodies),
        steps=ends[-1].steps if ends else 0,
        distance_m=ends[-1].distance_m if ends else 0.0,
    )
    if not whole.joints_host:
        return whole
    return replace(
        whole, actions=None, completed=None, refusals=None, events=None, stops=None, steps=None, distance_m=None
    )


def joints_host(found: Sequence[Record]) -> str:
    """The other computer, of a trail of the laptop's; empty: the legs were this computer's."""
    started = next((record.body for record in found if isinstance(record.body, SessionStart)), None)
    joints = started.configuration.get("joints") if started else None
    host = str(joints.get("host", "")) if isinstance(joints, dict) else ""
    return "" if any(record.process == "control" for record in found) else host


def duration_s(found: Sequence[Record]) -> float:
    """From the earliest record to the latest, by the monotonic clock, which nobody can set."""
    moments = [record.monotonic_ns for record in found]
    return (max(moments) - min(moments)) / 1e9 if moments else 0.0
