"""A session for the review screen: read once, then queried by moment and by span of time.

Most records of a long session are joint statistics. They are located at once and decoded on demand, so that two
hundred thousand records open at once.
"""

from __future__ import annotations

import time
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path

from app.system.authority import Authority
from app.system.operators import Permission
from logs import comments
from logs.errors import AuditError, AuditFault
from logs.journal import Moment, append_signed
from logs.keys import load_or_make_key
from logs.line import MAX_LINE
from logs.read import UnreadableLine, joints_host, understand
from logs.reading.errors import cause_of
from logs.reading.regular import open_regular
from logs.reason import Cause, Reason
from logs.records import (
    Acknowledgement,
    Body,
    Button,
    Cancel,
    Command,
    Comment,
    EffectChanged,
    EventCleared,
    EventRaised,
    GestureOnset,
    JointStatistics,
    Press,
    ProcessStart,
    Record,
    Refusal,
    Release,
    SessionStart,
    Stop,
    Transition,
)
from logs.verify import Evidence

MAX_SESSION = 1 << 30  # bytes of a trail that is shown whole

_JOINTS = b'"kind":"joints"'
_MONOTONIC = b'"monotonic_ns":'
LANDMARKS = (EventRaised, Stop, Refusal, Cancel, Acknowledgement, Command)  # where a jump stops


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """Something that held from one time to another, in seconds from the session's first record."""

    begin_s: float
    end_s: float
    label: str
    weight: str = ""  # as in logs.show
    cause: Cause = None  # of an event, as recorded


@dataclass(slots=True, kw_only=True)
class Lanes:
    """The session as bands of time."""

    state: list[Span] = field(default_factory=list)
    gesture: list[Span] = field(default_factory=list)
    press: list[Span] = field(default_factory=list)
    effect: list[Span] = field(default_factory=list)
    event: list[Span] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """Everything about one moment."""

    at_s: float
    record: Record | UnreadableLine
    state: str
    gesture: str
    pressed: bool
    effect: str
    events: tuple[Span, ...]
    joints: JointStatistics | None


class ReviewedSession:
    """One session, in the order of its file."""

    def __init__(self, path: Path, lines: list[bytes]) -> None:
        self.path = path
        self._lines = lines
        self.record: Callable[[int], Record | UnreadableLine] = lru_cache(maxsize=4096)(
            lambda index: understand(lines[index], index + 1)
        )
        self._times: list[float] = []
        self._joints: list[int] = []  # indices of joint statistics
        self._landmarks: list[int] = []
        self.joints_host = ""  # the other computer, whose trail has control's records; empty: this one has
        self.lanes = self._read()

    def __len__(self) -> int:
        """Number of records."""
        return len(self._lines)

    @property
    def duration_s(self) -> float:
        """From the first record to the last."""
        return self._times[-1] if self._times else 0.0

    def time(self, index: int) -> float:
        """When a record was made, seconds from the first; never before its predecessor in the file."""
        return self._times[index]

    def index_at(self, at_s: float) -> int:
        """The newest record at a time."""
        return max(bisect_right(self._times, at_s) - 1, 0)

    def around(self, index: int, before: int, after: int) -> range:
        """Indices near a record, for a list."""
        return range(max(index - before, 0), min(index + after + 1, len(self)))

    def landmark_after(self, index: int) -> int | None:
        """The next landmark."""
        place = bisect_right(self._landmarks, index)
        return self._landmarks[place] if place < len(self._landmarks) else None

    def landmark_before(self, index: int) -> int | None:
        """The one before."""
        place = bisect_left(self._landmarks, index) - 1
        return self._landmarks[place] if place >= 0 else None

    def joints_at(self, at_s: float) -> JointStatistics | None:
        """The newest joint statistics at a time."""
        place = bisect_right(self._joints, self.index_at(at_s)) - 1
        if place < 0:
            return None
        record = self.record(self._joints[place])
        return record.body if isinstance(record, Record) and isinstance(record.body, JointStatistics) else None

    def instant(self, index: int) -> Instant:
        """Everything about the moment of a record."""
        at_s = self._times[index]
        return Instant(
            at_s=at_s,
            record=self.record(index),
            state=_label(self.lanes.state, at_s),
            gesture=_label(self.lanes.gesture, at_s),
            pressed=bool(_label(self.lanes.press, at_s)),
            effect=_label(self.lanes.effect, at_s),
            events=tuple(span for span in self.lanes.event if span.begin_s <= at_s <= span.end_s),
            joints=self.joints_at(at_s),
        )

    def _read(self) -> Lanes:
        builder = _LaneBuilder()
        start_ns, newest_s = None, 0.0
        begins: list[Record] = []
        for index, line in enumerate(self._lines):
            moment_ns = _moment_ns(line)
            if moment_ns is not None:
                start_ns = moment_ns if start_ns is None else start_ns
                newest_s = max(newest_s, (moment_ns - start_ns) / 1e9)
            self._times.append(newest_s)
            if _JOINTS in line:
                self._joints.append(index)
            elif isinstance(record := self.record(index), Record):
                if _begins_anew(record):
                    builder.end_decisions(newest_s)
                builder.add(record.body, newest_s)
                if isinstance(record.body, SessionStart | ProcessStart):
                    begins.append(record)
                if isinstance(record.body, LANDMARKS):
                    self._landmarks.append(index)
        self.joints_host = joints_host(begins)
        return builder.finish(newest_s)


