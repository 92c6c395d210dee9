"""The gait machine: the paper's eight states and twelve transitions, and the state that a stop leads to.

Rules:
1. The table in `table.py` is the whole of it; the machine, its refusals and its diagram are made from it.
2. A movement begins in its row's `source`, passes `through` the state that the paper names for it (7, 8 and 9), and
   the legs are in `to` when it has been completed.
3. Walking is a chain of steps. Gesture 6 is latched while it runs and carried out when the running step has ended.
4. Every other request during a movement is ignored. A request that no row names is refused with its reason.
5. A stop in the middle of a movement leads to BETWEEN, and only gesture 0 leads out of there.

Values in, values out: `ControlState` owns the `Gait`, every function returns a new one. The library's machine is made
once from the table and has no model of its own: each trigger works on a copy of the gait that it was given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cache
from types import SimpleNamespace
from typing import Any

from msgspec import Struct
from msgspec.structs import asdict
from transitions import EventData, Machine, MachineError

from app.control.gait.table import TABLE, Row
from app.ipc.states import Action, GaitState, RequestRefusal
from app.motion.plan import Phase
from logs.reason import Reason, reason


class Gait(Struct, frozen=True, kw_only=True):
    """Where the legs are in the table; `running` is None while they rest."""

    state: GaitState = GaitState.UNPOWERED
    running: Action | None = None
    phase: Phase = Phase.WHOLE
    closing: bool = False  # gesture 6 is latched

    @property
    def walking(self) -> bool:
        """In the chain of steps that gesture 6 ends."""
        return self.running is Action.WALK


@dataclass(frozen=True, slots=True, kw_only=True)
class Started:
    """The request is granted: plan it and run it."""

    gait: Gait


@dataclass(frozen=True, slots=True, kw_only=True)
class Latched:
    """Gesture 6 is granted, and carried out when the running step has ended."""

    gait: Gait


@dataclass(frozen=True, slots=True, kw_only=True)
class Ignored:
    """A movement is running: the request is counted and dropped."""

    reason: Reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """No row allows it here; the reason is shown to the therapist."""

    reason: Reason


Answer = Started | Latched | Ignored | Refused


def ask(gait: Gait, action: Action) -> Answer:
    """The table's answer to a request in this gait."""
    after = _fire(gait, action.name)
    if after is not None:
        return Latched(gait=after) if action is Action.WALK_END else Started(gait=after)
    if gait.running is not None:
        return Ignored(reason=reason(RequestRefusal.ACTION_RUNNING, action=gait.running))
    return Refused(reason=_why_not(gait.state, action))


@cache
def allowed(gait: Gait) -> tuple[Action, ...]:
    """The actions that would be granted now, in the order of the gestures."""
    return tuple(action for action in Action if _fire(gait, action.name) is not None)


class Change(Enum):
    """What changes a gait, as the trail names it."""

    REQUESTED = "requested"  # an action was granted
    COMPLETED = "completed"
    ABANDONED = "abandoned"
    INTERRUPTED = "interrupted"
    POWER_LOST = "power-lost"
    WALK_CLOSED = "walk-closed"


_TRIGGERS = {
    Change.COMPLETED: "complete",  # in a walk the next step begins
    Change.ABANDONED: "abandon",  # cancelled before the first tick: the legs rest in the source state
    Change.INTERRUPTED: "interrupt",  # stopped in mid-movement, or not in the pose of the state
    Change.POWER_LOST: "power_off",
    Change.WALK_CLOSED: Action.WALK_END.name,  # with its running step, without a request
}


def changed(gait: Gait, change: Change, action: Action | None = None) -> Gait:
    """The gait after a change, itself where nothing runs that the change would end; action: the granted one.

    Raises ValueError for a request that no row grants, and for a completion at rest.
    """
    if change is Change.REQUESTED:
        after = None if action is None else _fire(gait, action.name)
        if after is None:
            raise ValueError(f"no row grants {action} in {gait}")
        return after
    after = _fire(gait, _TRIGGERS[change])
    if after is None and change is Change.COMPLETED:
        raise ValueError(f"nothing runs that could be completed: {gait}")
    return after or gait


