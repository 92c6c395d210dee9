"""How far distances are off: the figures that every evaluation of distance prints, pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class DistanceFigures:
    """Over the frames with a measurement. Errors are of the shown distance, near shares of the safe one.

    near_3, near_10: share of frames in which the button's distance reads nearer than the truth by over 3, 10 %.
    """

    frames: int
    missing: int
    mae_cm: float
    bias_cm: float
    p95_cm: float
    within_5cm: float
    near_3: float
    near_10: float

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        names = ("mae_cm", "bias_cm", "p95_cm", "within_5cm", "near_3", "near_10", "missing")
        return {name: round(getattr(self, name), 4) for name in names}


def figures(true_m: FloatArray, shown_m: FloatArray, safe_m: FloatArray) -> DistanceFigures:
    """Figures of (n,) distances; NaN where a frame gave none."""
    seen = np.isfinite(shown_m)
    if not seen.any():
        nothing = float("nan")
        return DistanceFigures(
            frames=len(true_m), missing=len(true_m), mae_cm=nothing, bias_cm=nothing, p95_cm=nothing,
            within_5cm=0.0, near_3=0.0, near_10=0.0,
        )  # fmt: skip
    error_cm = (shown_m[seen] - true_m[seen]) * 100
    of_true = safe_m[seen] / true_m[seen]
    return DistanceFigures(
        frames=len(true_m),
        missing=int(np.count_nonzero(~seen)),
        mae_cm=float(np.abs(error_cm).mean()),
        bias_cm=float(error_cm.mean()),
        p95_cm=float(np.percentile(np.abs(error_cm), 95)),
        within_5cm=float(np.mean(np.abs(error_cm) <= 5.0)),
        near_3=float(np.mean(of_true < 0.97)),
        near_10=float(np.mean(of_true < 0.90)),
    )
