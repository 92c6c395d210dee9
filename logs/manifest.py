"""The manifest: a signed chain of its own that names every session file a console ever began, and how each ended.

A file that was cut, replaced, removed or slipped in disagrees with it. A damaged manifest is left as it is and a
new one begun, whose first entry records that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path

import msgspec

from logs.disk import Disk, is_being_written
from logs.errors import AuditError, AuditFault
from logs.keys import Anchor, ConsoleKey, PublicKey, by_fingerprint, write_anchor
from logs.line import GENESIS, MAX_LINE, SIGNED_KINDS
from logs.reading.regular import open_regular
from logs.reason import Reason, reason
from logs.records import Body, Checkpoint, Entry, LogClosed, LogOpened, LogRecovered, Record
from logs.scan import Scan, scan_file
from logs.trail import Chain, DiskFault, Trail, open_logger

MANIFEST_SESSION = "manifest"


class Found(Enum):
    """How a later start found a file that has no end."""

    MISSING = auto()
    NOT_CLOSED = auto()  # records
    TORN = auto()  # records, size_bytes
    DAMAGED = auto()  # line, why


_LogEntry = LogOpened | LogClosed | LogRecovered
_decode = msgspec.json.Decoder(Record).decode


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


@dataclass(slots=True, kw_only=True)
class Listing:
    """The entries of a manifest about the session files beside it."""

    opened: set[str] = field(default_factory=set)
    ended: dict[str, LogClosed | LogRecovered] = field(default_factory=dict)
    hashes: list[str] = field(default_factory=list)  # of its entries, in order

    @property
    def unfinished(self) -> list[str]:
        """Files that were begun and of whose end nothing is known."""
        return sorted(self.opened - self.ended.keys())


def manifest_paths(folder: Path) -> list[Path]:
    """The manifests of a folder, oldest first."""
    numbered = {int(path.stem.partition("-")[2] or 1): path for path in folder.glob("manifest*.jsonl")}
    return [numbered[number] for number in sorted(numbered)]


def read_listings(folder: Path, keys: Mapping[str, PublicKey]) -> Listing:
    """The entries of the sound parts of all manifests of a folder."""
    listing = Listing()
    for path in manifest_paths(folder):
        _read_into(listing, path, scan_file(path, keys).records)
    return listing


def _read_into(listing: Listing, path: Path, records: int) -> None:
    taken = 0
    with open_regular(path) as file:
        while taken < records and (line := file.readline(MAX_LINE)):
            try:
                record = _decode(line)
            except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                continue  # a torn tail that a later entry explains
            taken += 1
            _note(listing, record)


def _note(listing: Listing, record: Record) -> None:
    listing.hashes.append(record.hash)
    match record.body:
        case LogOpened(file=file):
            listing.opened.add(file)
        case LogClosed(file=file) | LogRecovered(file=file):
            listing.ended[file] = record.body


def resume(path: Path, key: ConsoleKey, disk: Disk) -> tuple[Trail, Chain, Scan | None]:
    """Open a chain for appending, or a new one. A torn tail gets a line end behind it; the caller records it."""
    if not path.exists():
        return Trail(path, disk), Chain(key), None
    scan = scan_file(path, by_fingerprint([key.public]))
    trail = Trail(path, disk, exists=True, offset=scan.size)
    if scan.torn_bytes:
        trail.prepend_line_end()
    return trail, Chain(key, scan.records, scan.last_hash), scan


class Manifest:
    """The manifest of one folder, open for the entries of this console."""

    def __init__(self, folder: Path, key: ConsoleKey, disk: Disk, now: Moment) -> None:
        self._folder = folder
        self._key = key
        self._disk = disk
        self._anchored = ""  # hash of the newest entry that the anchor has
        self.fault: Reason | None = None
        path, damaged = _current(folder, key)
        self._trail, self._chain, scan = resume(path, key, disk)
        self._logger = open_logger(self._trail, self._chain, MANIFEST_SESSION)
        self._listing = read_listings(folder, by_fingerprint([key.public]))
        for former, former_scan in damaged:
            self._add(found_torn(former.name, former_scan, key), now)
        if scan is not None and scan.torn_bytes:
            self._add(found_torn(path.name, scan, key), now)

    @property
    def entries(self) -> int:
        """How many entries it has."""
        return self._chain.sequence

    @property
    def head(self) -> str:
        """Hash of the newest entry."""
        return self._chain.previous

    def recover(self, now: Moment) -> list[LogRecovered]:
        """Record how every file was found that a crash left without an end. Returns what was recorded."""
        found = [self._inspect(name) for name in self._listing.unfinished]
        recovered = [entry for entry in found if entry is not None]
        for entry in recovered:
            self._add(entry, now)
        return recovered

    def opened(self, file: str, now: Moment) -> None:
        """A session's file has been created."""
        self._add(LogOpened(file=file, key=self._key.public.fingerprint), now)

    def closed(self, file: str, records: int, last_hash: str, now: Moment) -> None:
        """A session's file has been closed in good order."""
        self._add(LogClosed(file=file, records=records, last_hash=last_hash, key=self._key.public.fingerprint), now)

    def settle(self) -> bool:
        """Bring every entry to the disk and the anchor up to date; False, with `fault`, when the disk refuses."""
        if not self._trail.settle():
            self.fault = self._trail.fault
            return False
        self.fault = None
        if self._anchored != self.head:
            self._anchor()
        return self.fault is None

    def close(self) -> None:
        """Release the file."""
        self._trail.close()

    def _anchor(self) -> None:
        try:
            anchor = Anchor(file=self._trail.path.name, entries=self.entries, hash=self.head)
            write_anchor(self._key.folder, anchor, self._disk)
            self._anchored = self.head
        except OSError as error:
            self.fault = reason(DiskFault.ANCHOR_NOT_WRITTEN, folder=self._key.folder, detail=error.strerror)

    def _add(self, body: _LogEntry, now: Moment) -> None:
        self._logger.record(now.entry(body))

    def _inspect(self, name: str) -> LogRecovered | None:
        path = self._folder / name
        if not path.exists():
            missing = Scan(last_hash=GENESIS)
            return found_torn(name, missing, self._key, reason(Found.MISSING))
        if is_being_written(path):
            return None
        return found_torn(name, scan_file(path, by_fingerprint([self._key.public])), self._key)


