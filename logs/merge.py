"""Two trails on one time axis: the first trail's clock, by the offsets that both recorded, with what is uncertain.

Each mention bounds the offset of the clocks at its moment; the nearest on either side of a record, widened by what two
clocks drift meanwhile, bound it there (as `app.link.clock` does it, after NTP: RFC 5905, §8).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.text import Text

from logs.errors import AuditError, AuditFault
from logs.join import first_contradiction
from logs.mentions import TrailIndex, index_trail
from logs.read import read
from logs.reading.errors import cause_of
from logs.reason import Render
from logs.records import Record
from logs.records.session import DRIFT_PPM
from logs.scan import scan_file
from logs.show import line_of


@dataclass(frozen=True, slots=True)
class Bound:
    """The second clock minus the first, between `low_ns` and `high_ns`, when the second clock said `at_ns`."""

    at_ns: int
    low_ns: int
    high_ns: int

    def widened(self, at_ns: int) -> Bound:
        """The same knowledge at another moment."""
        apart_ns = abs(at_ns - self.at_ns) + self.high_ns - self.low_ns  # `at_ns` itself is as uncertain
        drift_ns = -(-apart_ns * DRIFT_PPM // (1_000_000 - DRIFT_PPM))  # of the slower clock's seconds
        return Bound(at_ns, self.low_ns - drift_ns, self.high_ns + drift_ns)


@dataclass(frozen=True, slots=True)
class Placed:
    """A moment on the first trail's clock; the truth is so far away from it at most."""

    at_ns: int
    uncertainty_ns: int = 0


@dataclass(frozen=True, slots=True)
class Merged:
    """One record of the timeline. trail: 0 the first, 1 the second."""

    placed: Placed
    trail: int
    record: Record


def bounds_of(first: TrailIndex, second: TrailIndex) -> list[Bound]:
    """What both trails recorded of the clocks, by the second one's time."""
    found = [
        Bound(one.monotonic_ns + one.of.offset_ns, *_around(one.of.offset_ns, one.of.uncertainty_ns))
        for one in first.mentions
        if one.of.first_hash == second.first_hash
    ]
    found += [
        Bound(one.monotonic_ns, *_around(-one.of.offset_ns, one.of.uncertainty_ns))
        for one in second.mentions
        if one.of.first_hash == first.first_hash
    ]
    return sorted(found, key=lambda bound: bound.at_ns)


def _around(offset_ns: int, uncertainty_ns: int) -> tuple[int, int]:
    return offset_ns - uncertainty_ns, offset_ns + uncertainty_ns


def place_moment(bounds: Sequence[Bound], other_ns: int) -> Placed:
    """A moment of the second clock by the first one; bounds: by the second one's time."""
    behind = bisect_left(bounds, other_ns, key=lambda bound: bound.at_ns)
    near = [bound.widened(other_ns) for bound in bounds[max(0, behind - 1) : behind + 1]]
    low_ns, high_ns = max(bound.low_ns for bound in near), min(bound.high_ns for bound in near)
    if low_ns > high_ns:  # a clock was stepped in between: before it the one holds, after it the other
        low_ns, high_ns = min(bound.low_ns for bound in near), max(bound.high_ns for bound in near)
    middle_ns = (low_ns + high_ns) // 2
    return Placed(other_ns - middle_ns, high_ns - middle_ns)


def merge(first: Path, second: Path) -> list[Merged]:
    """All records of both in order. Raises AuditError where they can't be read or don't belong together."""
    bounds = _joined_bounds(_indexed(first), _indexed(second))
    found = [Merged(Placed(record.monotonic_ns), 0, record) for record in _records(first)]
    found += [Merged(place_moment(bounds, record.monotonic_ns), 1, record) for record in _records(second)]
    return sorted(found, key=lambda one: (one.placed.at_ns, one.trail, one.record.sequence))


def _joined_bounds(first: TrailIndex, second: TrailIndex) -> list[Bound]:
    bounds = bounds_of(first, second)
    wrong = first_contradiction([first, second])
    if wrong is not None and wrong.reason is not None:
        raise AuditError(AuditFault.TRAILS_CONTRADICT, first=first.path, second=second.path, why=wrong.reason)
    if not bounds:
        raise AuditError(AuditFault.TRAILS_NOT_JOINED, first=first.path, second=second.path)
    return bounds


def _indexed(path: Path) -> TrailIndex:
    try:
        index = index_trail(path, scan_file(path, {}).records)
    except OSError as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=path, detail=cause_of(error)) from error
    if not index.records:
        raise AuditError(AuditFault.TRAIL_EMPTY, path=path)
    return index


def _records(path: Path) -> Iterator[Record]:
    return (record for record in read(path) if isinstance(record, Record))


def merged_line(one: Merged, began_ns: int, render: Render) -> Text:
    """One record: seconds since `began_ns` by the first trail's clock, how uncertain, which trail, the record."""
    since_s = (one.placed.at_ns - began_ns) / 1e9
    text = Text(f"{since_s:>12.6f} s ±{one.placed.uncertainty_ns / 1e6:>8.3f} ms  {one.trail + 1}  ", "dim")
    return text + line_of(one.record, render)


def merged_values(one: Merged, paths: Sequence[Path]) -> dict[str, object]:
    """For JSON: nanoseconds of the first trail's monotonic clock."""
    return {
        "at_ns": one.placed.at_ns,
        "uncertainty_ns": one.placed.uncertainty_ns,
        "trail": str(paths[one.trail]),
        "record": msgspec.to_builtins(one.record),
    }
