"""A file of chained records that only grows: structlog turns an entry into its line, `settle` makes it last.

Nothing is taken for written before the disk has confirmed it. A write or fsync that fails leaves the bytes waiting;
the next `settle` writes the very same bytes at the very same place, which also covers an fsync that failed after
the kernel had dropped the pages.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import structlog
from structlog.typing import EventDict

from logs.disk import Disk
from logs.keys import ConsoleKey
from logs.line import GENESIS, MAX_LINE, SIGNED_KINDS, Payload, canonical, seal, signed_message, wall_text
from logs.records import SCHEMA, Entry, RecordsLost

# A minute of the heaviest traffic; beyond it the reader stops reading and the senders' queues tell them.
MAX_WAITING_BYTES = 64 << 20


class Chain:
    """structlog's processor: gives an entry its place in the chain and ends it as the bytes of one line."""

    def __init__(self, session: str, key: ConsoleKey, sequence: int = 0, previous: str = GENESIS) -> None:
        self.sequence = sequence  # of the next record
        self.previous = previous  # hash of the newest record
        self._session = session
        self._key = key

    def __call__(self, _logger: object, _method: str, event: EventDict) -> tuple[tuple[bytes], dict[str, Any]]:
        """The line, as the one argument of the logger's method."""
        payload = self._signed(self._place(event["entry"]))
        if len(payload) > MAX_LINE - 100:
            payload = canonical(self._place(_too_long(event["entry"], len(payload))))
        line, self.previous = seal(payload)
        self.sequence += 1
        return (line,), {}

    def _place(self, entry: Entry) -> Payload:
        return Payload(
            body=entry.body,
            monotonic_ns=entry.monotonic_ns,
            operator=entry.operator,
            previous=self.previous,
            process=entry.process,
            schema=SCHEMA,
            sequence=self.sequence,
            session=self._session,
            wall=wall_text(entry.wall_ns),
        )

    def _signed(self, payload: Payload) -> bytes:
        plain = canonical(payload)
        body: Any = payload.body
        if type(body).__struct_config__.tag not in SIGNED_KINDS:
            return plain
        signature = self._key.sign(signed_message(plain))
        return canonical(msgspec.structs.replace(payload, body=msgspec.structs.replace(body, signature=signature)))


class TrailLogger(structlog.BoundLoggerBase):
    """structlog's front door to a trail."""

    def record(self, entry: Entry) -> None:
        """Chain an entry and queue its line."""
        self._proxy_to_logger("append", None, entry=entry)


class Trail:
    """The file behind the chain: queues lines, and settles them on the disk."""

    def __init__(self, path: Path, disk: Disk, *, exists: bool = False, offset: int = 0) -> None:
        self.path = path
        self.fault = ""  # one sentence while the disk refuses
        self.settled_records = 0  # on the medium, of those queued here
        self.newest_line = b""
        self._disk = disk
        self._exists = exists
        self._handle: int | None = None
        self._offset = offset  # everything before is on the medium
        self._waiting = bytearray()
        self._waiting_records = 0

    def append(self, line: bytes) -> None:
        """Queue one line; `settle` makes it last."""
        self.newest_line = line
        self._waiting += line
        self._waiting_records += 1

    def prepend_line_end(self) -> None:
        """Begin with an empty line, so that what follows a torn tail stands on a line of its own."""
        self._waiting += b"\n"

    @property
    def waiting_records(self) -> int:
        """Queued and not yet on the medium."""
        return self._waiting_records

    @property
    def is_full(self) -> bool:
        """Whether no more should be queued until something settles."""
        return len(self._waiting) > MAX_WAITING_BYTES

    def create(self) -> bool:
        """Have the file there, lasting, though still empty; False, with `fault` saying why, when the disk refuses."""
        return self._try(self._open)

    def settle(self) -> bool:
        """Bring everything queued to the medium; False, with `fault` saying why, when the disk refuses."""
        return self._try(self._settle)

    def _try(self, operation: Callable[[], object]) -> bool:
        try:
            operation()
        except OSError as error:
            self.fault = (
                f"The audit trail {self.path} can't be written: {error.strerror or error}; "
                f"{self._waiting_records} records wait. Free space or mend the disk."
            )
            return False
        self.fault = ""
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
        self.settled_records += self._waiting_records
        self._waiting_records = 0

    def _open(self) -> int:
        if self._handle is None:
            if self._exists:
                self._handle = self._disk.open_existing(self.path)
            else:
                self._handle = self._disk.create(self.path)
        if not self._exists:
            self._disk.sync_folder(self.path.parent)
            self._exists = True
        return self._handle


def open_logger(trail: Trail, chain: Chain) -> TrailLogger:
    """A structlog logger whose records end in the trail."""
    logger: TrailLogger = structlog.wrap_logger(trail, processors=[chain], wrapper_class=TrailLogger).bind()
    return logger


def _too_long(entry: Entry, length: int) -> Entry:
    lost = RecordsLost(count=1, reason=f"a {type(entry.body).__name__} of {length} bytes was too long")
    return msgspec.structs.replace(entry, body=lost)
