"""Journals: files of signed records that grow over many starts (manifest, sign-ins, changes, comments).

The newest settled record of each is remembered beside the console's key (`logs.keys.Anchor`), so that no end can be
cut unseen. A journal that was damaged or cut is left as it is: it goes on in a next part (`changes-2.jsonl`), whose
first record is how the part before was found.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, auto
from hashlib import sha256
from pathlib import Path

import msgspec

from logs.disk import Disk
from logs.errors import AuditError, AuditFault
from logs.keys import Anchor, ConsoleKey, by_fingerprint, read_anchors, write_anchor
from logs.line import GENESIS, MAX_LINE, SIGNED_KINDS, unseal
from logs.reading.errors import UNDECODABLE, cause_of
from logs.reading.regular import open_regular
from logs.reason import Reason, reason
from logs.records import Body, Checkpoint, Entry, LogRecovered, decode_record
from logs.scan import Scan, lines_that_hold, scan_file
from logs.trail import Chain, DiskFault, Trail, open_logger

MANIFEST = "manifest.jsonl"
OPERATORS = "operators.jsonl"  # sign-ins and sign-outs outside of sessions
CHANGES = "changes.jsonl"  # of patients, calibrations, configuration, operators, joints
COMMENTS = ".comments.jsonl"  # behind the name of a session
_NUMBER = r"(?:[2-9]|[1-9][0-9]{1,5})"
_PART = rf"(?:-{_NUMBER})?"
_JOURNAL = re.compile(rf"(?:manifest|operators|changes|.+\.comments){_PART}\.jsonl")


class Found(Enum):
    """How a later start found a file that has no end, or not the one that it had."""

    MISSING = auto()
    NOT_CLOSED = auto()  # records
    TORN = auto()  # records, size_bytes
    DAMAGED = auto()  # line, why
    CUT = auto()  # remembered, found


class Misplaced(Enum):
    """Why a journal is not the one that its name says."""

    PART_ADDED = auto()  # former
    COMMENTS_OF_OTHER = auto()  # session


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Both clocks and the operator: what an entry needs beside its body."""

    wall_ns: int
    monotonic_ns: int
    operator: str = ""

    def entry(self, body: Body) -> Entry:
        """A record of the audit process at this moment."""
        return Entry(
            process="audit",
            operator=self.operator,
            wall_ns=self.wall_ns,
            monotonic_ns=self.monotonic_ns,
            body=body,
        )


def is_journal(path: Path) -> bool:
    """A file that grows over many starts and therefore has no closing checkpoint: its end is signed each time."""
    return _JOURNAL.fullmatch(path.name) is not None


def parted(stem: str) -> tuple[str, int]:
    """The stem of a trail's first part, and which part this one is, from 1."""
    found = re.fullmatch(rf"(.+)-({_NUMBER})", stem, re.DOTALL)
    return (stem, 1) if found is None else (found[1], int(found[2]))


def parts_of(path: Path) -> list[Path]:
    """A journal's parts that are there, oldest first."""
    return sorted(
        (part for part in path.parent.glob("*.jsonl") if _number(path, part.name)),
        key=lambda part: _number(path, part.name),
    )


def part_is_cut(path: Path, anchor: Anchor) -> bool:
    """Whether a sound part lacks the anchored record. A line that only names its hash is not that record."""
    with open_regular(path) as file:
        lines = iter(lambda: file.readline(MAX_LINE), b"")
        return not any((parts := unseal(line)) and parts[1] == anchor.hash == _digest(parts[0]) for line in lines)


def misplaced(path: Path, scan: Scan) -> Reason | None:
    """Why a sound journal can't have its name: it is a copy of another session's comments, or of another part."""
    stem, number = parted(path.stem)
    session = stem.removesuffix(".comments")
    # The records of a session's further files have the session's own name.
    names = {f"comments {name}" for name in (session, parted(session)[0])}
    if session != stem and scan.records and scan.session not in names:
        return reason(Misplaced.COMMENTS_OF_OTHER, session=scan.session.removeprefix("comments "))
    if number == 1 or (begin := first_body(path, scan)) is None:
        return None
    former = f"{stem}.jsonl" if number == 2 else f"{stem}-{number - 1}.jsonl"
    # Its own name: the first record was torn.
    if isinstance(begin, LogRecovered) and begin.file in (former, path.name):
        return None
    return reason(Misplaced.PART_ADDED, former=former)


def first_body(path: Path, scan: Scan) -> Body | None:
    """Of the first record that holds; None where there is none, or of another version."""
    try:
        return next((decode_record(line).body for line in lines_that_hold(path, scan)), None)
    except UNDECODABLE:
        return None


def _digest(content: bytes) -> str:
    return sha256(content).hexdigest()


