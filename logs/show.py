"""What `audit show` prints: which records, in which words and colours."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime

import msgspec
from rich.text import Text

from logs.plain import sanitize_terminal
from logs.read import Odd
from logs.records import PatientChosen, Record
from logs.words import WEIGHT, kind_of, sentence

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
