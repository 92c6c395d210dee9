"""Reviewers' comments on a session, as far as their journal holds and they are about this session's records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from itertools import islice
from pathlib import Path

from logs.errors import AuditError, AuditFault
from logs.findings import Finding, Status
from logs.journal import COMMENTS, parts_of
from logs.read import understand
from logs.reading.errors import cause_of
from logs.reason import Reason, reason
from logs.records import Comment, Record
from logs.scan import lines_that_hold, scan_file
from logs.verify import Evidence, verify


class Hidden(Enum):
    """Why comments are not shown."""

    NOT_SOUND = auto()  # file, status, why
    OF_OTHER_RECORDS = auto()  # file, count


@dataclass(frozen=True, slots=True, kw_only=True)
class Comments:
    """Those that may be shown, and why others may not."""

    records: tuple[Record, ...]
    hidden: tuple[Reason, ...]


def comments_path(session: Path) -> Path:
    """Where the comments on a session are kept."""
    return session.with_name(session.stem + COMMENTS)


def comments_on(session: Path, evidence: Evidence, hash_of: Callable[[int], str | None]) -> Comments:
    """The comments on a session. hash_of: of its record with that sequence. Raises AuditError."""
    shown: list[Record] = []
    hidden: list[Reason] = []
    for finding in verify(parts_of(comments_path(session)), evidence):
        file = finding.file.name
        if finding.status is not Status.SOUND:
            hidden.append(reason(Hidden.NOT_SOUND, file=file, status=finding.status, why=finding.reason))
        found = [record for record in _that_hold(finding, evidence) if isinstance(record.body, Comment)]
        about = [record for record in found if _is_about(record.body, hash_of)]
        shown += about
        if len(about) < len(found):
            hidden.append(reason(Hidden.OF_OTHER_RECORDS, file=file, count=len(found) - len(about)))
    return Comments(records=tuple(shown), hidden=tuple(hidden))


def _that_hold(finding: Finding, evidence: Evidence) -> list[Record]:
    """Those of a sound file, and those of an incomplete one that a signature covers: a crash tears only the end."""
    holding = {Status.SOUND: finding.records, Status.INCOMPLETE: finding.proven}.get(finding.status, 0)
    if not holding:
        return []
    try:
        lines = lines_that_hold(finding.file, scan_file(finding.file, evidence.keys))
        found = [understand(line, number) for number, line in enumerate(islice(lines, holding), start=1)]
    except OSError as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=finding.file, detail=cause_of(error)) from error
    return [record for record in found if isinstance(record, Record)]


def _is_about(comment: object, hash_of: Callable[[int], str | None]) -> bool:
    return isinstance(comment, Comment) and hash_of(comment.about_sequence) == comment.about_hash
