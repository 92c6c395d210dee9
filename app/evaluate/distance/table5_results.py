"""What came of Table 5 on the digital hand: its rows, tables and plot, beside the paper's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.table import Table

from app.evaluate.distance.frames import COLUMNS, STYLES, DistanceFigures
from app.evaluate.harness import MODES, decimals, decorate, figure, percent, table
from app.text.catalogue import tr

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
    depth_zero: float | None  # share of frames with a hand in which the depth map has 0 at keypoint 21

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it; None where nothing was measured."""
        paper, paper_depth = PAPER_TABLE_5[self.distance_cm]
        return {
            "distance_cm": self.distance_cm,
            "monocular": {name: _number(value) for name, value in self.mono_percent.items()},
            "monocular_worst_hand": _number(self.worst_percent),
            "d435i": {name: _number(value) for name, value in self.depth_percent.items()},
            "d435i_zero_share": None if self.depth_zero is None else round(self.depth_zero, 3),
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
    """All figures of distance on the digital hand."""

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


def tables(result: Table5) -> tuple[Table, ...]:
    """Error over distance, what 40° of tilt does, and the safety property on random walks."""
    return _table_5(result), _tilt_table(result), _walk_table(result)


def _table_5(result: Table5) -> Table:
    rows = []
    for row in result.rows:
        paper, paper_depth = PAPER_TABLE_5[row.distance_cm]
        mono, depth = row.mono_percent, row.depth_percent
        errors = (paper, mono["published"], mono["robust"], row.worst_percent, paper_depth)
        both = (depth["published"], depth["robust"])
        signed = (decimals(error, "+.1f") for error in (*errors, *both))
        rows.append((row.distance_cm, *signed, percent(row.depth_zero, 0)))
    columns = "cm paper published robust worst_hand d435i_paper published robust zeros"
    caption = "distance.zeros"
    return table(
        "distance.table_5", columns, rows, left=9, caption=caption, hands=result.hands, focal_px=result.focal_px
    )


def _tilt_table(result: Table5) -> Table:
    rows = [
        (
            f"{row.direction_deg}°",
            decimals(row.mean_percent, "+.1f"),
            decimals(row.median_percent, ".1f"),
            decimals(row.p95_percent, ".1f"),
            percent(row.near_3),
        )
        for row in result.tilts
    ]
    return table("distance.tilts", "towards mean_error median_error p95_percent button_near_3", rows, left=5)


def _walk_table(result: Table5) -> Table:
    return table("distance.walks", COLUMNS, [(name, *one.cells()) for name, one in result.walk.items()], left=9)


def plot_table_5(result: Table5, path: Path) -> None:
    """Error over distance, the paper's beside ours."""
    with figure(path) as (_, axes):
        cm = [row.distance_cm for row in result.rows]
        paper = [error for error, _ in PAPER_TABLE_5.values()]
        axes.plot(cm, paper, label=tr("evaluate.plot.paper_monocular"), **STYLES["paper"])
        for name in MODES:
            errors = [row.mono_percent[name] for row in result.rows]
            axes.plot(cm, errors, label=tr("evaluate.plot.monocular", rules=name), **STYLES[name])
        depth = [row.depth_percent["robust"] for row in result.rows]
        axes.plot(cm, depth, "x-", color="tab:green", label=tr("evaluate.plot.d435i_robust"))
        axes.axhspan(-2.5, 2.5, alpha=0.12, color="tab:blue")
        decorate(axes, "true_distance_cm", "error_percent", "table_5")
