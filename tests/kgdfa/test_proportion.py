"""Exact bounds of a share: against the definition, against the rule of three, and how often they hold."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.vocabulary import CONFIDENCE, at_least, at_most

COUNTS = st.integers(1, 400).flatmap(lambda count: st.tuples(st.integers(0, count), st.just(count)))


def chance(hits: int, count: int, share: float) -> float:
    return math.comb(count, hits) * share**hits * (1 - share) ** (count - hits)


@given(COUNTS)
def test_at_its_bound_so_few_hits_have_a_chance_of_five_per_cent(counts: tuple[int, int]) -> None:
    hits, count = counts
    bound = at_most(hits, count)
    if hits == count:
        assert bound == 1.0
    else:
        assert sum(chance(one, count, bound) for one in range(hits + 1)) == pytest.approx(0.05, abs=1e-9)


@given(COUNTS)
def test_the_bounds_enclose_what_was_counted_and_mirror_each_other(counts: tuple[int, int]) -> None:
    hits, count = counts
    assert 0 <= at_least(hits, count) <= hits / count <= at_most(hits, count) <= 1
    assert at_least(hits, count) == pytest.approx(1 - at_most(count - hits, count))


@given(COUNTS)
def test_one_hit_more_raises_both(counts: tuple[int, int]) -> None:
    hits, count = counts
    if hits < count:
        assert at_most(hits + 1, count) > at_most(hits, count)
        assert at_least(hits + 1, count) > at_least(hits, count)


@pytest.mark.parametrize("share", [0.02, 0.05, 0.5, 0.8, 0.97])
@pytest.mark.parametrize("count", [20, 60, 120])
def test_they_hold_for_at_least_95_of_100_samples(share: float, count: int) -> None:
    holds = sum(chance(hits, count, share) for hits in range(count + 1) if at_least(hits, count) <= share)
    assert holds >= CONFIDENCE - 1e-12


# Quantiles of the beta distribution, as Clopper and Pearson use them (scipy.stats.beta.ppf).
@pytest.mark.parametrize(
    ("hits", "count", "low", "high"),
    [(0, 120, 0.0, 0.0246559), (1, 120, 0.0004273, 0.0389208), (60, 60, 0.9512971, 1.0), (5, 10, 0.2224411, 0.7775589)],
)
def test_known_values(hits: int, count: int, low: float, high: float) -> None:
    assert at_least(hits, count) == pytest.approx(low, abs=1e-6)
    assert at_most(hits, count) == pytest.approx(high, abs=1e-6)


def test_nothing_counted_proves_nothing() -> None:
    assert (at_least(0, 0), at_most(0, 0)) == (0.0, 1.0)
    with pytest.raises(ValueError, match="3 of 2"):
        at_most(3, 2)
