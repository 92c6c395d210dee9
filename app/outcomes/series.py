"""A measure over sessions: what a plot shows, and how far it came."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.outcomes.change import SMALLEST_CHANGES, SmallestChange
from app.outcomes.guided import GuidedTest, last_completed
from app.outcomes.session import SessionOutcomes
from app.outcomes.table import RATINGS, ROWS, TESTS
from app.text.catalogue import tr
from hal.joints.device import Joint


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """One measure, a value a session; None: not measured."""

    name: str  # with its unit
    form: str
    values: tuple[float | None, ...]
    smallest: SmallestChange | None = None

    @property
    def known(self) -> tuple[float, ...]:
        """Those that were measured."""
        return tuple(value for value in self.values if value is not None)

    @property
    def change(self) -> float | None:
        """From the first to the newest; None with fewer than two."""
        return self.known[-1] - self.known[0] if len(self.known) > 1 else None

    @property
    def least(self) -> float | None:
        """The smallest change that means something, from the first value on, in the measure's unit."""
        return self.smallest.of(self.known[0]) if self.smallest is not None and self.known else None


def series_of(found: Sequence[SessionOutcomes]) -> tuple[Series, ...]:
    """Every measure that at least one session has."""
    made = [
        _series(tr(f"outcomes.{key}"), form, [getattr(one.measures, field) for one in found], field)
        for key, field, form in ROWS
    ]
    made += [
        _series(tr("outcomes.range", joint=joint), ".1f", [_range_deg(one, joint) for one in found]) for joint in Joint
    ]
    made += [
        _series(tr(f"outcomes.{key}"), form, [_tested(one, test, field) for one in found], key)
        for key, test, field, form in TESTS
    ]
    made += [_series(tr(f"outcomes.{name}"), "d", [getattr(one, name) for one in found], name) for name in RATINGS]
    return tuple(series for series in made if series.known)


def _series(name: str, form: str, values: Sequence[float | None], changes: str = "") -> Series:
    return Series(name=name, form=form, values=tuple(values), smallest=SMALLEST_CHANGES.get(changes))


def _range_deg(one: SessionOutcomes, joint: Joint) -> float | None:
    found = one.measures.range_of_motion.get(joint.name.lower())
    return None if found is None else found.range_deg


def _tested(one: SessionOutcomes, test: GuidedTest, field: str) -> float | None:
    result = last_completed(one.tests, test)
    return None if result is None else getattr(result, field)
