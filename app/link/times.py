"""Moments that cross the link, by the clock of who receives them. Raw clocks of two hosts are never compared.

One row a message: its fields that hold moments, and those that hold messages which do. A moment is shifted by the
most that the other clock may be ahead: it may look older than it is, by twice the uncertainty, and never younger.
"""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from app.ipc.messages import (
    ActionReport,
    ActiveEvent,
    AuditHealth,
    ControlSnapshot,
    GuardianHealth,
    OperatorCommand,
    PauseSummary,
    SessionStatus,
    TriggerReport,
)
from app.link.clock import ClockEstimate

M = TypeVar("M", bound=msgspec.Struct)

MOMENTS: dict[type[msgspec.Struct], tuple[str, ...]] = {
    TriggerReport: ("captured_ns", "sent_ns", "recognised_ns", "released_recognised_ns", "released_ns"),
    OperatorCommand: ("sent_ns",),
    ControlSnapshot: ("at_ns", "stop_received_ns", "stop_command_ns"),
    ActiveEvent: ("since_ns",),
    ActionReport: (
        "recognised_ns",
        "released_ns",
        "accepted_ns",
        "first_command_ns",
        "first_motion_ns",
        "ended_ns",
    ),
    PauseSummary: ("ended_ns",),
    AuditHealth: ("at_ns",),
    GuardianHealth: ("at_ns",),
    SessionStatus: ("at_ns",),
}
PARTS: dict[type[msgspec.Struct], tuple[str, ...]] = {ControlSnapshot: ("events", "reports", "pauses")}


def localized(message: M, clock: ClockEstimate) -> M:
    """The message with its moments by our clock."""
    kind = type(message)
    changes: dict[str, Any] = {name: clock.local_ns(getattr(message, name)) for name in MOMENTS[kind]}
    for name in PARTS.get(kind, ()):
        part = getattr(message, name)
        changes[name] = (
            tuple(localized(one, clock) for one in part) if isinstance(part, tuple) else localized(part, clock)
        )
    return replace(message, **changes)
