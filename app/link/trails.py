"""The other host's newest signed record, as this host's trail keeps it: so that neither can be rewritten alone."""

from __future__ import annotations

from collections.abc import Iterator

from app.ipc.messages import AuditHealth
from app.link.clock import ClockEstimate
from logs.records import Body


def other_trail(audit: AuditHealth | None, clock: ClockEstimate, name: str) -> Iterator[Body]:
    """The record of it, about once a second. audit: as it came; its fields of the newest record are still missing."""
    del audit, clock, name
    yield from ()
