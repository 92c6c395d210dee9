"""One file of chained records, read from its first byte to its last: how far the chain holds, and where it breaks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import partial
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Annotated, BinaryIO

import msgspec
from msgspec import Meta, Struct

from logs.keys import PublicKey
from logs.line import GENESIS, MAX_LINE, SEAL_LENGTH, SIGNED_KINDS, is_whole, signed_message, unseal
from logs.reading.errors import UNDECODABLE
from logs.reading.regular import open_regular
from logs.reason import Reason, reason
from logs.records import SCHEMA

Progress = Callable[[int], None]
_PROGRESS_LINES = 20_000


class Break(Enum):
    """Why a line breaks the chain."""

    CHANGED = auto()  # its content does not match its hash
    NO_RECORD = auto()
    OUT_OF_SEQUENCE = auto()  # found, expected
    NOT_LINKED = auto()  # it does not follow the record before
    OTHER_SESSION = auto()
    BAD_SIGNATURE = auto()  # key
    TOO_LONG = auto()  # size_bytes
    CUT_OFF = auto()  # size_bytes
    TOO_SHORT = auto()
    NOT_SEALED = auto()


Count = Annotated[int, Meta(ge=0, le=1 << 53)]  # a line that claims more is no record


class BodyHead(Struct, frozen=True, kw_only=True):
    """What the chain needs to know of a body."""

    kind: str
    closing: bool = False
    key: str = ""
    signature: str = ""
    torn_bytes: Count = 0
    torn_sha256: str = ""


class Head(Struct, frozen=True, kw_only=True):
    """What the chain needs to know of a record; the rest is skipped, whichever version wrote it."""

    body: BodyHead
    previous: str
    schema: Count
    sequence: Count
    session: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """The first record that does not hold; `line` counts from 1."""

    line: int
    sequence: int | None
    reason: Reason


@dataclass(slots=True, kw_only=True)
class Scan:
    """What one reading of a file found."""

    records: int = 0  # that hold, from the first
    last_hash: str = GENESIS
    session: str = ""
    size: int = 0  # bytes read
    fault: Fault | None = None
    is_torn: bool = False  # the fault is a tail that a crash leaves: nothing whole stands behind it
    fault_is_sealed: bool = False  # the first bad line has at least a sealed record's shape
    torn_bytes: int = 0
    torn_sha256: str = ""
    unended_hash: str = ""  # of the torn tail, where it is the next record and lacks only its line end
    tears: list[range] = field(default_factory=list)  # lines of torn tails that a later signed record explains
    closed: bool = False  # ends with a closing checkpoint
    proven: int = 0  # records covered by the newest good signature
    signers: set[str] = field(default_factory=set)  # keys that its signatures name
    unknown_keys: set[str] = field(default_factory=set)
    newer_schema: int = 0  # a schema that this program does not know


_decode = msgspec.json.Decoder(Head).decode


def scan_file(path: Path, keys: Mapping[str, PublicKey], progress: Progress | None = None) -> Scan:
    """Read a whole file. Raises OSError when it can't be read; judges nothing beyond the file itself."""
    with open_regular(path) as file:
        return scan_stream(file, keys, progress)


def scan_stream(file: BinaryIO, keys: Mapping[str, PublicKey], progress: Progress | None = None) -> Scan:
    """As scan_file, for anything that reads bytes. `progress` gets the bytes read so far, now and then."""
    scan = Scan()
    tear: _Tear | None = None
    for number, line in enumerate(iter(partial(file.readline, MAX_LINE), b""), start=1):
        scan.size += len(line)
        if progress is not None and number % _PROGRESS_LINES == 0:
            progress(scan.size)
        if tear is None:
            fault = _take(scan, line, number, keys)
            if fault is None:
                continue
            tear = _Tear(fault, line)
            scan.fault_is_sealed = unseal(line) is not None
        if tear.is_explained_by(scan, line, number, keys):
            tear = None
        else:
            tear.add(line)
    if tear is not None:
        tear.report(scan, keys)
    return scan


def lines_that_hold(path: Path, scan: Scan) -> Iterator[bytes]:
    """The records that the scan of this file found; none in a torn tail, where a line can read like one.

    Raises OSError.
    """
    with open_regular(path) as file:
        lines = enumerate(iter(partial(file.readline, MAX_LINE), b""), start=1)
        yield from islice((line for number, line in lines if not in_tear(scan, number)), scan.records)


def in_tear(scan: Scan, number: int) -> bool:
    """Whether the line, counted from 1, is of a torn tail that a later signed record explains."""
    return any(number in tear for tear in scan.tears)


