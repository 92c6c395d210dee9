"""Everything that can forbid or stop motion, as one table: event → effect, latched or not.

Adding a fault is adding a row. The strongest effect wins. An event that latches stays in force until the operator
acknowledges it, and an acknowledgement never restarts motion. Unless its row says ALWAYS, an event latches only
while the drives carry power: before that there is nothing that it would have stopped.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from app.control.diagnostics import Diagnostics
from app.control.events.drives import DRIVES, POSE
from app.control.events.programs import CLOCKS, HELPERS, STREAMS
from app.control.events.row import Compared, Latch, Row
from app.control.events.session import SESSION
from app.ipc.states import Effect, Event, Source
from app.ipc.streams import NS_PER_MS
from logs.reason import Reason, Value, key_of

LINGER_NS = 1_000_000_000  # a passing event stays to be read; it has no effect any more, unless it `settles`

# Among events of the same effect the earlier row is shown first and names the refusal.
TABLE = (*SESSION, *POSE, *STREAMS, *CLOCKS, *DRIVES, *HELPERS)
ROW = {row.event: row for row in TABLE}
ORDER = {row.event: place for place, row in enumerate(TABLE)}
_CONDITIONS = tuple((row, row.present) for row in TABLE)


class RaisedEvent(Struct, frozen=True, kw_only=True):
    """An event in force, or one that has just gone and is shown a little longer."""

    event: Event
    since_ns: int
    present_ns: int  # since when its condition has held without a gap
    last_ns: int  # when its condition held last
    latched: bool
    present: bool = True
    acknowledged: bool = False
    detail: dict[str, Value] = {}
    compared: Compared | None = None  # when it was raised
    total: float = 0.0  # of a row that counts, since then

    @property
    def reason(self) -> Reason:
        """The event with its values, to be rendered."""
        return Reason(key_of(self.event), self.detail)

    @property
    def in_force(self) -> bool:
        """Its condition holds, or held so lately that it may again, or it waits for its acknowledgement."""
        return self.present or ROW[self.event].settles or (self.latched and not self.acknowledged)


RaisedEvents = tuple[RaisedEvent, ...]


def advance(events: RaisedEvents, diagnostics: Diagnostics, acknowledged_ns: int = 0) -> RaisedEvents:
    """The events after a tick, strongest first.

    acknowledged_ns: when the operator acknowledged, 0 if not in this tick; it covers only what was raised before.
    """
    present = [row for row, condition in _CONDITIONS if condition(diagnostics)]
    if not present and not events:
        return events
    raised = {row.event for row in present}
    kept = [_updated(one, diagnostics, acknowledged_ns, present=one.event in raised) for one in events]
    known = {one.event for one in kept if one is not None}
    new = (_raised(row, diagnostics) for row in present if row.event not in known)
    return tuple(sorted((one for one in (*kept, *new) if one is not None), key=_place))


def effect_of(events: RaisedEvents) -> Effect:
    """What all events in force together do: the strongest wins."""
    return max([ROW[one.event].effect for one in events if one.in_force], default=Effect.NOTE)


def blocker(events: RaisedEvents, source: Source) -> RaisedEvent | None:
    """The strongest event in force that refuses this source's requests."""
    return next((one for one in events if one.in_force and blocks(ROW[one.event], source)), None)


def compared_fields(compared: Compared | None) -> dict[str, Any]:
    """What was compared, as the trail's records name it; numbers that are none are left out."""
    if compared is None:
        return {}
    return {
        "quantity": compared.quantity,
        "value": compared.value if isfinite(compared.value) else None,
        "limit": compared.limit if isfinite(compared.limit) else None,
        "joint": "" if compared.joint is None else compared.joint.name.lower(),
    }


def walk_ender(events: RaisedEvents, source: Source) -> RaisedEvent | None:
    """The strongest event that refuses this source the end of its walk, and has done so for too long."""
    return next((one for one in events if one.in_force and blocks(ROW[one.event], source) and _ends_walk(one)), None)


def acknowledges(acknowledged_ns: int, one: RaisedEvent) -> bool:
    """Whether an acknowledgement sent then counts for this event."""
    if ROW[one.event].acknowledged_when_gone and (one.present or acknowledged_ns <= one.last_ns):
        return False
    return one.latched and acknowledged_ns > one.since_ns


def displaced(events: RaisedEvents) -> bool:
    """Whether an event in force leaves the gait state unknown."""
    return any(one.in_force and ROW[one.event].displaces for one in events)


def blocks(row: Row, source: Source) -> bool:
    """Whether a row refuses requests of that source while it is in force."""
    return row.effect >= Effect.REFUSE and source in row.blocks


def _ends_walk(one: RaisedEvent) -> bool:
    limit_ms = ROW[one.event].walk_ends_after_ms
    return not limit_ms or one.last_ns - one.present_ns > limit_ms * NS_PER_MS


def _place(one: RaisedEvent) -> tuple[int, int]:
    return (-ROW[one.event].effect, ORDER[one.event])


def _latches(row: Row, diagnostics: Diagnostics) -> bool:
    return row.latch is Latch.ALWAYS or (row.latch is Latch.POWERED and diagnostics.powered)


def _counted(row: Row, diagnostics: Diagnostics) -> float:
    compared = row.compared(diagnostics) if row.counts else None
    return compared.value if compared is not None else 0.0


def _raised(row: Row, diagnostics: Diagnostics) -> RaisedEvent:
    return RaisedEvent(
        event=row.event,
        since_ns=diagnostics.now_ns,
        present_ns=diagnostics.now_ns,
        last_ns=diagnostics.now_ns,
        latched=_latches(row, diagnostics),
        detail=row.detail(diagnostics),
        compared=row.compared(diagnostics),
        total=_counted(row, diagnostics),
    )


def _updated(one: RaisedEvent, diagnostics: Diagnostics, acknowledged_ns: int, *, present: bool) -> RaisedEvent | None:
    """The event a tick later; None when it is over."""
    acknowledged = one.acknowledged or acknowledges(acknowledged_ns, one)
    if present and acknowledged and ROW[one.event].latch is Latch.ALWAYS:
        return _raised(ROW[one.event], diagnostics)  # again, in the acknowledgement's tick: it waits for another one
    if present:
        return replace(
            one,
            present=True,
            present_ns=one.present_ns if one.present else diagnostics.now_ns,
            last_ns=diagnostics.now_ns,
            latched=one.latched or _latches(ROW[one.event], diagnostics),
            acknowledged=acknowledged,
            total=one.total + _counted(ROW[one.event], diagnostics),
        )
    if one.latched:
        return None if acknowledged else replace(one, present=False)
    return replace(one, present=False) if diagnostics.now_ns - one.last_ns < LINGER_NS else None
