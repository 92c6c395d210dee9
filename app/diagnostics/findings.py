"""What a doctor command found, each with what mends it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from rich.console import Console
from rich.markup import escape


class Grade(Enum):
    """How a finding stands, told by word and mark, not by colour alone."""

    GOOD = "good"
    NOTE = "note"
    BAD = "bad"


_MARKS = {Grade.GOOD: ("✓", "green"), Grade.NOTE: ("·", "yellow"), Grade.BAD: ("✗", "red")}


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at; `remedy` is a command or a sentence on what to do."""

    grade: Grade
    subject: str
    text: str
    remedy: str = ""


def good(subject: str, text: str) -> Finding:
    """All is well."""
    return Finding(Grade.GOOD, subject, text)


def note(subject: str, text: str, remedy: str = "") -> Finding:
    """Works, but one should know."""
    return Finding(Grade.NOTE, subject, text, remedy)


def bad(subject: str, text: str, remedy: str) -> Finding:
    """Does not work, and this mends it."""
    return Finding(Grade.BAD, subject, text, remedy)


def show(console: Console, findings: Iterable[Finding]) -> bool:
    """Print each as it comes; whether none is bad."""
    well = True
    for finding in findings:
        mark, colour = _MARKS[finding.grade]
        console.print(f"[{colour}]{mark}[/] {finding.subject:<11} {escape(finding.text)}", soft_wrap=True)
        if finding.remedy:
            console.print(f"  {'':<11} → {escape(finding.remedy)}", soft_wrap=True)
        well = well and finding.grade is not Grade.BAD
    return well