class _LaneBuilder:
    """Turns records of changes into spans from one change to the next."""

    def __init__(self) -> None:
        self._lanes = Lanes()
        self._open: dict[str, tuple[float, str]] = {}
        self._events: dict[str, tuple[float, EventRaised]] = {}

    def add(self, body: Body, at_s: float) -> None:
        match body:
            case Transition(from_state=before, to_state=after):
                self._open.setdefault("state", (0.0, before))
                self._change("state", after, at_s)
            case Command(state=state):
                self._open.setdefault("state", (0.0, state))
            case GestureOnset(gesture=gesture):
                self._change("gesture", gesture or "", at_s)
            case Press(gesture=gesture):
                self._change("press", gesture or "pressed", at_s)
            case Release() | Cancel():
                self._change("press", "", at_s)
            case EffectChanged(to_effect=effect):
                self._change("effect", "" if effect == "note" else effect, at_s)
            case EventRaised(event=event):
                self._events.setdefault(event, (at_s, body))
            case EventCleared(event=event):
                self._end_event(event, at_s)
            case Stop():
                self._lanes.event.append(Span(begin_s=at_s, end_s=at_s, label="STOP", weight="grave"))

    def finish(self, at_s: float) -> Lanes:
        for lane in list(self._open):
            self._change(lane, "", at_s)
        for event in list(self._events):
            self._end_event(event, at_s)
        self._lanes.event.sort(key=lambda span: span.begin_s)
        return self._lanes

    def end_decisions(self, at_s: float) -> None:
        self._change("gesture", "", at_s)
        self._change("press", "", at_s)

    def _change(self, lane: str, label: str, at_s: float) -> None:
        opened = self._open.pop(lane, None)
        if opened is not None and opened[1]:
            getattr(self._lanes, lane).append(Span(begin_s=opened[0], end_s=at_s, label=opened[1]))
        self._open[lane] = (at_s, label)

    def _end_event(self, event: str, at_s: float) -> None:
        opened = self._events.pop(event, None)
        if opened is not None:
            begin_s, raised = opened
            weight = "caution" if raised.effect in ("note", "refuse") else "grave"
            span = Span(begin_s=begin_s, end_s=at_s, label=event, weight=weight, cause=raised.text)
            self._lanes.event.append(span)


def _begins_anew(record: Record) -> bool:
    """Whether vote and button do: a perception that was killed has ended neither press nor gesture."""
    return isinstance(record.body, Button) or (isinstance(record.body, ProcessStart) and record.process == "perception")


def open_session(path: Path) -> ReviewedSession:
    """Read a session. Raises AuditError when the file can't be read or holds nothing."""
    try:
        with open_regular(path, MAX_SESSION) as file:
            lines = list(iter(partial(file.readline, MAX_LINE), b""))
    except OSError as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=path, detail=cause_of(error)) from error
    if not lines:
        raise AuditError(AuditFault.TRAIL_EMPTY, path=path)
    return ReviewedSession(path, lines)


def _moment_ns(line: bytes) -> int | None:
    """The monotonic time of a canonical line, found without decoding it; quotes in text are escaped."""
    place = line.rfind(_MONOTONIC)
    digits = line[place + len(_MONOTONIC) : place + len(_MONOTONIC) + 20].split(b",", 1)[0]
    return int(digits) if place >= 0 and digits.isdigit() else None


def visible(spans: Iterable[Span], begin_s: float, end_s: float) -> Iterator[Span]:
    """Those of a lane that touch a stretch of time."""
    return (span for span in spans if span.end_s >= begin_s and span.begin_s <= end_s)


def _label(spans: list[Span], at_s: float) -> str:
    place = bisect_right(spans, at_s, key=lambda span: span.begin_s) - 1
    if place < 0 or spans[place].end_s < at_s:
        return ""
    return spans[place].label


def comments_on(session: ReviewedSession, evidence: Evidence) -> tuple[dict[int, list[Comment]], tuple[Reason, ...]]:
    """The comments by the record that they are about, and why others are not shown. Raises AuditError."""

    def hash_of(sequence: int) -> str | None:
        record = session.record(sequence) if 0 <= sequence < len(session) else None
        return record.hash if isinstance(record, Record) and record.sequence == sequence else None

    on = comments.comments_on(session.path, evidence, hash_of)
    found: dict[int, list[Comment]] = {}
    for record in on.records:
        if isinstance(record.body, Comment):
            found.setdefault(record.body.about_sequence, []).append(record.body)
    return found, on.hidden


def write_comment(by: Authority, session: Path, about: Record, text: str) -> None:
    """Sign a comment with the console's key and append it. Raises AppError, AuditError when it can't be written."""
    by.require(Permission.REVIEW)
    now = Moment(wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns(), operator=by.name)
    key = load_or_make_key(by.home.keys)
    comment = Comment(about_sequence=about.sequence, about_hash=about.hash, text=text, key=key.public.fingerprint)
    append_signed(comments.comments_path(session), f"comments {about.session}", [comment], key, now)
