"""The operators' journal as the console writes it: what waited, each record of its own moment, signed together."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from app.system.paths import Home
from logs.errors import AuditError, AuditFault
from logs.journal import OPERATORS, Moment, append_signed
from logs.keys import load_or_make_key
from logs.reason import Reason, key_of
from logs.records import Body, Entry
from logs.trail import DiskFault


@dataclass(frozen=True, slots=True, kw_only=True)
class _OwnMoments(Moment):
    """The moment of appending, for what the journal adds; what waited keeps its own."""

    waiting: tuple[Entry, ...]

    def entry(self, body: Body) -> Entry:
        found = next((entry for entry in self.waiting if entry.body is body), None)
        return Moment.entry(self, body) if found is None else replace(found, process="audit")


def append_waiting(home: Home, waiting: Sequence[Entry]) -> None:
    """Record them for good, in one piece with one signature: each costs a reading of the journal. Raises AuditError."""
    path = home.logs / OPERATORS
    now = _OwnMoments(
        wall_ns=time.time_ns(),
        monotonic_ns=time.monotonic_ns(),
        operator=waiting[-1].operator,
        waiting=tuple(waiting),
    )
    append_signed(path, path.stem, [entry.body for entry in waiting], load_or_make_key(home.keys), now)


def are_recorded(error: AuditError) -> bool:
    """Whether the records that an append refused are on the disk: the journal's anchor alone was not written."""
    cause = error.values.get("cause")
    unanchored = isinstance(cause, Reason) and cause.code == key_of(DiskFault.ANCHOR_NOT_WRITTEN)
    return error.code is AuditFault.JOURNAL_NOT_WRITTEN and unanchored