class _Tear:
    """The stretch behind the last good record, until a signed record explains it or the file ends."""

    def __init__(self, fault: Fault, line: bytes) -> None:
        self._fault = fault
        self._first = line
        self._hash = sha256()
        self._size = 0
        self._last = b""  # a tear's own last byte is the line end that was put behind it
        self._holds_whole_line = False

    def add(self, line: bytes) -> None:
        self._hash.update(self._last)
        self._hash.update(line[:-1])
        self._last = line[-1:]
        self._size += len(line)
        if is_whole(line):
            self._holds_whole_line = True

    def is_explained_by(self, scan: Scan, line: bytes, number: int, keys: Mapping[str, PublicKey]) -> bool:
        """Whether this line is the next record and its signed text describes exactly these bytes."""
        if self._last != b"\n" or (head := head_of(line)) is None:
            return False
        described = (head.body.torn_bytes, head.body.torn_sha256)
        if head.body.kind != "log-recovered" or described != (self._size - 1, self._hash.hexdigest()):
            return False
        if _take(scan, line, number, keys) is not None:
            return False
        scan.tears.append(range(self._fault.line, number))
        return True

    def report(self, scan: Scan, keys: Mapping[str, PublicKey]) -> None:
        if self._size == len(self._first):
            scan.unended_hash = _hash_when_ended(scan, self._first, keys)
        self._hash.update(self._last)
        scan.fault = self._fault
        scan.is_torn = not self._holds_whole_line
        scan.torn_bytes = self._size
        scan.torn_sha256 = self._hash.hexdigest()
        scan.closed = False


def _hash_when_ended(scan: Scan, line: bytes, keys: Mapping[str, PublicKey]) -> str:
    """The hash of a line that is the next record but for its line end; empty: it is none."""
    ended = replace(scan, signers=set(), unknown_keys=set())
    return ended.last_hash if _take(ended, line + b"\n", 0, keys) is None else ""


def head_of(line: bytes) -> Head | None:
    """The head of a line; None when it is no record."""
    try:
        return _decode(line)
    except UNDECODABLE:
        return None


def _take(scan: Scan, line: bytes, number: int, keys: Mapping[str, PublicKey]) -> Fault | None:
    """Count one good record, or return what is wrong with it."""
    parts = unseal(line)
    if parts is None:
        return Fault(line=number, sequence=None, reason=_shapeless(line))
    payload, claimed = parts
    if sha256(payload).hexdigest() != claimed:
        return Fault(line=number, sequence=None, reason=reason(Break.CHANGED))
    head = head_of(line)
    if head is None:
        return Fault(line=number, sequence=None, reason=reason(Break.NO_RECORD))
    wrong = _out_of_chain(scan, head) or _badly_signed(scan, head, payload, keys)
    if wrong is not None:
        return Fault(line=number, sequence=head.sequence, reason=wrong)
    _count(scan, head, claimed)
    return None


def _count(scan: Scan, head: Head, digest: str) -> None:
    scan.records += 1
    scan.last_hash = digest
    scan.session = head.session
    scan.closed = head.body.closing and head.body.kind == "checkpoint"
    if head.schema > SCHEMA:
        scan.newer_schema = max(scan.newer_schema, head.schema)


def _shapeless(line: bytes) -> Reason:
    if not line.endswith(b"\n"):
        too_long = len(line) >= MAX_LINE
        return reason(Break.TOO_LONG if too_long else Break.CUT_OFF, size_bytes=len(line))
    if len(line) <= SEAL_LENGTH:
        return reason(Break.TOO_SHORT)
    return reason(Break.NOT_SEALED)


def _out_of_chain(scan: Scan, head: Head) -> Reason | None:
    if head.sequence != scan.records:
        return reason(Break.OUT_OF_SEQUENCE, found=head.sequence, expected=scan.records)
    if head.previous != scan.last_hash:
        return reason(Break.NOT_LINKED)
    if scan.records and head.session != scan.session:
        return reason(Break.OTHER_SESSION)
    return None


def _badly_signed(scan: Scan, head: Head, payload: bytes, keys: Mapping[str, PublicKey]) -> Reason | None:
    if head.body.kind not in SIGNED_KINDS:
        return None
    scan.signers.add(head.body.key)
    key = keys.get(head.body.key)
    if key is None:
        scan.unknown_keys.add(head.body.key)
        return None
    if not key.verifies(head.body.signature, signed_message(payload)):
        return reason(Break.BAD_SIGNATURE, key=head.body.key[:8])
    scan.proven = scan.records + 1
    return None