def _current(folder: Path, key: ConsoleKey) -> tuple[Path, list[tuple[Path, Scan]]]:
    """The manifest to go on with, and the newest one before it if that is damaged and not yet replaced."""
    paths = manifest_paths(folder)
    if not paths:
        return folder / "manifest.jsonl", []
    scan = scan_file(paths[-1], by_fingerprint([key.public]))
    if scan.fault is None or scan.is_torn:
        return paths[-1], []
    return folder / f"manifest-{len(paths) + 1}.jsonl", [(paths[-1], scan)]


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


def _how(scan: Scan) -> Reason:
    if scan.fault is None:
        return reason(Found.NOT_CLOSED, records=scan.records)
    if scan.is_torn:
        return reason(Found.TORN, records=scan.records, size_bytes=scan.torn_bytes)
    return reason(Found.DAMAGED, line=scan.fault.line, why=scan.fault.reason)


OPERATORS = "operators.jsonl"
COMMENTS = ".comments.jsonl"


def append_signed(
    path: Path, session: str, bodies: list[Body], key: ConsoleKey, now: Moment, *, disk: Disk | None = None
) -> None:
    """Append records to a journal and sign them; returns when they are on the disk.

    Raises AuditError when the disk refuses, or when the journal was changed and must be checked first.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        trail, chain, scan = resume(path, key, disk or Disk())
    except OSError as error:
        raise AuditError(AuditFault.JOURNAL_UNREADABLE, path=path, detail=error.strerror) from error
    if scan is not None and scan.fault is not None and not scan.is_torn:
        raise AuditError(AuditFault.JOURNAL_CHANGED, path=path, line=scan.fault.line)
    logger = open_logger(trail, chain, session)
    if scan is not None and scan.torn_bytes:
        logger.record(now.entry(found_torn(path.name, scan, key)))
    for body in bodies:
        logger.record(now.entry(body))
    if type(bodies[-1]).__struct_config__.tag not in SIGNED_KINDS:
        seal = Checkpoint(records=chain.sequence, closing=False, key=key.public.fingerprint)
        logger.record(now.entry(seal))
    try:
        if not trail.settle():
            raise AuditError(AuditFault.JOURNAL_NOT_WRITTEN, cause=trail.fault)
    finally:
        trail.close()
