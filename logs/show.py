"""What `audit show` prints: which records, each in a line of text, in colours."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import msgspec
from rich.text import Text

from logs import records as r
from logs.read import Odd
from logs.records import Body, PatientChosen, Record
from logs.sanitize import sanitize_terminal

# Fields in braces; None reads "–", lists are joined, angles of joints are turned into degrees below.
SENTENCES: dict[type, str] = {
    r.SessionStart: "session begins, rleex {versions[rleex]}, simulated: {simulated}",
    r.SessionEnd: "session ends: {reason}",
    r.ProcessStart: "process starts (pid {pid})",
    r.ProcessEnd: "process ends {ended} {reason}",
    r.PatientChosen: "patient {patient}",
    r.PatientConfirmed: "patient {patient} confirmed",
    r.SignIn: "{name} signs in as {role}",
    r.SignOut: "{name} signs out: {reason}",
    r.SignInFailed: "sign-in of {name} refused ({failures} in a row): {reason}",
    r.OperatorChanged: "operator {name} ({role}): {change}",
    r.Camera: "camera {camera}: {width_px}×{height_px}, f {focal_px:.0f} px, {intrinsics_source}",
    r.Calibration: "palm anchor {anchor_m} m, {method} {text}",
    r.Recording: "recording on: {on}, consent noted: {consent} {path}",
    r.GestureOnset: "gesture {gesture}, confidence {confidence:.2f} {explanation}",
    r.Press: "pressed with {gesture} at {distance_m} m (threshold {threshold_m} m)",
    r.Cancel: "press cancelled: {reason}",
    r.Release: "released: {gesture}",
    r.Command: "{action} (#{number}) by {source}, gesture {gesture}, from {state}",
    r.Refusal: "refused {action} by {source}: {reason}",
    r.GuardRefusal: "guard refused {joint} {quantity} {value} (limit {limit}): {reason}",
    r.PlanChecked: "plan #{number} {action}, {phase}, {duration_s:.2f} s, passes: {ok} {reason}",
    r.Transition: "{from_state} → {to_state} ({action})",
    r.ActionEnd: "{action} (#{number}) {outcome} {reason}",
    r.EventRaised: "{event} → {effect}: {text}",
    r.EventCleared: "{event} gone after {lasted_s:.1f} s",
    r.EffectChanged: "effect {from_effect} → {to_effect}",
    r.Acknowledgement: "acknowledged after {waited_s:.1f} s: {events} {reason}",
    r.Stop: "STOP in {state} → {effect}",
    r.Arming: "armed: {armed} {reason}",
    r.Drives: "drives {state} {detail}",
    r.JointStatistics: "angles {angle_mean_rad}, temperature {temperature_c} °C",
    r.TickLateness: "ticks {ticks}, missed {missed}, late p99 {p99_ms:.3f} ms, most {max_ms:.3f} ms",
    r.RealTimePrivilege: "real-time: FIFO {fifo}, memory locked {memory_locked}, core {core}, kept awake {cores_awake}",
    r.HeartbeatLost: "no sign of life of {stream} for {age_ms:.0f} ms",
    r.HeartbeatFound: "sign of life of {stream} again after {silent_ms:.0f} ms",
    r.ClockStep: "wall clock moved by {step_s:+.3f} s",
    r.RecordsLost: "{count} records lost: {reason}",
    r.Note: "note: {text}",
    r.Discomfort: "discomfort {rating}/10 {text}",
    r.Checkpoint: "signed checkpoint over {records} records, closing: {closing}",
    r.LogOpened: "{file} opened",
    r.LogClosed: "{file} closed with {records} records",
    r.LogRecovered: "{file} found unclosed: {text}",
    r.Comment: "comment on record {about_sequence}: {text}",
}

# For colours and for what a reader looks for first; everything else is plain.
WEIGHT: dict[type, str] = {
    r.Stop: "grave",
    r.EventRaised: "grave",
    r.GuardRefusal: "grave",
    r.RecordsLost: "grave",
    r.HeartbeatLost: "grave",
    r.ClockStep: "grave",
    r.SignInFailed: "grave",
    r.Refusal: "caution",
    r.Cancel: "caution",
    r.Command: "action",
    r.Transition: "action",
    r.ActionEnd: "action",
    r.Acknowledgement: "action",
    r.JointStatistics: "faint",
    r.TickLateness: "faint",
    r.Checkpoint: "faint",
}


def kind_of(body: Body) -> str:
    """The kind as it stands in the file."""
    return str(type(body).__struct_config__.tag)


def sentence(body: Body) -> str:
    """The record in a line; not yet harmless for a terminal."""
    values = {name: _plain(name, value) for name, value in msgspec.structs.asdict(body).items()}
    try:
        return SENTENCES[type(body)].format_map(values).strip()
    except (KeyError, ValueError, TypeError):  # a version that is not named, a null where a number was expected
        return ", ".join(f"{name} {value}" for name, value in values.items())


def _plain(name: str, value: Any) -> Any:
    if value is None:
        return "–"
    if isinstance(value, float):
        return round(value, 4)
    if isinstance(value, Mapping) or not isinstance(value, tuple):
        return value
    if name.endswith("_rad"):
        return " ".join("–" if each is None else f"{math.degrees(each):.1f}°" for each in value)
    return " ".join("–" if each is None else f"{each:.1f}" if isinstance(each, float) else str(each) for each in value)


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


class Sieve:
    """Lets records pass; it remembers the patient, which only one record of a session names."""

    def __init__(self, wanted: Filter) -> None:
        self._wanted = wanted
        self._patient = ""

    def passes(self, record: Record | Odd) -> bool:
        """Whether to show it; an odd line is never held back by what can't be read in it."""
        if isinstance(record, Odd):
            return not self._wanted.kinds
        if isinstance(record.body, PatientChosen):
            self._patient = record.body.patient
        wanted = self._wanted
        return (
            (not wanted.since or record.wall >= wanted.since)
            and (not wanted.until or record.wall <= wanted.until)
            and _begins(self._patient, wanted.patient)
            and _begins(record.operator, wanted.operator)
            and (not wanted.kinds or kind_of(record.body) in wanted.kinds)
            and _any_begins(record.body, ("state", "from_state", "to_state"), wanted.state)
            and _any_begins(record.body, ("event", "events"), wanted.event)
            and _any_begins(record.body, ("gesture",), wanted.gesture)
        )


