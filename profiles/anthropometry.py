"""Palm width from sex and stature, by two named populations.

The GB 10000-88 percentiles were recalled, not read from the printed standard. A measured sample of 303 Chinese
adults (men 81.4 and 81.8 mm, women 72.6 and 72.4 mm, left and right) and the Asian subset of ANSUR II (84.8 and
75.8 mm) agree with them within a few millimetres. A measured palm always wins over an estimate.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from profiles.schema import Population, Sex

# GB 10000-88, men 18-60, women 18-55: mm at the percentiles 1, 5, 10, 50, 90, 95, 99.
GB_STATURE_MM: dict[Sex, tuple[float, ...]] = {
    Sex.MALE: (1543, 1583, 1604, 1678, 1754, 1775, 1814),
    Sex.FEMALE: (1449, 1484, 1503, 1570, 1640, 1659, 1697),
}
GB_HAND_BREADTH_MM: dict[Sex, tuple[float, ...]] = {
    Sex.MALE: (73, 76, 77, 82, 87, 89, 91),
    Sex.FEMALE: (67, 70, 71, 76, 80, 82, 84),
}
# ANSUR II, 6,068 adults: hand breadth mm = intercept + slope · stature mm, and the residual's sd.
ANSUR2_REGRESSION: dict[Sex, tuple[float, float, float]] = {
    Sex.MALE: (35.84, 0.02985, 3.9),
    Sex.FEMALE: (32.10, 0.02828, 3.4),
}
STATURE_BREADTH_CORRELATION = 0.47  # ANSUR II
_Z95 = 1.645  # normal quantile of the 95th percentile


@dataclass(frozen=True, slots=True, kw_only=True)
class PalmEstimate:
    """A palm width that nobody measured. sd_m: expected error; the distance errs by the same share."""

    width_m: float
    sd_m: float
    population: Population

    @property
    def distance_error(self) -> float:
        """The standard error that this estimate puts on every distance, as a share (Eq. 4 is linear in H)."""
        return self.sd_m / self.width_m


def estimate_palm(sex: Sex, stature_m: float, population: Population) -> PalmEstimate:
    """Palm width from sex and stature by a named population."""
    width_mm, sd_mm = _MODELS[population](sex, stature_m * 1000)
    return PalmEstimate(width_m=width_mm / 1000, sd_m=sd_mm / 1000, population=population)


def _gb10000_88(sex: Sex, stature_mm: float) -> tuple[float, float]:
    """The paper's way: the palm at the stature's percentile, linear between them, held beyond the ends.

    Its error: with correlation r, matching percentiles leaves sd·√(2 − 2r) of the palm widths' own sd.
    """
    breadth = GB_HAND_BREADTH_MM[sex]
    own_sd = (breadth[5] - breadth[1]) / (2 * _Z95)
    error = own_sd * math.sqrt(2 - 2 * STATURE_BREADTH_CORRELATION)
    return _between(stature_mm, GB_STATURE_MM[sex], breadth), error


def _ansur2(sex: Sex, stature_mm: float) -> tuple[float, float]:
    intercept, slope, residual_sd = ANSUR2_REGRESSION[sex]
    return intercept + slope * stature_mm, residual_sd


_MODELS: dict[Population, Callable[[Sex, float], tuple[float, float]]] = {
    Population.GB10000_88: _gb10000_88,
    Population.ANSUR2: _ansur2,
}


def _between(x: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    """Linear between the points, held beyond the ends."""
    x = min(max(x, xs[0]), xs[-1])
    right = min(max(bisect_right(xs, x), 1), len(xs) - 1)
    share = (x - xs[right - 1]) / (xs[right] - xs[right - 1])
    return ys[right - 1] + share * (ys[right] - ys[right - 1])
