"""Whether two trails belong to one truth: every record that either names of the other must be there, in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from itertools import groupby
from pathlib import Path

from rich.text import Text

from logs.findings import STYLE, Finding, Status, path_text
from logs.mentions import Mention, TrailIndex, index_trail
from logs.reason import Reason, Render, reason, sanitize_terminal, text_of
from logs.records import OtherTrail
from logs.verify import is_session


class Contradiction(Enum):
    """Why two trails can't both be as they were written; `named` is what one says of the other."""

    OTHER_RECORD = auto()  # at, sequence, named, found, agreed
    ENDS_BEFORE = auto()  # at, sequence, found, agreed
    OTHER_BEGINNING = auto()  # at, session
    OTHER_KEY = auto()  # at, named, found
    BACKWARDS = auto()  # at, sequence, before
    LATER_THAN_ITS_MENTION = auto()  # at, sequence, names


class Gap(Enum):
    """Why a join is not proven, without a contradiction."""

    OTHER_TRAIL_MISSING = auto()  # session, key, mentions
    NAMES_NOTHING = auto()


class JoinSummary(Enum):
    """How a join is put together as text."""

    CHECKED = auto()  # mentions, sequence, newer


@dataclass(frozen=True, slots=True, kw_only=True)
class Join:
    """What one trail proves of another."""

    file: Path  # which names
    other: Path | None  # which is named; None: not given
    status: Status
    reason: Reason | None = None
    sequence: int | None = None  # of the record in `file` that contradicts
    mentions: int = 0  # that agree
    confirmed: int = 0  # records of the other trail up to the newest that agrees
    newer: int = 0  # records of the other trail behind it: nothing but its own signature stands for them

    @property
    def is_contradiction(self) -> bool:
        """Whether the two can't both be as they were written."""
        return self.status is Status.TAMPERED


def join_findings(findings: Sequence[Finding]) -> list[Join]:
    """The joins between the sessions of a verification, as far as each chain holds. Raises OSError."""
    sessions = [finding for finding in findings if finding.records and is_session(finding.file)]
    return joins([index_trail(finding.file, finding.records) for finding in sessions])


def joins(trails: Sequence[TrailIndex]) -> list[Join]:
    """Each trail against each that it names, and the way back."""
    found = [join for trail in trails for join in _of_one(trail, trails)]
    there = {(join.file, join.other) for join in found}
    by_path = {trail.path: trail for trail in trails}
    back = [
        Join(
            file=join.other,
            other=join.file,
            status=Status.INCOMPLETE,
            reason=reason(Gap.NAMES_NOTHING),
            newer=by_path[join.file].records,
        )
        for join in found
        if join.other is not None and (join.other, join.file) not in there
    ]
    return found + back


def first_contradiction(trails: Sequence[TrailIndex]) -> Join | None:
    """The first join that does not hold; None: no contradiction."""
    return next((join for join in joins(trails) if join.is_contradiction), None)


def _of_one(trail: TrailIndex, trails: Sequence[TrailIndex]) -> Iterator[Join]:
    def which(mention: Mention) -> tuple[str, str, str]:
        return mention.of.session, mention.of.first_hash, mention.of.key

    for _, group in groupby(sorted(trail.mentions, key=which), key=which):
        mentions = list(group)
        yield _against(trail, mentions, _find(mentions[0].of, trail, trails))


def _find(named: OtherTrail, trail: TrailIndex, trails: Sequence[TrailIndex]) -> TrailIndex | None:
    """The trail that is meant: by its first record, else by session and key, which a rewritten one keeps."""
    others = [other for other in trails if other.path != trail.path]
    exact = [other for other in others if other.first_hash == named.first_hash]
    alike = [other for other in others if other.session == named.session and named.key in other.keys]
    return next(iter(exact + alike), None)


def _against(trail: TrailIndex, mentions: list[Mention], other: TrailIndex | None) -> Join:
    first = mentions[0].of
    if other is None:
        missing = reason(Gap.OTHER_TRAIL_MISSING, session=first.session, key=first.key[:12], mentions=len(mentions))
        return Join(file=trail.path, other=None, status=Status.INCOMPLETE, reason=missing)
    agreed = 0
    before: OtherTrail | None = None
    latest = _LatestNamed(other.mentions, trail.first_hash)
    for mention in mentions:
        wrong = _contradiction(mention, other, before, latest.up_to(mention.of.sequence))
        if wrong is not None:
            return _joined(trail, other, before, agreed, reason=wrong, at=mention.at)
        before, agreed = mention.of, agreed + 1
    return _joined(trail, other, before, agreed)