def line_of(record: Record | Odd) -> Text:
    """One record for a terminal: harmless whatever its text."""
    if isinstance(record, Odd):
        text = Text(f"{sanitize_terminal(record.wall)[11:23]:<12} line {record.line:<6} ", "dim")
        text.append(f"{sanitize_terminal(record.kind)}: {sanitize_terminal(record.text)}", "magenta")
        return text
    style = STYLE[WEIGHT.get(type(record.body), "")]
    text = Text(f"{sanitize_terminal(record.wall)[11:23]:<12} {record.sequence:>6} ", "dim")
    text.append(f"{sanitize_terminal(record.process):<10.10} {sanitize_terminal(record.operator):<10.10} ", "dim")
    text.append(f"{kind_of(record.body):<17} ", style)
    text.append(sanitize_terminal(sentence(record.body)), style)
    return text


def json_of(record: Record | Odd) -> str:
    """One record as JSON in pure ASCII, so that a terminal shows it harmlessly."""
    plain = msgspec.structs.asdict(record) if isinstance(record, Record) else None
    if plain is None:
        odd = record
        assert isinstance(odd, Odd)
        return json.dumps({"line": odd.line, "kind": odd.kind, "text": odd.text})
    return json.dumps(msgspec.to_builtins(record), ensure_ascii=True, sort_keys=True)


def time_of(record: Record) -> datetime:
    """Its wall-clock time."""
    return datetime.fromisoformat(record.wall).astimezone(UTC)


def _begins(text: str, wanted: str) -> bool:
    return text.casefold().startswith(wanted.casefold())


def _any_begins(body: object, fields: tuple[str, ...], wanted: str) -> bool:
    if not wanted:
        return True
    values = (getattr(body, field, None) for field in fields)
    texts = (text for value in values for text in (value if isinstance(value, tuple) else (value,)))
    return any(text is not None and _begins(text, wanted) for text in texts)
