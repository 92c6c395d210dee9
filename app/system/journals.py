"""A home's journals, of operators and of changes: what happens outside sessions is recorded there, signed.

What brings cryptography is imported when something is recorded, not before the first paint.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from msgspec.structs import replace

from app.system.paths import Home
from logs.errors import AuditError, AuditFault
from logs.reason import Reason, key_of
from logs.records import Body, Change, Entry


def append_to_journal(home: Home, body: Body, operator: str = "") -> None:
    """Record it for good, or raise AuditError: who may not be recorded may not be let in."""
    from logs.journal import CHANGES, OPERATORS, Moment, append_signed
    from logs.keys import load_or_make_key

    moment = Moment(wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns(), operator=operator)
    path = home.logs / (CHANGES if isinstance(body, Change) else OPERATORS)
    append_signed(path, path.stem, [body], load_or_make_key(home.keys), moment)


def append_waiting(home: Home, waiting: Sequence[Entry]) -> None:
    """What waited in the console, each record of its own moment, in one piece with one signature.

    Each signature costs a reading of the journal. Raises AuditError.
    """
    from logs.journal import OPERATORS, Moment, append_signed
    from logs.keys import load_or_make_key

    path = home.logs / OPERATORS
    now = Moment(wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns(), operator=waiting[-1].operator)
    entries = [replace(entry, process="audit") for entry in waiting]
    append_signed(path, path.stem, entries, load_or_make_key(home.keys), now)


def are_recorded(error: AuditError) -> bool:
    """Whether the records that an append refused are on the disk: the journal's anchor alone was not written."""
    from logs.trail import DiskFault

    cause = error.values.get("cause")
    unanchored = isinstance(cause, Reason) and cause.code == key_of(DiskFault.ANCHOR_NOT_WRITTEN)
    return error.code is AuditFault.JOURNAL_NOT_WRITTEN and unanchored
