"""A whole session again, from its trail alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from app.replay.control import ControlReplay
from app.replay.difference import Difference
from app.replay.perception import PerceptionReplay
from logs.records import Record


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """How many decisions were made again, how many the trail holds no inputs of, and where they differ."""

    replayed: int
    not_recorded: int
    differences: tuple[Difference, ...]

    def to_values(self) -> dict[str, Any]:
        """For JSON: values as recorded."""
        differing = [
            {
                "sequence": one.sequence,
                "kind": one.kind,
                "field": one.field,
                "recorded": one.recorded,
                "replayed": one.replayed,
            }
            for one in self.differences
        ]
        return {"replayed": self.replayed, "not_recorded": self.not_recorded, "differences": differing}


def replay(found: Iterable[Record]) -> Replayed:
    """Every decision of perception and control again; differences in the order of their records."""
    parts = (PerceptionReplay(), ControlReplay())
    differing = [one for record in found for part in parts for one in part.take(record)]
    differing += [one for part in parts for one in part.end()]
    return Replayed(
        replayed=sum(part.replayed for part in parts),
        not_recorded=sum(part.not_recorded for part in parts),
        differences=tuple(sorted(differing, key=lambda one: one.sequence)),
    )