def following_phases(gait: Gait) -> tuple[Phase, ...]:
    """In a walk, the steps that may follow the running one: the next step, and the one that ends the walk."""
    if not gait.walking:
        return ()
    lands = _row_of(gait).to
    return tuple(row.phase for row in TABLE if row.chained and row.source is lands)


def action_of(phase: Phase) -> Action:
    """The action that a step of a walk belongs to."""
    return next(row.action for row in TABLE if row.phase is phase)


def _why_not(state: GaitState, action: Action) -> Reason:
    if action is Action.WALK_END:
        return reason(RequestRefusal.NO_WALK)
    if state is GaitState.UNPOWERED:
        return reason(RequestRefusal.UNPOWERED)
    if state is GaitState.BETWEEN:
        return reason(RequestRefusal.BETWEEN_STATES)
    sources = [row.source for row in TABLE if row.action is action and not row.chained]
    return reason(RequestRefusal.WRONG_STATE, action=action, sources=sources, state=state)


def _row_of(gait: Gait) -> Row:
    """The row that is running."""
    return next(
        row
        for row in TABLE
        if (row.action, row.phase) == (gait.running, gait.phase) and gait.state in {row.source, row.through}
    )


# --- the library's machine, made from the table -------------------------------------------------------------------


def _where(**wanted: object) -> Callable[[EventData], bool]:
    """A condition on fields of the gait."""
    return lambda event: all(getattr(event.model, name) == value for name, value in wanted.items())


def _becomes(**changes: object) -> Callable[[EventData], None]:
    """A change of the gait; the state itself is the library's."""

    def change(event: EventData) -> None:
        for name, value in changes.items():
            setattr(event.model, name, value)

    return change


_REST: dict[str, Any] = {"running": None, "phase": Phase.WHOLE, "closing": False}


def _begin(row: Row) -> dict[str, Any]:
    return {
        "trigger": row.action.name,
        "source": row.source,
        "dest": row.through or row.source,
        "conditions": _where(running=None),
        "after": _becomes(running=row.action, phase=row.phase),
    }


def _end(row: Row) -> dict[str, Any]:
    return {
        "trigger": "complete",
        "source": row.through or row.source,
        "dest": row.to,
        "conditions": _where(running=row.action, phase=row.phase),
        "after": _becomes(**_REST),
    }


def _abandon(row: Row) -> dict[str, Any]:
    return _end(row) | {"trigger": "abandon", "dest": row.source}


def _chain(row: Row, following: Row) -> dict[str, Any]:
    """The running step of a walk has ended and `following` begins."""
    closing = following.action is Action.WALK_END
    return _end(row) | {
        "conditions": _where(running=row.action, phase=row.phase, closing=closing),
        "after": _becomes(running=following.action, phase=following.phase, closing=False),
    }


def _latch(row: Row) -> dict[str, Any]:
    return {
        "trigger": Action.WALK_END.name,
        "source": row.source,
        "dest": None,
        "conditions": _where(running=Action.WALK, phase=row.phase, closing=False),
        "after": _becomes(closing=True),
    }


def _machine_rows() -> list[dict[str, Any]]:
    walk = [row for row in TABLE if row.action is Action.WALK]
    chained = [row for row in TABLE if row.chained]
    return [
        *(_begin(row) for row in TABLE if not row.chained),
        *(_latch(row) for row in walk),
        *(_chain(row, following) for row in walk for following in chained if following.source is row.to),
        *(_end(row) for row in TABLE if row.action is not Action.WALK),
        *(_abandon(row) for row in TABLE),
        {"trigger": "interrupt", "source": "*", "dest": GaitState.BETWEEN, "after": _becomes(**_REST)},
        {"trigger": "power_off", "source": "*", "dest": GaitState.UNPOWERED, "after": _becomes(**_REST)},
    ]


_MACHINE = Machine(
    model=None,
    states=GaitState,
    initial=GaitState.UNPOWERED,
    transitions=_machine_rows(),
    auto_transitions=False,
    send_event=True,
    queued=False,
)


def _fire(gait: Gait, trigger: str) -> Gait | None:
    """The gait after the trigger, or None where no row answers to it."""
    model = SimpleNamespace(**asdict(gait))
    try:
        fired = _MACHINE.events[trigger].trigger(model)
    except MachineError:
        return None
    return Gait(**vars(model)) if fired else None
