"""What `audit show` prints: which records, each in a line of text, in colours."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

import msgspec
from rich.text import Text

from logs import records as r
from logs.read import NOT_A_RECORD, NOT_UNDERSTOOD, UnreadableLine
from logs.reason import Reason, Render, sanitize_terminal, text_of
from logs.records import Body, PatientChosen, Record

# Event as recorded with schema 1 → the value of `Event` that stands for it now.
EVENTS: dict[str, str] = {
    "STOP": "stop",
    "STOP pressed again": "stop-again",
    "shutting down": "shutting-down",
    "shutting down, giving way": "shutdown-damping",
    "not armed": "not-armed",
    "no patient confirmed": "no-patient",
    "pre-flight missing": "no-preflight",
    "joint not homed": "not-homed",
    "legs moving": "legs-moving",
    "far from the state's pose": "far-from-pose",
    "camera stale": "camera-stale",
    "perception gone": "perception-timeout",
    "console silent": "console-timeout",
    "audit behind": "audit-backlog",
    "audit queue full": "audit-queue-full",
    "audit gone": "audit-timeout",
    "audit can't write": "audit-write-failed",
    "tick late": "tick-late",
    "control stalled": "control-stalled",
    "host slept": "host-suspended",
    "clock jump": "clock-jump",
    "joint silent": "joint-timeout",
    "drive fault": "drive-fault",
    "drive astray": "drive-untrusted",
    "drives lost power": "drives-power-lost",
    "drives don't obey": "drive-order-failed",
    "joint warm": "over-temperature-warning",
    "joint too hot": "over-temperature",
    "following error": "following-warning",
    "following error too large": "following-limit",
    "joint beyond its range": "out-of-range",
    "joint too fast": "over-speed",
    "torque too high": "over-torque",
    "guard refusal": "guard-refusal",
    "bus fault": "bus-fault",
    "bus disturbed": "bus-errors",
    "unexpected motion": "unexpected-motion",
    "guardian gone": "guardian-timeout",
    "guardian acted": "guardian-acted",
    "planner starting": "planner-starting",
    "planner silent": "planner-timeout",
    "next step missing": "next-step-missing",
    "message rejected": "message-rejected",
}


_PATIENT = str(PatientChosen.__struct_config__.tag)
_UNREADABLE = (NOT_A_RECORD, NOT_UNDERSTOOD)  # their kind can't be read
CAUSES = {"reason", "text", "detail", "explanation"}  # fields with a reason, which may be none
UNKNOWN = "–"
# For colours; a kind that is not named has none.
WEIGHT: dict[type, str] = {
    r.Stop: "grave",
    r.EventRaised: "grave",
    r.GuardRefusal: "grave",
    r.RecordsLost: "grave",
    r.HeartbeatLost: "grave",
    r.ClockStep: "grave",
    r.SignInFailed: "grave",
    r.Refusal: "caution",
    r.Pause: "caution",
    r.Cancel: "caution",
    r.Command: "action",
    r.Transition: "action",
    r.Change: "action",
    r.ActionEnd: "action",
    r.Acknowledgement: "action",
    r.JointStatistics: "faint",
    r.Frames: "faint",
    r.TickLateness: "faint",
    r.Checkpoint: "faint",
    r.OtherTrail: "faint",
}


def kind_of(body: Body) -> str:
    """The kind as it stands in the file."""
    return str(type(body).__struct_config__.tag)


def record_text(body: Body, render: Render) -> str:
    """The record as a line of text; not yet safe for a terminal."""
    values: dict[str, Any] = {name: _shown(name, value) for name, value in msgspec.structs.asdict(body).items()}
    if isinstance(body, r.SessionStart):
        values["version"] = body.versions.get("rleex", UNKNOWN)
    if isinstance(body, r.Change):
        both = ((name, *("" if one is None else str(one) for one in two)) for name, two in body.values.items())
        values["values"] = ", ".join(f"{name}: {before} → {after}" for name, before, after in both)
    counted = isinstance(body, r.EventCleared) and body.total is not None
    name = "EventCounted" if counted else type(body).__name__
    text = text_of(Reason(f"Record.{name}", values), render).replace("  ", " ").rstrip(" :：")
    if _rests_on_assumption(body):
        text += f" {text_of(Reason('distance.assumed'), render)}"
    return text


def _rests_on_assumption(body: Body) -> bool:
    """Whether a distance in it rests on an assumed focal length that no calibration corrects."""
    shows = isinstance(body, r.Press | r.Release | r.Cancel) and body.safe_distance_m is not None
    return shows and body.focal_source == "assumed" and body.anchor_method != "calibrated"  # type: ignore[union-attr]


def _shown(name: str, value: Any) -> Any:
    """A field's value for the wording: numbers stay, so that the wording can choose digits and units."""
    if value is None:
        return "" if name in CAUSES else UNKNOWN
    if isinstance(value, bool):
        return Reason(f"Answer.{'YES' if value else 'NO'}")
    if not isinstance(value, tuple) or not any(isinstance(each, float) for each in value):
        return value
    degrees = name.endswith("_rad")
    numbers = (math.degrees(each) if degrees and each is not None else each for each in value)
    return " ".join(UNKNOWN if each is None else f"{each:.1f}{'°' if degrees else ''}" for each in numbers)


