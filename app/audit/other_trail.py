"""The other computer's newest record, as this one's trail names it: so that neither can be rewritten alone."""

from __future__ import annotations

from msgspec import structs

from app.ipc.messages import AuditHealth
from logs.records import OtherTrail

PERIOD_NS = 1_000_000_000  # between two of these records: as much can be rewritten at the end unseen


def other_trail(peer: AuditHealth, offset_ns: int, uncertainty_ns: int) -> OtherTrail | None:
    """The record to write, every PERIOD_NS; None while nothing of the other trail is on its medium.

    peer: the health that the other computer's audit process sent. offset_ns: its monotonic clock minus ours, now.
    """
    if peer.newest is None:
        return None
    return OtherTrail(**structs.asdict(peer.newest), offset_ns=offset_ns, uncertainty_ns=uncertainty_ns)
