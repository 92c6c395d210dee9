"""Labelled frame sequences (`frames.csv`): what both range finders say of real pictures with a known distance."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from app.evaluate.distance_measures import DistanceFigures, FloatArray, figures
from app.ipc.streams import TRIGGER
from app.system.errors import AppError
from kgdfa.distance import Distance, PublishedRange, RangeFinder
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector
from kgdfa.robust_distance import RobustRange

FRAME_NS = TRIGGER.period_ns
COLUMNS = ("path", "distance_cm", "anchor_cm", "fx", "cx", "cy")
TILT_BINS_DEG = (0, 15, 30, 90)
FINDERS: dict[str, type[PublishedRange] | type[RobustRange]] = {"published": PublishedRange, "robust": RobustRange}


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledFrame:
    """One line of `frames.csv`."""

    path: Path
    distance_m: float
    reference_m: float
    focal_px: float
    centre_px: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceResult:
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
        """A row a bin of the tilt as the palm's shape tells it."""
        rows = []
        for low, high in pairwise(TILT_BINS_DEG):
            inside = (self.tilt_deg >= low) & (self.tilt_deg < high)
            if inside.any():
                chosen = figures(self.true_m[inside], self.shown_m[finder][inside], self.safe_m[finder][inside])
                rows.append((f"{low}–{high}°", chosen))
        return rows


def read_frames(folder: Path) -> list[LabelledFrame]:
    """The lines of `frames.csv`. Raises AppError naming the file and the line that can't be used."""
    path = folder / "frames.csv"
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise AppError(f"{path} can't be read: {error}; name a folder with a frames.csv.") from error
    if not rows or any(column not in rows[0] for column in COLUMNS):
        raise AppError(
            f"{path} has no frames: its first line must name {', '.join(COLUMNS)}, one line a frame after it."
        )
    return [_frame(folder, row, line) for line, row in enumerate(rows, start=2)]


def _frame(folder: Path, row: dict[str, str], line: int) -> LabelledFrame:
    try:
        distance, anchor, focal, x, y = (float(row[column]) for column in COLUMNS[1:])
    except (TypeError, ValueError) as error:
        raise AppError(f"{folder / 'frames.csv'}, line {line}: {error}; mend the number.") from error
    if not (distance > 0 and math.isfinite(distance)):
        raise AppError(f"{folder / 'frames.csv'}, line {line}: distance_cm {distance:g} must be above 0.")
    return LabelledFrame(
        path=folder / row["path"], distance_m=distance / 100, reference_m=anchor / 100, focal_px=focal, centre_px=(x, y)
    )


def measure_frames(frames: Sequence[LabelledFrame], detector: HandDetector, step: Callable[[], None]) -> SequenceResult:
    """Run both finders over the frames, in order, at 30 a second. `step` is called after each."""
    finders: dict[str, RangeFinder] = {}
    measured: dict[str, list[Distance | None]] = {name: [] for name in FINDERS}
    unreadable = []
    made_for: tuple[float, float, tuple[float, float]] | None = None
    for index, frame in enumerate(frames):
        wanted = (frame.focal_px, frame.reference_m, frame.centre_px)
        if wanted != made_for:
            finders = {
                name: make(focal_px=wanted[0], reference_m=wanted[1], centre_px=wanted[2])
                for name, make in FINDERS.items()
            }
            made_for = wanted
        image = cv2.imread(str(frame.path))
        if image is None:
            unreadable.append(frame.path)
        hand = None if image is None else _first(detector.detect(np.asarray(image, np.uint8), (index + 1) * FRAME_NS))
        for name, finder in finders.items():
            measured[name].append(finder.measure(hand, (index + 1) * FRAME_NS) if hand else None)
        step()
    return SequenceResult(
        true_m=np.array([frame.distance_m for frame in frames]),
        shown_m={name: _column(rows, "shown_m") for name, rows in measured.items()},
        safe_m={name: _column(rows, "safe_m") for name, rows in measured.items()},
        tilt_deg=np.degrees(_column(measured["robust"], "tilt_rad")),
        unreadable=tuple(unreadable),
    )


def _first(hands: tuple[Hand, ...]) -> Hand | None:
    return hands[0] if hands else None


def _column(rows: Sequence[Distance | None], field: str) -> FloatArray:
    return np.array([getattr(row, field) if row else np.nan for row in rows], dtype=np.float64)
