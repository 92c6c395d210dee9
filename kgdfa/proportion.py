"""Exact bounds of a share from counts (Clopper and Pearson, Biometrika 26, 1934), each one-sided.

They hold for independent frames. Frames in a row are not: who compares a bound with a limit leaves room for that.
"""

from __future__ import annotations

import math
from functools import cache

CONFIDENCE = 0.95
_HALVINGS = 50  # of [0, 1]: to 1e-15


@cache
def at_least(hits: int, count: int) -> float:
    """The share that is reached with 95 % confidence: under a smaller one so many hits would be rarer than 5 %."""
    return 1.0 - at_most(count - hits, count)


@cache
def at_most(hits: int, count: int) -> float:
    """The share that is not exceeded with 95 % confidence; 1 where nothing was counted.

    Raises ValueError for counts that can't be.
    """
    if not 0 <= hits <= count:
        raise ValueError(f"{hits} of {count}")
    if hits == count:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = (low + high) / 2
        low, high = (share, high) if _so_few(hits, count, share) > 1 - CONFIDENCE else (low, share)
    return high


def _so_few(hits: int, count: int, share: float) -> float:
    """The chance of at most so many hits: the binomial distribution's sum."""
    orders = math.lgamma(count + 1)
    return math.fsum(
        math.exp(
            orders
            - math.lgamma(hit + 1)
            - math.lgamma(count - hit + 1)
            + hit * math.log(share)
            + (count - hit) * math.log1p(-share)
        )
        for hit in range(hits + 1)
    )
