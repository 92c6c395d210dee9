"""The manifest: a signed chain of its own that names every session file a console ever began, and how each ended.

A file that was cut, replaced, removed or slipped in disagrees with it. A damaged or cut manifest is left as it is and
a new one begun, whose first entry records that.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from logs.disk import Disk, is_being_written
from logs.journal import MANIFEST, Found, Moment, current_part, found_torn, keep_end, open_part, parts_of
from logs.keys import ConsoleKey, PublicKey, by_fingerprint
from logs.line import GENESIS
from logs.reading.errors import UNDECODABLE
from logs.reason import Reason, reason
from logs.records import LogClosed, LogOpened, LogRecovered, decode_record
from logs.scan import Scan, lines_that_hold, scan_file
from logs.trail import open_logger

MANIFEST_SESSION = "manifest"
_LogEntry = LogOpened | LogClosed | LogRecovered


@dataclass(slots=True, kw_only=True)
class Listing:
    """The entries of a manifest about the session files beside it."""

    opened: dict[str, None] = field(default_factory=dict)  # in the order in which they were begun
    ended: dict[str, LogClosed | LogRecovered] = field(default_factory=dict)
    hashes: list[str] = field(default_factory=list)  # of its entries, in order
    signers: set[str] = field(default_factory=set)  # keys that its signatures name
    parts: int = 0  # files read

    @property
    def unfinished(self) -> list[str]:
        """Files that were begun and of whose end nothing is known."""
        return sorted(self.opened.keys() - self.ended.keys())


def manifest_paths(folder: Path) -> list[Path]:
    """The manifests of a folder, oldest first."""
    return parts_of(folder / MANIFEST)


def read_listings(folder: Path, keys: Mapping[str, PublicKey], trusted: Container[str] | None = None) -> Listing:
    """The entries of the sound parts of all manifests of a folder; trusted: only those that name one of these keys."""
    listing = Listing()
    for path in manifest_paths(folder):
        scan = scan_file(path, keys)
        listing.signers |= scan.signers
        listing.parts += 1
        _read_into(listing, lines_that_hold(path, scan), trusted)
    return listing


def begun_last(folder: Path, paths: Sequence[Path]) -> Path:
    """Of a folder's trails or recordings, by name, the one whose session was begun last.

    By the manifest, where it has one of them: a name is made of the wall clock, which may have been set back.
    """
    try:
        begun = [Path(name).stem for name in read_listings(folder, {}).opened]
    except OSError:
        begun = []
    places = {stem: place for place, stem in enumerate(begun)}
    return max(reversed(paths), key=lambda path: places.get(path.stem, -1))


def _read_into(listing: Listing, lines: Iterable[bytes], trusted: Container[str] | None) -> None:
    for line in lines:
        try:
            record = decode_record(line)
        except UNDECODABLE:
            continue  # a newer version's
        listing.hashes.append(record.hash)
        if isinstance(record.body, _LogEntry) and (trusted is None or record.body.key in trusted):
            _note(listing, record.body)


def _note(listing: Listing, entry: _LogEntry) -> None:
    if isinstance(entry, LogOpened):
        listing.opened[entry.file] = None
    else:
        listing.ended[entry.file] = entry


class Manifest:
    """The manifest of one folder, open for the entries of this console."""

    def __init__(self, folder: Path, key: ConsoleKey, disk: Disk, now: Moment) -> None:
        self._folder = folder
        self._key = key
        self._disk = disk
        self._anchored = ""  # hash of the newest entry that the anchor has
        self.fault: Reason | None = None
        path, scan, former = current_part(folder / MANIFEST, key)
        self._trail, self._chain = open_part(path, scan, key, disk)
        self._logger = open_logger(self._trail, self._chain, MANIFEST_SESSION)
        self._listing = read_listings(folder, by_fingerprint([key.public]))
        for found in former:
            self._add(found, now)

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
            self.fault = keep_end(self._trail.path, self._chain, self._key, self._disk)
            self._anchored = "" if self.fault else self.head
        return self.fault is None

    def close(self) -> None:
        """Release the file."""
        self._trail.close()

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
