"""Every process's end of the audit queue: queue a record, never wait, never lose one unreported.

Among the records: the other computer's newest one, so that neither trail can be rewritten alone.
"""

from __future__ import annotations

import time

from msgspec import structs

from app.ipc.links import OrderedSender, address
from app.ipc.messages import AuditHealth
from app.ipc.streams import AUDIT, LinkDirectory
from logs.reason import Reason, reason
from logs.records import Body, Entry, Loss, OtherTrail, RecordsLost

PERIOD_NS = 1_000_000_000  # between two records of the other trail: as much can be rewritten at the end unseen


class AuditSink:
    """Sends records to the audit process in order. Each process makes its own."""

    def __init__(self, links: LinkDirectory, process: str, operator: str = "") -> None:
        self.operator = operator
        self.lost = 0  # refused by a full queue and not yet recorded
        self._process = process
        self._sender = OrderedSender(address(links, AUDIT.name))

    def emit(self, body: Body) -> bool:
        """Queue one record with both clocks of now; False when the queue is full and it could not be taken."""
        return self.forward(entry_now(self._process, self.operator, body))

    def forward(self, entry: Entry) -> bool:
        """As `emit`, with the clocks and the operator of the moment at which it was made."""
        if self.lost and self._send(self._loss(self.lost, reason(Loss.QUEUE_FULL))):
            self.lost = 0
        if self._send(entry):
            return True
        self.lost += 1
        return False

    def close(self, linger_s: float = 1.0) -> None:
        """Let what is queued leave, for up to `linger_s`, and release the socket."""
        self._sender.close(linger_s)

    def _send(self, entry: Entry) -> bool:
        try:
            return self._sender.send(entry)
        except (UnicodeEncodeError, OverflowError) as error:  # half a surrogate pair, an integer beyond 64 bits
            why = reason(Loss.NOT_ENCODABLE, kind=type(entry.body).__name__, detail=repr(error))
            return self._sender.send(self._loss(1, why))

    def _loss(self, count: int, why: Reason) -> Entry:
        return entry_now(self._process, self.operator, RecordsLost(count=count, reason=why))


def entry_now(process: str, operator: str, body: Body) -> Entry:
    """A record of this moment, by both clocks."""
    return Entry(
        process=process, operator=operator, wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns(), body=body
    )


def other_trail(peer: AuditHealth, offset_ns: int, uncertainty_ns: int) -> OtherTrail | None:
    """The record to write, every PERIOD_NS; None while nothing of the other trail is on its medium.

    peer: the health that the other computer's audit process sent. offset_ns: its monotonic clock minus ours, now.
    """
    if peer.newest is None:
        return None
    return OtherTrail(**structs.asdict(peer.newest), offset_ns=offset_ns, uncertainty_ns=uncertainty_ns)
