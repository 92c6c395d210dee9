"""When a key was pressed or the mouse clicked: an application that stood still gets input of seconds ago.

By then the screen shows something else than it did, or asks what nobody has read. Beside a session such input is
dropped; what is carried out goes to control with the moment of its key.
"""

from __future__ import annotations

from textual import events
from textual.message import Message

LATE_NS = 500_000_000  # as control refuses an older key (`ACT_STALE_MS`)
INPUT = (events.Key, events.MouseDown, events.MouseUp, events.Paste)
_NAME = "input_ns"


def stamp(message: Message, at_ns: int) -> None:
    """Note the time of this input (monotonic). Input without one is never too late."""
    if isinstance(message, INPUT):
        vars(message)[_NAME] = at_ns


def input_time_ns(message: Message) -> int | None:
    """The time of this input (monotonic, ns); None: it came from no terminal."""
    at_ns: int | None = vars(message).get(_NAME)
    return at_ns


def is_late(message: Message, now_ns: int) -> bool:
    """Whether it has waited for too long."""
    at_ns = input_time_ns(message)
    return at_ns is not None and now_ns - at_ns > LATE_NS