def _joined(
    trail: TrailIndex,
    other: TrailIndex,
    newest: OtherTrail | None,
    agreed: int,
    *,
    reason: Reason | None = None,
    at: int | None = None,
) -> Join:
    confirmed = newest.sequence + 1 if newest is not None else 0
    return Join(
        file=trail.path,
        other=other.path,
        status=Status.SOUND if reason is None else Status.TAMPERED,
        reason=reason,
        sequence=at,
        mentions=agreed,
        confirmed=confirmed,
        newer=max(0, other.records - confirmed),
    )


class _LatestNamed:
    """Of the other trail's mentions of this one, the latest record named so far; asked in rising order."""

    def __init__(self, mentions: Iterable[Mention], first_hash: str) -> None:
        self._rest = [mention for mention in reversed(list(mentions)) if mention.of.first_hash == first_hash]
        self._latest = -1

    def up_to(self, sequence: int) -> int:
        """By the other trail's records up to this sequence; -1: none is named."""
        while self._rest and self._rest[-1].at <= sequence:
            self._latest = max(self._latest, self._rest.pop().of.sequence)
        return self._latest


def _contradiction(mention: Mention, other: TrailIndex, before: OtherTrail | None, names: int) -> Reason | None:
    """names: the latest record of this trail that the other one knew when it wrote the record that is mentioned."""
    agreed = before.sequence if before is not None else -1
    return _of_identity(mention, other) or _of_record(mention, other, agreed) or _of_order(mention, agreed, names)


def _of_identity(mention: Mention, other: TrailIndex) -> Reason | None:
    named, at = mention.of, mention.at
    if other.first_hash != named.first_hash:
        return reason(Contradiction.OTHER_BEGINNING, at=at, session=named.session)
    if foreign := sorted(other.keys - {named.key}):
        return reason(Contradiction.OTHER_KEY, at=at, named=named.key[:12], found=foreign[0][:12])
    return None


def _of_record(mention: Mention, other: TrailIndex, agreed: int) -> Reason | None:
    named, values = mention.of, {"at": mention.at, "sequence": mention.of.sequence, "agreed": agreed}
    if named.sequence >= other.records:
        return reason(Contradiction.ENDS_BEFORE, found=other.records, **values)
    found = other.hash_at(named.sequence)
    if found != named.hash:
        return reason(Contradiction.OTHER_RECORD, named=named.hash[:12], found=found[:12], **values)
    return None


def _of_order(mention: Mention, agreed: int, names: int) -> Reason | None:
    at, sequence = mention.at, mention.of.sequence
    if sequence < agreed:
        return reason(Contradiction.BACKWARDS, at=at, sequence=sequence, before=agreed)
    if names >= at:
        return reason(Contradiction.LATER_THAN_ITS_MENTION, at=at, sequence=sequence, names=names)
    return None


def describe_join(join: Join, render: Render) -> Text:
    """One join for people: who names whom, how far it is checked, and the first contradiction."""
    text = Text()
    text.append(f"{render(reason(join.status)):<10} ", STYLE[join.status])
    names = [join.file.stem] + ([join.other.stem] if join.other else [])
    text.append(sanitize_terminal(" → ".join(names)), "bold")
    if join.reason is not None:
        text.append(f"\n  {sanitize_terminal(text_of(join.reason, render))}")
    if join.mentions:
        checked = reason(JoinSummary.CHECKED, mentions=join.mentions, sequence=join.confirmed - 1, newer=join.newer)
        text.append(f"\n  {text_of(checked, render)}")
    return text


def join_values(join: Join, render: Render) -> dict[str, object]:
    """For JSON: `code` and `values` are for programs, `reason` for people."""
    return {
        "file": path_text(join.file),
        "other": path_text(join.other) if join.other else None,
        "status": join.status.value,
        "code": join.reason.code if join.reason else "",
        "values": join.reason.values if join.reason else {},
        "reason": text_of(join.reason, render),
        "sequence": join.sequence,
        "mentions": join.mentions,
        "confirmed": join.confirmed,
        "newer": join.newer,
    }
