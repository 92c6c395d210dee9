"""Reviewers' comments on a session, as far as their journal holds and they are about this session's records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path

from logs.findings import Finding, Status
from logs.journal import COMMENTS, parts_of
from logs.read import records
from logs.reason import Reason, reason
from logs.records import Comment, Record
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
        found = [record for record in _that_hold(finding) if isinstance(record.body, Comment)]
        about = [record for record in found if _is_about(record.body, hash_of)]
        shown += about
        if len(about) < len(found):
            hidden.append(reason(Hidden.OF_OTHER_RECORDS, file=file, count=len(found) - len(about)))
    return Comments(records=tuple(shown), hidden=tuple(hidden))


def _that_hold(finding: Finding) -> list[Record]:
    """Those of a sound file, and those of an incomplete one that a signature covers: a crash tears only the end."""
    if finding.status is Status.SOUND:
        return records(finding.file)
    if finding.status is Status.INCOMPLETE:
        return [record for record in records(finding.file) if record.sequence < finding.proven]
    return []


def _is_about(comment: object, hash_of: Callable[[int], str | None]) -> bool:
    return isinstance(comment, Comment) and hash_of(comment.about_sequence) == comment.about_hash