def current_part(path: Path, key: ConsoleKey) -> tuple[Path, Scan | None, list[LogRecovered]]:
    """The part to go on with, what it holds (None: nothing yet), and what is to be recorded first. Raises OSError."""
    anchors = {name: anchor for name, anchor in read_anchors(key.folder).items() if _number(path, name)}
    # A part that was created and never written, because the disk was full or the process died, is still to be begun.
    begun = {part.name for part in parts_of(path) if not part.is_file() or part.stat().st_size}
    names = begun | anchors.keys()
    if not names:
        return path, None, []
    newest = path.with_name(max(names, key=lambda name: _number(path, name)))
    behind = path.with_name(f"{path.stem}-{_number(path, newest.name) + 1}.jsonl")
    if not newest.exists():
        return behind, None, [found_torn(newest.name, Scan(last_hash=GENESIS), key, reason(Found.MISSING))]
    scan = scan_file(newest, by_fingerprint([key.public]))
    if scan.fault is not None and not scan.is_torn:
        return behind, None, [found_torn(newest.name, scan, key)]
    anchor = anchors.get(newest.name)
    if anchor is not None and anchor.hash != scan.unended_hash and part_is_cut(newest, anchor):
        how = reason(Found.CUT, remembered=anchor.entries, found=scan.records)
        return behind, None, [found_torn(newest.name, scan, key, how)]
    return newest, scan, [found_torn(newest.name, scan, key)] if scan.torn_bytes and not scan.unended_hash else []


def open_part(path: Path, scan: Scan | None, key: ConsoleKey, disk: Disk) -> tuple[Trail, Chain]:
    """Open a part for appending, or begin one. A torn tail gets a line end behind it; the caller records it.

    With its line end a tail that lacked nothing else is a record again, at once: who reads the part next finds it.
    """
    if scan is None:
        return Trail(path, disk, exists=path.exists()), Chain(key)
    trail = Trail(path, disk, exists=True, offset=scan.size)
    if scan.torn_bytes:
        trail.prepend_line_end()
    if scan.unended_hash:
        trail.settle()
        return trail, Chain(key, scan.records + 1, scan.unended_hash)
    return trail, Chain(key, scan.records, scan.last_hash)


def keep_end(path: Path, chain: Chain, key: ConsoleKey, disk: Disk) -> Reason | None:
    """Remember a part's newest record beside the key; why not, when the disk refuses."""
    try:
        write_anchor(key.folder, Anchor(file=path.name, entries=chain.sequence, hash=chain.previous), disk)
    except OSError as error:
        return reason(DiskFault.ANCHOR_NOT_WRITTEN, folder=key.folder, detail=cause_of(error))
    return None


def found_torn(name: str, scan: Scan, key: ConsoleKey, how: Reason | None = None) -> LogRecovered:
    """The entry on how a file was found at a later start, torn tail included."""
    return LogRecovered(
        file=name,
        records=scan.records,
        last_hash=scan.last_hash,
        torn_bytes=scan.torn_bytes,
        torn_sha256=scan.torn_sha256,
        text=how or _how(scan),
        key=key.public.fingerprint,
    )


def append_signed(
    path: Path, session: str, made: Sequence[Body | Entry], key: ConsoleKey, now: Moment, *, disk: Disk | None = None
) -> None:
    """Append records to a journal and sign them; returns when they are on the disk. Raises AuditError if not.

    made: of now, or each with the moment at which it was made.
    """
    disk = disk or Disk()
    entries = [one if isinstance(one, Entry) else now.entry(one) for one in made]
    try:
        msgspec.json.encode(entries)
    except UnicodeEncodeError as error:  # a command's argument that is no UTF-8
        raise AuditError(AuditFault.NOT_UTF8) from error
    with _one_at_a_time(key.folder):
        try:
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            part, scan, former = current_part(path, key)
        except OSError as error:
            raise AuditError(AuditFault.JOURNAL_UNREADABLE, path=path, detail=cause_of(error)) from error
        trail, chain = open_part(part, scan, key, disk)
        logger = open_logger(trail, chain, session)
        for entry in (*map(now.entry, former), *entries):
            logger.record(entry)
        if type(entries[-1].body).__struct_config__.tag not in SIGNED_KINDS:
            seal = Checkpoint(records=chain.sequence, closing=False, key=key.public.fingerprint)
            logger.record(now.entry(seal))
        try:
            fault = keep_end(part, chain, key, disk) if trail.settle() else trail.fault
        finally:
            trail.close()
    if fault is not None:
        raise AuditError(AuditFault.JOURNAL_NOT_WRITTEN, cause=fault)


@contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Console and command line append to the same journals: who reads where one ends must be who goes on."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _number(path: Path, name: str) -> int:
    """Which part of a journal a file name is, from 1; 0: none."""
    if name == path.name:
        return 1
    found = re.fullmatch(rf"{re.escape(path.stem)}{_PART}\.jsonl", name)
    return 0 if found is None else int(name.removesuffix(".jsonl").rpartition("-")[2])


def _how(scan: Scan) -> Reason:
    if scan.fault is None:
        return reason(Found.NOT_CLOSED, records=scan.records)
    if scan.is_torn:
        return reason(Found.TORN, records=scan.records, size_bytes=scan.torn_bytes)
    return reason(Found.DAMAGED, line=scan.fault.line, why=scan.fault.reason)
