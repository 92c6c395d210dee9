"""A verifier's findings in words for people, and as plain values for programs."""

from __future__ import annotations

from rich.text import Text

from logs.sanitize import sanitize_terminal
from logs.verify import Finding, Status

_STYLE = {
    Status.SOUND: "green",
    Status.RUNNING: "cyan",
    Status.INCOMPLETE: "yellow",
    Status.TAMPERED: "bold red",
    Status.UNREADABLE: "bold magenta",
}


def describe(finding: Finding) -> Text:
    """One finding: the word, the file, how much holds and is signed, where it breaks and why."""
    text = Text()
    text.append(f"{finding.status.value.upper():<10} ", _STYLE[finding.status])
    text.append(sanitize_terminal(str(finding.file)), "bold")
    text.append(f"\n  {summary(finding)}")
    if finding.last_hash.strip("0"):
        text.append(f"\n  newest hash that holds: {finding.last_hash}", "dim")
    for remark in finding.remarks:
        text.append(f"\n  · {sanitize_terminal(remark)}", "dim")
    return text


def verdict(finding: Finding) -> Text:
    """One finding for the head of a screen that shows that file."""
    text = Text(f" {finding.status.value.upper()} ", f"{_STYLE[finding.status]} reverse")
    text.append(f" {sanitize_terminal(finding.file.stem)} ", "bold")
    text.append(" ".join((summary(finding), *(f"· {sanitize_terminal(remark)}" for remark in finding.remarks))))
    return text


def summary(finding: Finding) -> str:
    """The judgement in a sentence."""
    proof = f"{finding.records} records hold, {finding.proven} of them under a checked signature"
    if not finding.reason:
        return f"{proof}."
    where = f"line {finding.line}: " if finding.line is not None and finding.status in _BROKEN else ""
    return f"{where}{sanitize_terminal(finding.reason)}. {proof}."


_BROKEN = (Status.INCOMPLETE, Status.TAMPERED)


def as_plain(finding: Finding) -> dict[str, object]:
    """For JSON."""
    return {
        "file": str(finding.file),
        "status": finding.status.value,
        "records": finding.records,
        "proven": finding.proven,
        "line": finding.line,
        "sequence": finding.sequence,
        "reason": finding.reason,
        "last_hash": finding.last_hash,
        "remarks": list(finding.remarks),
    }
