"""When the operator gave what the application gets now: one that stood still gets keys and clicks of seconds ago.

By then the screen shows something else than it did, or asks what nobody has read. Beside a session such input is
dropped; what is carried out goes to control with the moment of its key.
"""

from __future__ import annotations

from textual import events
from textual.message import Message

LATE_NS = 500_000_000  # as control refuses an older key (`ACT_STALE_MS`)
INPUT = (events.Key, events.MouseDown, events.MouseUp, events.Paste)
_NAME = "given_ns"


def date(message: Message, at_ns: int) -> None:
    """Note that a terminal gave this input then at the latest (monotonic). What nobody dates is never too late."""
    if isinstance(message, INPUT):
        vars(message)[_NAME] = at_ns


def date_of(message: Message) -> int | None:
    """When a terminal gave it at the latest (monotonic, ns); None: no terminal did."""
    at_ns: int | None = vars(message).get(_NAME)
    return at_ns


def is_late(message: Message, now_ns: int) -> bool:
    """Whether it has waited for too long."""
    at_ns = date_of(message)
    return at_ns is not None and now_ns - at_ns > LATE_NS
