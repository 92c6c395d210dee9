"""How late ticks begin, as a histogram of constant size: adding costs an index, percentiles are read when asked."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.messages import Lateness

_PER_DECADE = 40  # bins a factor of ten: a percentile is right to 6 %
_LOWEST_NS = 1_000
_DECADES = 8  # to 100 s
_EDGES_NS = _LOWEST_NS * 10.0 ** (np.arange(_PER_DECADE * _DECADES + 1) / _PER_DECADE)


@dataclass(slots=True)
class Histogram:
    """Lateness of a session's ticks; missed ones are counted besides."""

    missed: int = 0
    max_ns: int = 0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(_EDGES_NS) + 1, dtype=np.int64))

    def add(self, late_ns: int, missed: int = 0) -> None:
        """One tick that began this late, after so many that were left out."""
        self.counts[int(_EDGES_NS.searchsorted(late_ns, side="right"))] += 1
        self.missed += missed
        self.max_ns = max(self.max_ns, late_ns)

    def percentile_ms(self, share: float) -> float:
        """The lateness that this share (0 to 1) of the ticks did not exceed; upper edge of its bin."""
        total = int(self.counts.sum())
        if not total:
            return 0.0
        bin_number = int(np.searchsorted(np.cumsum(self.counts), share * total))
        edge_ns = _EDGES_NS[min(bin_number, len(_EDGES_NS) - 1)]
        return min(float(edge_ns), float(self.max_ns)) / 1e6

    def summary(self) -> Lateness:
        """For the screen and the trail."""
        return Lateness(
            ticks=int(self.counts.sum()),
            missed=self.missed,
            p50_ms=self.percentile_ms(0.50),
            p99_ms=self.percentile_ms(0.99),
            p999_ms=self.percentile_ms(0.999),
            max_ms=self.max_ns / 1e6,
        )
