"""What a row of the table of events consists of, and the names of all rows."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One event: what makes it present, what it does. Its wording is in the catalogues (`Event.NAME`)."""

    event: Event
    effect: Effect
    present: Callable[[Diagnostics], bool]
    latch: Latch = Latch.NEVER
    blocks: frozenset[Source] = BOTH  # whose wishes it refuses, from `refuse` upwards
    detail: Callable[[Diagnostics], dict[str, Value]] = lambda _: {}  # values at the moment when it is raised
    displaces: bool = False  # afterwards nobody knows the gait state: it becomes BETWEEN
    settles: bool = False  # keeps its effect while it lingers: its condition may come back at any moment
