"""Records on a session's own clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from logs.records import Body, Record

B = TypeVar("B", bound=Body)


class Timed:
    """Records with their seconds from the first."""

    def __init__(self, found: Sequence[Record]) -> None:
        self._began = min((record.monotonic_ns for record in found), default=0)
        self.records = found

    def at_s(self, record: Record) -> float:
        """Seconds from the session's beginning."""
        return (record.monotonic_ns - self._began) / 1e9

    def of(self, kind: type[B]) -> list[tuple[float, B]]:
        """(seconds, body) of one kind."""
        return [(self.at_s(record), record.body) for record in self.records if isinstance(record.body, kind)]
