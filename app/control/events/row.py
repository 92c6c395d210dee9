"""What a row of the table of events consists of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto

from app.control.diagnostics import Diagnostics
from app.ipc.states import Effect, Event, Source
from hal.joints.protocol import Joint
from logs.reason import Value


class Latch(Enum):
    """Whether an event stays when its condition has gone."""

    NEVER = auto()
    POWERED = auto()
    ALWAYS = auto()


BOTH = frozenset(Source)
GESTURES = frozenset({Source.GESTURE})


@dataclass(frozen=True, slots=True)
class Compared:
    """A quantity, its unit in its name, and the limit it is compared with."""

    quantity: str
    value: float
    limit: float
    joint: Joint | None = None


@dataclass(frozen=True, slots=True)
class Above:
    """The condition that a quantity is above its limit."""

    quantity: str
    value: Callable[[Diagnostics], float]
    limit: float

    def __call__(self, diagnostics: Diagnostics) -> bool:
        return self.value(diagnostics) > self.limit

    def compared(self, diagnostics: Diagnostics) -> Compared:
        """As of this tick."""
        return Compared(self.quantity, self.value(diagnostics), self.limit)


@dataclass(frozen=True, slots=True)
class Row:
    """One event: what makes it present and what it does. Its wording is in the catalogues (`Event.NAME`)."""

    event: Event
    effect: Effect
    present: Callable[[Diagnostics], bool]
    latch: Latch = Latch.NEVER
    detail: Callable[[Diagnostics], dict[str, Value]] = lambda _: {}  # values of its message, taken when it is raised
    blocks: frozenset[Source] = BOTH  # whose requests it refuses, from `refuse` upwards
    displaces: bool = False  # afterwards the gait state is unknown: it becomes BETWEEN
    compares: Callable[[Diagnostics], Compared | None] | None = None  # None: `present` tells, if it is a limit
    walk_ends_after_ms: float = 0.0  # present for longer than this, it ends a walk whose end it would refuse
    counts: bool = False  # what is compared happened so often: added up until the event is cleared
    acknowledged_when_gone: bool = False  # not while its condition holds
    settles: bool = False  # keeps its effect while it lingers: its condition may come back at any moment

    def compared(self, diagnostics: Diagnostics) -> Compared | None:
        """What the row compares, where that is a number."""
        if self.compares is not None:
            return self.compares(diagnostics)
        return self.present.compared(diagnostics) if isinstance(self.present, Above) else None
