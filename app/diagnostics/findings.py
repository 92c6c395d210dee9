"""What a doctor command found: a code with values each, and the code of what to do about it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape

from app.text.catalogue import render, tr
from logs.reason import Reason, reason, sanitize_terminal


class Grade(Enum):
    """How a finding stands; shown by mark and colour, so that colour alone tells nothing."""

    GOOD = "good"
    NOTE = "note"
    BAD = "bad"


_MARKS = {Grade.GOOD: ("✓", "green"), Grade.NOTE: ("·", "yellow"), Grade.BAD: ("✗", "red")}
_SUBJECT_CELLS = 11  # a longer name of an interface is never cut short


@dataclass(frozen=True, slots=True)
class Finding:
    """One result; the subject is a code, or the name of an interface."""

    grade: Grade
    subject: Enum | str
    what: Reason
    remedy: Reason | None = None


def good(subject: Enum | str, code: Enum, **values: object) -> Finding:
    """Fit."""
    return Finding(Grade.GOOD, subject, reason(code, **values))


def note(subject: Enum | str, what: Reason, remedy: Reason | None = None) -> Finding:
    """Works, but one should know."""
    return Finding(Grade.NOTE, subject, what, remedy)


def bad(subject: Enum | str, what: Reason, remedy: Reason | None) -> Finding:
    """Does not work; the remedy says what to do."""
    return Finding(Grade.BAD, subject, what, remedy)


def show(console: Console, findings: Iterable[Finding]) -> bool:
    """Print each as it comes; whether none is bad."""
    well = True
    for finding in findings:
        mark, colour = _MARKS[finding.grade]
        subject = sanitize_terminal(finding.subject if isinstance(finding.subject, str) else tr(finding.subject))
        subject += " " * (_SUBJECT_CELLS - cell_len(subject))
        console.print(f"[{colour}]{mark}[/] {escape(f'{subject} {_text(finding.what)}')}", soft_wrap=True)
        if finding.remedy is not None:
            console.print(f"  {'':<{_SUBJECT_CELLS}} → {escape(_text(finding.remedy))}", soft_wrap=True)
        well = well and finding.grade is not Grade.BAD
    return well


def _text(what: Reason) -> str:
    return sanitize_terminal(render(what))
