"""A whole session again, from its trail alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

from app.replay.control import ControlReplay
from app.replay.difference import Difference, difference
from app.replay.perception import PerceptionReplay
from app.system.program import PROGRAM, RULES, VERSION, program_identity
from logs.records import Record, SessionStart
from logs.show import kind_of


class Writer(Enum):
    """Who wrote the trail, beside the program that replays it."""

    SAME = "same"
    SAME_RULES = "same-rules"  # another version of the program
    OTHER_RULES = "other-rules"  # what differs may differ for that
    NOT_RECORDED = "not-recorded"  # which rules it had


NOT_COVERED = (  # the trail does not hold their inputs
    "classification-of-images",
    "hand-that-commands",
    "paths-of-plans",
    "joint-commands",
    "events-without-a-number",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """How many decisions were made again, how many the trail holds no inputs of, and where they differ."""

    replayed: int
    not_recorded: int
    differences: tuple[Difference, ...]
    recorded: dict[str, str]  # version and hashes that the trail names; now: those of this program
    now: dict[str, str]

    @property
    def writer(self) -> Writer:
        """Whose decisions they were."""
        if RULES not in self.recorded:
            return Writer.NOT_RECORDED
        if self.recorded[RULES] != self.now[RULES]:
            return Writer.OTHER_RULES
        return Writer.SAME if self.recorded == self.now else Writer.SAME_RULES

    def to_values(self) -> dict[str, Any]:
        """For JSON: values as recorded."""
        return {
            "replayed": self.replayed,
            "not_recorded": self.not_recorded,
            "differences": [asdict(one) for one in self.differences],
            "writer": {"is": self.writer.value, "recorded": self.recorded, "now": self.now},
            "not_covered": NOT_COVERED,
        }


def replay(found: Iterable[Record]) -> Replayed:
    """Every decision of perception and control again; differences in the order of their records."""
    parts = (PerceptionReplay(), ControlReplay())
    versions: dict[str, str] = {}
    differing: list[Difference] = []
    for record in found:
        if isinstance(record.body, SessionStart):
            versions = record.body.versions
        differing += [one for part in parts for one in _taken(part, record)]
    differing += [one for part in parts for one in part.end()]
    return Replayed(
        replayed=sum(part.replayed for part in parts),
        not_recorded=sum(part.not_recorded for part in parts),
        differences=tuple(sorted(differing, key=lambda one: one.sequence)),
        recorded={name: versions[name] for name in (VERSION, PROGRAM, RULES) if name in versions},
        now=program_identity(),
    )


def _taken(part: PerceptionReplay | ControlReplay, record: Record) -> Iterator[Difference]:
    try:
        yield from part.take(record)
    except (ValueError, KeyError):  # a state, event or gesture that this program does not have
        yield difference(record, "name", kind_of(record.body), None)
