"""The operators' journal as the console writes it: what waited, each record of its own moment, signed together."""

from __future__ import annotations

import time
from collections.abc import Sequence

from msgspec.structs import replace

from app.system.paths import Home
from logs.errors import AuditError, AuditFault
from logs.journal import OPERATORS, Moment, append_signed
from logs.keys import load_or_make_key
from logs.reason import Reason, key_of
from logs.records import Entry
from logs.trail import DiskFault


def append_waiting(home: Home, waiting: Sequence[Entry]) -> None:
    """Record them for good, in one piece with one signature: each costs a reading of the journal. Raises AuditError."""
    path = home.logs / OPERATORS
    now = Moment(wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns(), operator=waiting[-1].operator)
    entries = [replace(entry, process="audit") for entry in waiting]
    append_signed(path, path.stem, entries, load_or_make_key(home.keys), now)


def are_recorded(error: AuditError) -> bool:
    """Whether the records that an append refused are on the disk: the journal's anchor alone was not written."""
    cause = error.values.get("cause")
    unanchored = isinstance(cause, Reason) and cause.code == key_of(DiskFault.ANCHOR_NOT_WRITTEN)
    return error.code is AuditFault.JOURNAL_NOT_WRITTEN and unanchored
