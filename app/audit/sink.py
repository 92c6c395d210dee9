"""The way into the audit trail for every process: queue a record, never wait, never lose one unsaid."""

from __future__ import annotations

import time
from pathlib import Path

from app.ipc.links import OrderedSender, address
from app.ipc.streams import AUDIT
from logs.records import Body, Entry, RecordsLost


class AuditSink:
    """Sends records to the audit process in order. Each process makes its own."""

    def __init__(self, links: Path, process: str, operator: str = "") -> None:
        self.operator = operator
        self.lost = 0  # refused by a full queue and not yet told to the trail
        self._process = process
        self._sender = OrderedSender(address(links, AUDIT.name))

    def emit(self, body: Body) -> bool:
        """Queue one record with both clocks of now; False when the queue is full and it could not be taken."""
        if self.lost and self._send(RecordsLost(count=self.lost, reason="the audit queue was full")):
            self.lost = 0
        if self._send(body):
            return True
        self.lost += 1
        return False

    def close(self, linger_s: float = 1.0) -> None:
        """Let what is queued leave, for up to `linger_s`, and release the socket."""
        self._sender.close(linger_s)

    def _send(self, body: Body) -> bool:
        try:
            return self._sender.send(self._entry(body))
        except (UnicodeEncodeError, OverflowError) as error:  # half a surrogate pair, an integer beyond 64 bits
            said = RecordsLost(count=1, reason=f"{type(body).__name__} can't be written: {error}")
            return self._sender.send(self._entry(said))

    def _entry(self, body: Body) -> Entry:
        return Entry(
            process=self._process,
            operator=self.operator,
            wall_ns=time.time_ns(),
            monotonic_ns=time.monotonic_ns(),
            body=body,
        )
