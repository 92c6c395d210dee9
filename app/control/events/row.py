"""What a row of the table of events consists of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto

from app.control.diagnostics import Diagnostics
from app.ipc.states import Effect, Event, Source
from logs.reason import Value


class Latch(Enum):
    """Whether an event stays when its condition has gone."""

    NEVER = auto()
    POWERED = auto()
    ALWAYS = auto()


BOTH = frozenset(Source)
GESTURES = frozenset({Source.GESTURE})


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
    settles: bool = False  # keeps its effect while it lingers: its condition may come back at any moment
