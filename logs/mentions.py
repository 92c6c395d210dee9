"""What two trails say of each other: the records in which a trail names the newest record of the other computer's."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from logs.line import MAX_LINE, unseal
from logs.reading.errors import UNDECODABLE
from logs.reading.regular import open_regular
from logs.records import OtherTrail, decode_record
from logs.scan import head_of

_HASH_BYTES = 32
# Quotes inside of text are escaped, so only the field itself can match.
_MENTION = b'"kind":"other-trail"'
_CHECKPOINT = b'"kind":"checkpoint"'


@dataclass(frozen=True, slots=True, kw_only=True)
class Mention:
    """A record that names one of the other trail; `at` is its own sequence, `monotonic_ns` of its own clock."""

    at: int
    monotonic_ns: int
    of: OtherTrail


@dataclass(slots=True, kw_only=True)
class TrailIndex:
    """One trail: the hash of each record that holds, who signed it, and what it says of other trails."""

    path: Path
    session: str = ""
    keys: set[str] = field(default_factory=set)  # fingerprints that its checkpoints name
    mentions: list[Mention] = field(default_factory=list)
    _hashes: bytearray = field(default_factory=bytearray)

    @property
    def records(self) -> int:
        """How many it holds."""
        return len(self._hashes) // _HASH_BYTES

    @property
    def first_hash(self) -> str:
        """Which trail it is; empty: it holds nothing."""
        return self.hash_at(0) if self.records else ""

    def hash_at(self, sequence: int) -> str:
        """The hash of the record with this sequence, below `records`."""
        return self._hashes[sequence * _HASH_BYTES : (sequence + 1) * _HASH_BYTES].hex()

    def add(self, line: bytes, digest: str) -> None:
        """The next line, whose chain has been checked."""
        sequence = self.records
        self._hashes += bytes.fromhex(digest)
        if _CHECKPOINT in line or not sequence:
            self._add_head(line)
        if _MENTION in line:
            self._add_mention(line, sequence)

    def _add_head(self, line: bytes) -> None:
        head = head_of(line)
        if head is None:
            return
        self.session = head.session
        if head.body.kind == "checkpoint":
            self.keys.add(head.body.key)

    def _add_mention(self, line: bytes, sequence: int) -> None:
        try:
            record = decode_record(line)
        except UNDECODABLE:
            return  # of a newer version: nothing that this one could check
        if isinstance(record.body, OtherTrail):
            self.mentions.append(Mention(at=sequence, monotonic_ns=record.monotonic_ns, of=record.body))


def index_trail(path: Path, records: int) -> TrailIndex:
    """The first `records` of a trail: those whose chain holds. Raises OSError."""
    index = TrailIndex(path=path)
    with open_regular(path) as file:
        for line in iter(partial(file.readline, MAX_LINE), b""):
            if index.records >= records:
                break
            if (parts := unseal(line)) is not None:
                index.add(line, parts[1])
    return index
