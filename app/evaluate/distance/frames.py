"""Distance on labelled frames: what both range finders measure in real images whose true distance is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.table import Table

from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, decimals, decorate, figure, percent, table
from app.evaluate.readings import LabelledFrame
from app.perception.pipeline import RANGES
from app.system.errors import AppError
from app.text.catalogue import tr
from hal.cameras.playback import decode_image
from kgdfa.distance import Distance, RangeFinder
from kgdfa.hand import FloatArray
from kgdfa.keypoints import HandDetector

TILT_BINS_DEG = (0, 15, 30, 90)
COLUMNS = "empty n lost mae bias p95_cm within_5cm near_3 near_10"
STYLES: dict[str, dict[str, Any]] = {
    "published": {"color": "tab:orange", "linestyle": "--", "marker": "s"},
    "robust": {"color": "tab:blue", "linestyle": "-", "marker": "o"},
    "paper": {"color": "0.4", "linestyle": ":", "marker": "^"},
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DistanceFigures:
    """Over the frames with a measurement; NaN where there is none. Errors are of the shown distance, near shares of the
    safe one.

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

    def cells(self) -> tuple[str, ...]:
        """As COLUMNS has them after the first."""
        lengths = (decimals(self.mae_cm, ".2f"), decimals(self.bias_cm, "+.2f"), decimals(self.p95_cm, ".2f"))
        shares = (percent(self.within_5cm), percent(self.near_3, 2), percent(self.near_10, 2))
        return (str(self.frames), str(self.missing), *lengths, *shares)


def figures(true_m: FloatArray, shown_m: FloatArray, safe_m: FloatArray) -> DistanceFigures:
    """Figures of (n,) distances; NaN where a frame gave none."""
    measured = np.isfinite(shown_m)
    if not measured.any():
        nothing = float("nan")
        return DistanceFigures(
            frames=len(true_m), missing=len(true_m), mae_cm=nothing, bias_cm=nothing, p95_cm=nothing,
            within_5cm=nothing, near_3=nothing, near_10=nothing,
        )  # fmt: skip
    error_cm = (shown_m[measured] - true_m[measured]) * 100
    of_true = safe_m[measured] / true_m[measured]
    return DistanceFigures(
        frames=len(true_m),
        missing=int(np.count_nonzero(~measured)),
        mae_cm=float(np.abs(error_cm).mean()),
        bias_cm=float(error_cm.mean()),
        p95_cm=float(np.percentile(np.abs(error_cm), 95)),
        within_5cm=float(np.mean(np.abs(error_cm) <= 5.0)),
        near_3=float(np.mean(of_true < 0.97)),
        near_10=float(np.mean(of_true < 0.90)),
    )


def values(rows: Sequence[Distance | None], field: str) -> FloatArray:
    """(n,) of one field of the measurements, NaN where there is none."""
    return np.array([getattr(row, field) if row else np.nan for row in rows], dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class FramesResult:
    """Distances over a sequence, (n,) metres, NaN where a frame gave none; a column a range finder."""

    true_m: FloatArray
    shown_m: dict[str, FloatArray]
    safe_m: dict[str, FloatArray]
    tilt_deg: FloatArray
    unreadable: tuple[Path, ...]

    def figures(self, finder: str) -> DistanceFigures:
        """Over the whole sequence."""
        return figures(self.true_m, self.shown_m[finder], self.safe_m[finder])

    def by_tilt(self, finder: str) -> list[tuple[str, DistanceFigures]]:
        """A row a bin of the tilt as the palm's shape gives it."""
        rows = []
        for low, high in pairwise(TILT_BINS_DEG):
            inside = (self.tilt_deg >= low) & (self.tilt_deg < high)
            if inside.any():
                chosen = figures(self.true_m[inside], self.shown_m[finder][inside], self.safe_m[finder][inside])
                rows.append((f"{low}–{high}°", chosen))
        return rows

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        measured = {name: self.figures(name).as_json() for name in RANGES}
        return {"frames": len(self.true_m), "unreadable": [*map(str, self.unreadable)], **measured}


def measure_frames(frames: Sequence[LabelledFrame], detector: HandDetector, step: Step) -> FramesResult:
    """Run both finders over the frames, in order, at 30 a second. `step` is called after each.

    Raises AppError where no frame can be read.
    """
    finders: dict[str, RangeFinder] = {}
    measured: dict[str, list[Distance | None]] = {name: [] for name in RANGES}
    unreadable = []
    made_for: tuple[float, float, tuple[float, float] | None] | None = None
    for number, frame in enumerate(frames, start=1):
        wanted = (frame.focal_px, frame.reference_m, frame.centre_px)
        if wanted != made_for:
            finders = {
                name: make(focal_px=wanted[0], reference_m=wanted[1], centre_px=wanted[2])
                for name, make in RANGES.items()
            }
            made_for = wanted
        image = decode_image(frame.path, cv2.IMREAD_COLOR)
        if image is None:
            unreadable.append(frame.path)
        hands = () if image is None else detector.detect(np.asarray(image, np.uint8), number * FRAME_NS)
        for name, finder in finders.items():
            measured[name].append(finder.measure(hands[0], number * FRAME_NS) if hands else None)
        step()
    if len(unreadable) == len(frames):
        raise AppError(EvaluateFault.IMAGE_UNREADABLE, file=frames[0].path)
    return FramesResult(
        true_m=np.array([frame.distance_m for frame in frames]),
        shown_m={name: values(rows, "shown_m") for name, rows in measured.items()},
        safe_m={name: values(rows, "safe_m") for name, rows in measured.items()},
        tilt_deg=np.degrees(values(measured["robust"], "tilt_rad")),
        unreadable=tuple(unreadable),
    )


def frames_table(result: FramesResult) -> Table:
    """Both finders over a labelled sequence, whole and by tilt."""
    made = table("distance.frames", COLUMNS, left=9)
    for name in RANGES:
        made.add_row(name, *result.figures(name).cells())
        for tilt, one in result.by_tilt(name):
            made.add_row(tr("evaluate.distance.tilt", bin=tilt), *one.cells(), style="dim")
        made.add_section()
    return made


def plot_frames(result: FramesResult, path: Path) -> None:
    """Distance over the frames: truth, both finders, and the distance that the button uses."""
    with figure(path) as (_, axes):
        axes.plot(result.true_m * 100, color="black", label=tr("evaluate.plot.truth"))
        for name, shown_m in result.shown_m.items():
            style = {key: value for key, value in STYLES[name].items() if key != "marker"}
            axes.plot(shown_m * 100, label=name, linewidth=1, **style)
        button = tr("evaluate.plot.for_button")
        axes.plot(result.safe_m["robust"] * 100, color="tab:blue", alpha=0.4, linewidth=1, label=button)
        decorate(axes, "frame", "distance_cm", "frames", frames=len(result.true_m))