STYLE = {"grave": "bold red", "caution": "yellow", "action": "bold cyan", "faint": "dim", "": ""}


@dataclass(frozen=True, slots=True, kw_only=True)
class Filter:
    """What to show; an empty field lets everything pass. Text is compared without case, by its beginning."""

    since: str = ""  # ISO 8601 in UTC, or its beginning: "2026-11-21", "2026-11-21T09:30"
    until: str = ""
    patient: str = ""
    operator: str = ""
    state: str = ""
    event: str = ""
    gesture: str = ""
    kinds: tuple[str, ...] = ()


class RecordSelector:
    """Lets records pass; it remembers the patient, which only one record of a session names.

    Where that one can't be read, the session may be any patient's.
    """

    def __init__(self, wanted: Filter) -> None:
        self._wanted = wanted
        self._patient: str | None = ""  # None: the line that names the patient can't be read

    def passes(self, record: Record | UnreadableLine) -> bool:
        """Whether to show it; an odd line is never held back by what can't be read in it."""
        wanted = self._wanted
        if isinstance(record, UnreadableLine):
            if not self._patient and record.kind in (_PATIENT, *_UNREADABLE):
                self._patient = None
            return not wanted.kinds or record.kind in (*wanted.kinds, *_UNREADABLE)
        if isinstance(record.body, PatientChosen):
            self._patient = record.body.patient
        return (
            (not wanted.since or record.wall >= wanted.since)
            and (not wanted.until or record.wall[: len(wanted.until)] <= wanted.until)
            and (self._patient is None or _begins(self._patient, wanted.patient))
            and _begins(record.operator, wanted.operator)
            and (not wanted.kinds or kind_of(record.body) in wanted.kinds)
            and _any_begins(record.body, ("state", "from_state", "to_state"), wanted.state)
            and _any_begins(record.body, ("event", "events"), wanted.event)
            and _any_begins(record.body, ("gesture",), wanted.gesture)
        )


def line_of(record: Record | UnreadableLine, render: Render) -> Text:
    """One record for a terminal: safe whatever its text."""
    if isinstance(record, UnreadableLine):
        line = render(Reason("Record.line", {"line": record.line}))
        text = Text(f"{sanitize_terminal(record.wall)[11:23]:<12} {line} ", "dim")
        text.append(f"{sanitize_terminal(record.kind)}: {sanitize_terminal(record.text)}", "magenta")
        return text
    style = STYLE[WEIGHT.get(type(record.body), "")]
    text = Text(f"{sanitize_terminal(record.wall)[11:23]:<12} {record.sequence:>6} ", "dim")
    text.append(f"{sanitize_terminal(record.process):<10.10} {sanitize_terminal(record.operator):<10.10} ", "dim")
    text.append(f"{kind_of(record.body):<17} ", style)
    text.append(sanitize_terminal(record_text(record.body, render)), style)
    return text


def json_of(record: Record | UnreadableLine) -> str:
    """One record as JSON in pure ASCII, safe for a terminal."""
    if isinstance(record, UnreadableLine):
        return json.dumps({"line": record.line, "kind": record.kind, "text": record.text})
    return json.dumps(msgspec.to_builtins(record), ensure_ascii=True, sort_keys=True)


def _begins(text: str, wanted: str) -> bool:
    return text.casefold().startswith(wanted.casefold())


def _any_begins(body: object, fields: tuple[str, ...], wanted: str) -> bool:
    if not wanted:
        return True
    values = (getattr(body, field, None) for field in fields)
    texts = (text for value in values for text in (value if isinstance(value, tuple) else (value,)) if text is not None)
    return any(_begins(text, wanted) or _begins(EVENTS.get(text, text), wanted) for text in texts)
