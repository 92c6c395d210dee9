"""Curves that plans are made of; each is C², so that sums and products of them, and joints solved from them, are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def smoothstep(time_s: Array, start_s: float, end_s: float) -> Array:
    """0 before start, 1 after end, between them the minimum-jerk polynomial 10s³ − 15s⁴ + 6s⁵; (n,) like the time."""
    s = np.clip((time_s - start_s) / (end_s - start_s), 0.0, 1.0)
    return s * s * s * (10 - 15 * s + 6 * s * s)


def ramp(time_s: Array, start_s: float, end_s: float) -> Array:
    """The integral of `smoothstep`: at rest before start, moving with speed 1 after end; metres for m/s."""
    span = end_s - start_s
    s = np.clip((time_s - start_s) / span, 0.0, 1.0)
    return span * s**4 * (2.5 - 3 * s + s * s) + np.maximum(time_s - end_s, 0.0)


def cruise(time_s: Array, end_s: float, onset_s: float, settle_s: float) -> Array:
    """0 at 0, 1 from end on: the speed grows over the onset, stays, and falls over the settling; (n,) like the time."""
    way = ramp(time_s, 0.0, onset_s) - ramp(time_s, end_s - settle_s, end_s)
    return way / (end_s - (onset_s + settle_s) / 2)


def hump(time_s: Array, start_s: float, up_s: float, down_s: float, end_s: float) -> Array:
    """0, up to 1 between start and up, down to 0 between down and end."""
    return smoothstep(time_s, start_s, up_s) * (1 - smoothstep(time_s, down_s, end_s))
