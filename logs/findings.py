"""What a verification found: a status, a reason and remarks as codes; as text for people and values for programs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path

from rich.text import Text

from logs.reason import Reason, Render, key_of, reason, sanitize_terminal, text_of


class Status(Enum):
    """What became of a file; only the first two are good."""

    SOUND = "sound"
    RUNNING = "running"  # its session is still being written
    INCOMPLETE = "incomplete"  # its end is neither signed nor recorded by a later start: a crash, or a cut
    TAMPERED = "tampered"
    UNREADABLE = "unreadable"


class Verdict(Enum):
    """Why a file has its status, beyond `logs.scan.Break` and `logs.journal.Misplaced`."""

    STILL_WRITTEN = auto()
    NOT_CLOSED = auto()
    NOT_CLOSED_TORN = auto()  # size_bytes
    END_NOT_SIGNED = auto()
    TORN = auto()  # size_bytes
    CLOSE_NOT_IN_MANIFEST = auto()
    NOT_IN_MANIFEST = auto()
    NOT_AS_CLOSED = auto()  # closed, found
    NOT_AS_RECOVERED = auto()  # recovered
    HISTORY_MISSING = auto()
    JOURNAL_CUT = auto()  # remembered, found
    MANIFEST_MISSING = auto()
    MISSING_BY_MANIFEST = auto()
    MISSING_BY_ANCHOR = auto()
    MISSING_BY_MIRROR = auto()
    CHECKPOINT_MISSING = auto()  # checkpoint
    KEY_NOT_KNOWN = auto()  # keys
    NOT_A_TRAIL = auto()
    NO_TRAIL_HERE = auto()
    CAN_NOT_BE_READ = auto()  # detail


class Remark(Enum):
    """What a reader should know beside the status."""

    NO_MANIFEST = auto()
    MANIFEST_UNREADABLE = auto()
    EMPTY = auto()
    RECOVERED = auto()  # how
    NO_MIRROR = auto()
    MIRROR_OF_OTHERS = auto()  # keys
    MIRROR_AGREES = auto()  # checkpoints
    NEWER_SCHEMA = auto()  # schema, known
    TEARS_EXPLAINED = auto()  # tears
    KEY_NOT_CHECKED = auto()  # keys
    END_NOT_KNOWN = auto()  # of a journal: without the console's keys/ends a cut can't be told


class Summary(Enum):
    """How a finding is put together as text."""

    PROOF = auto()  # records, proven
    PROOF_ALONE = auto()  # proof
    WITH_REASON = auto()  # reason, proof
    AT_LINE = auto()  # line, reason, proof
    NEWEST_HASH = auto()  # hash


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """The judgement on one file. `line` and `sequence` name the first bad record, where there is one."""

    file: Path
    status: Status
    reason: Reason | None = None
    line: int | None = None
    sequence: int | None = None
    records: int = 0
    proven: int = 0  # records covered by a signature that a known key confirms
    last_hash: str = ""
    remarks: tuple[Reason, ...] = ()


STYLE = {
    Status.SOUND: "green",
    Status.RUNNING: "cyan",
    Status.INCOMPLETE: "yellow",
    Status.TAMPERED: "bold red",
    Status.UNREADABLE: "bold magenta",
}
_WARNINGS = {key_of(each) for each in (Remark.END_NOT_KNOWN, Remark.KEY_NOT_CHECKED, Remark.MIRROR_OF_OTHERS)}
_BROKEN = (Status.INCOMPLETE, Status.TAMPERED)


def describe(finding: Finding, render: Render) -> Text:
    """One finding: the status, the file, how much holds and is signed, where it breaks and why."""
    text = Text()
    text.append(f"{render(reason(finding.status)):<10} ", STYLE[finding.status])
    text.append(sanitize_terminal(str(finding.file)), "bold")
    text.append(f"\n  {summary(finding, render)}")
    if finding.last_hash.strip("0"):
        text.append(f"\n  {render(reason(Summary.NEWEST_HASH, hash=finding.last_hash))}", "dim")
    for remark in finding.remarks:
        style = "yellow" if remark.code in _WARNINGS else "dim"
        text.append(f"\n  · {sanitize_terminal(text_of(remark, render))}", style)
    return text


def verdict(finding: Finding, render: Render) -> Text:
    """One finding for the head of a screen that shows that file."""
    text = Text(f" {render(reason(finding.status))} ", f"{STYLE[finding.status]} reverse")
    text.append(f" {sanitize_terminal(finding.file.stem)} ", "bold")
    remarks = (f"· {sanitize_terminal(text_of(remark, render))}" for remark in finding.remarks)
    text.append(" ".join((summary(finding, render), *remarks)))
    return text


def summary(finding: Finding, render: Render) -> str:
    """The judgement as one line of text, safe for a terminal."""
    proof = reason(Summary.PROOF, records=finding.records, proven=finding.proven)
    if finding.reason is None:
        whole = reason(Summary.PROOF_ALONE, proof=proof)
    elif finding.line is not None and finding.status in _BROKEN:
        whole = reason(Summary.AT_LINE, line=finding.line, reason=finding.reason, proof=proof)
    else:
        whole = reason(Summary.WITH_REASON, reason=finding.reason, proof=proof)
    return sanitize_terminal(text_of(whole, render))


def path_text(path: Path) -> str:
    """A path for JSON, which is UTF-8: bytes of another encoding are escaped."""
    return str(path).encode(errors="backslashreplace").decode()


def to_values(finding: Finding, render: Render) -> dict[str, object]:
    """For JSON: `code` and `values` are for programs, `reason` and `remarks` for people."""
    return {
        "file": path_text(finding.file),
        "status": finding.status.value,
        "records": finding.records,
        "proven": finding.proven,
        "line": finding.line,
        "sequence": finding.sequence,
        "reason": text_of(finding.reason, render),
        "code": finding.reason.code if finding.reason else "",
        "values": finding.reason.values if finding.reason else {},
        "last_hash": finding.last_hash,
        "remarks": [text_of(remark, render) for remark in finding.remarks],
        "remark_codes": [remark.code for remark in finding.remarks],
    }
