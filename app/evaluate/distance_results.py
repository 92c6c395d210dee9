"""What Table 5 on the digital hand says, as rows for tables, plots and JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from app.evaluate.distance_measures import DistanceFigures

# The paper's Table 5: distance in cm → error in %, monocular and D435i (None: no measurement).
PAPER_TABLE_5: dict[int, tuple[float, float | None]] = {
    10: (-7.0, None), 15: (-4.0, None), 20: (-3.0, None), 25: (-2.8, 1.6), 30: (-1.6, 0.3), 35: (-1.4, -0.3),
    40: (-2.25, 0.0), 45: (0.6, 0.0), 50: (3.2, 0.0), 55: (4.5, -0.2), 60: (4.8, -0.3), 65: (5.1, -0.4),
    70: (12.4, -0.6),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Table5Row:
    """One distance, hands facing the camera: mean error in %, NaN where nothing was measured.

    worst_percent: of the single hand that is furthest off, robust monocular.
    """

    distance_cm: int
    mono_percent: dict[str, float]
    worst_percent: float
    depth_percent: dict[str, float]
    depth_zero: float  # share of frames in which the depth map says 0 at keypoint 21

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it; None where nothing was measured."""
        paper, paper_depth = PAPER_TABLE_5[self.distance_cm]
        return {
            "distance_cm": self.distance_cm,
            "monocular": {name: _number(value) for name, value in self.mono_percent.items()},
            "monocular_worst_hand": _number(self.worst_percent),
            "d435i": {name: _number(value) for name, value in self.depth_percent.items()},
            "d435i_zero_share": round(self.depth_zero, 3),
            "paper": {"monocular": paper, "d435i": paper_depth},
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltRow:
    """Hands tilted by 40° towards one direction: robust errors in % of the shown distance; near share of the safe."""

    direction_deg: int
    mean_percent: float
    median_percent: float
    p95_percent: float
    near_3: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Table5:
    """Everything the digital hand says about distance."""

    hands: int
    focal_px: float
    rows: tuple[Table5Row, ...]
    tilts: tuple[TiltRow, ...]
    walk: dict[str, DistanceFigures]

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        return {
            "hands": self.hands,
            "focal_px": self.focal_px,
            "table_5": [row.as_json() for row in self.rows],
            "tilted_40": [
                {
                    "direction_deg": row.direction_deg,
                    "mean_percent": _number(row.mean_percent),
                    "median_abs_percent": _number(row.median_percent),
                    "p95_abs_percent": _number(row.p95_percent),
                    "near_3": round(row.near_3, 4),
                }
                for row in self.tilts
            ],
            "frames": self.walk["robust"].frames,
            **{name: one.as_json() for name, one in self.walk.items()},
        }


def _number(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 2)
