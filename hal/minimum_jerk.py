"""The minimum-jerk polynomial (Flash and Hogan 1985): hands reach so, and planned motions start and end so."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Share = TypeVar("Share", float, NDArray[np.float64])


def minimum_jerk(s: Share) -> Share:
    """10s³ − 15s⁴ + 6s⁵ for s in [0, 1]: from 0 to 1, C² at both ends; a number or an array of any shape."""
    return s * s * s * (10 - 15 * s + 6 * s * s)


def minimum_jerk_rate(s: Share) -> Share:
    """Its derivative by s."""
    return 30 * s * s * (1 - s) * (1 - s)
