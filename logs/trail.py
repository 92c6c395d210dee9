"""A file of chained records that only grows: structlog turns an entry into its line, `settle` makes it durable.

Nothing counts as written before the disk has confirmed it. A write or fsync that fails leaves the bytes waiting;
the next `settle` writes the very same bytes at the very same place, which also covers an fsync that failed after
the kernel had dropped the pages.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto
from pathlib import Path
from typing import Any

import msgspec
import structlog
from structlog.typing import EventDict, Processor

from logs.disk import Disk
from logs.keys import ConsoleKey
from logs.line import GENESIS, MAX_LINE, SIGNED_KINDS, canonical, seal, signed_message, wall_text
from logs.reason import Reason, reason
from logs.records import SCHEMA, Entry, Loss, Payload, RecordsLost

# A minute of the heaviest traffic; beyond it the reader stops and the senders' queues fill.
MAX_WAITING_BYTES = 64 << 20


class DiskFault(Enum):
    """Why the trail is not on the disk."""

    NOT_WRITTEN = auto()  # path, detail, waiting
    NOT_ANSWERING = auto()  # silent_s
    ANCHOR_NOT_WRITTEN = auto()  # folder, detail


class Chain:
    """The end of the pipeline: gives a record its place in the chain, signs and seals it as the bytes of one line."""

    def __init__(self, key: ConsoleKey, sequence: int = 0, previous: str = GENESIS) -> None:
        self.sequence = sequence  # of the next record
        self.previous = previous  # hash of the newest record
        self.first = ""  # hash of the first record, once this chain has written it
        self._key = key

    def link(self, _logger: object, _method: str, event: EventDict) -> EventDict:
        """Processor: the place in the chain."""
        event["sequence"], event["previous"] = self.sequence, self.previous
        return event

    def sign(self, _logger: object, _method: str, event: EventDict) -> EventDict:
        """Processor: the console's signature in the body of the kinds that carry one."""
        body: Any = event["body"]
        if type(body).__struct_config__.tag in SIGNED_KINDS:
            message = signed_message(canonical(Payload(**event)))
            event["body"] = msgspec.structs.replace(body, signature=self._key.sign(message))
        return event

    def seal(self, _logger: object, _method: str, event: EventDict) -> tuple[tuple[bytes], dict[str, Any]]:
        """Last processor: the line with its hash, as the one argument of the file's method."""
        payload = canonical(Payload(**event))
        if len(payload) > MAX_LINE - 100:
            kind = type(event["body"]).__name__
            lost = RecordsLost(count=1, reason=reason(Loss.TOO_LONG, kind=kind, size_bytes=len(payload)))
            payload = canonical(Payload(**{**event, "body": lost}))
        line, self.previous = seal(payload)
        self.first = self.first or self.previous
        self.sequence += 1
        return (line,), {}


def stamp(_logger: object, _method: str, event: EventDict) -> EventDict:
    """Processor: the wall clock as the trail writes it."""
    event["wall"] = wall_text(event.pop("wall_ns"))
    return event


class TrailLogger(structlog.BoundLoggerBase):
    """structlog's bound logger of a trail; the session is bound, each entry brings its process and operator."""

    def record(self, entry: Entry) -> None:
        """Chain an entry and queue its line."""
        self._proxy_to_logger("append", None, **msgspec.structs.asdict(entry))


class Trail:
    """The file behind the chain: queues lines, and settles them on the disk."""

    def __init__(self, path: Path, disk: Disk, *, exists: bool = False, offset: int = 0) -> None:
        self.path = path
        self.fault: Reason | None = None  # while the disk refuses
        self.settled_records = 0  # on the medium, of those queued here
        self.waiting_records = 0  # queued and not yet on the medium
        self.newest_line = b""
        self._disk = disk
        self._exists = exists
        self._handle: int | None = None
        self._offset = offset  # everything before is on the medium
        self._waiting = bytearray()

    def append(self, line: bytes) -> None:
        """Queue one line; `settle` makes it durable."""
        self.newest_line = line
        self._waiting += line
        self.waiting_records += 1

    def prepend_line_end(self) -> None:
        """Begin with an empty line, so that what follows a torn tail stands on a line of its own."""
        self._waiting += b"\n"

    @property
    def is_full(self) -> bool:
        """Whether no more should be queued until something settles."""
        return len(self._waiting) > MAX_WAITING_BYTES

    def create(self) -> bool:
        """Create the file durably, still empty; False, with `fault`, when the disk refuses."""
        return self._try(self._open)

    def settle(self) -> bool:
        """Bring everything queued to the medium; False, with `fault`, when the disk refuses."""
        return self._try(self._settle)

    def _try(self, operation: Callable[[], object]) -> bool:
        try:
            operation()
        except OSError as error:
            detail = error.strerror or str(error)
            self.fault = reason(DiskFault.NOT_WRITTEN, path=self.path, detail=detail, waiting=self.waiting_records)
            return False
        self.fault = None
        return True

    def close(self) -> None:
        """Release the file; what has not settled is lost, so settle first."""
        if self._handle is not None:
            self._disk.close(self._handle)
            self._handle = None

    def _settle(self) -> None:
        handle = self._open()
        if not self._waiting:
            return
        data, done = bytes(self._waiting), 0
        while done < len(data):
            done += self._disk.write(handle, data[done:], self._offset + done)
        self._disk.sync(handle)
        self._offset += len(data)
        self._waiting.clear()
        self.settled_records += self.waiting_records
        self.waiting_records = 0

    def _open(self) -> int:
        if self._handle is None:
            if self._exists:
                self._handle = self._disk.open_existing(self.path)
            else:
                self._handle = self._disk.create(self.path)
        if not self._exists:
            self._disk.sync_folder(self.path.parent)
            self._exists = True
        self._disk.check_linked(self._handle)
        return self._handle


def open_logger(trail: Trail, chain: Chain, session: str) -> TrailLogger:
    """A structlog logger whose pipeline ends in the hash chain and the trail's file."""
    pipeline: list[Processor] = [stamp, chain.link, chain.sign, chain.seal]
    logger: TrailLogger = structlog.wrap_logger(
        trail, processors=pipeline, wrapper_class=TrailLogger, session=session, schema=SCHEMA
    ).bind()
    return logger
