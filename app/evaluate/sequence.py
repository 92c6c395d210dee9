"""Labelled sequences of frames: frames.csv beside its pictures, or the digital hand where there is no recording."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from app.evaluate.gesture_photos import check_label
from app.system.errors import AppError
from kgdfa.preprocess import Image

SKIP = "skip"  # between gestures: any verdict is right
RATE_HZ = 30.0  # of a recording that doesn't say
PERIOD_NS = round(1e9 / RATE_HZ)


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledFrame:
    """One line of frames.csv; lengths in metres, focal length in pixels."""

    path: Path
    label: str
    focal_px: float
    reference_m: float


def read_frames(where: Path) -> list[LabelledFrame]:
    """The frames that a frames.csv, or the folder that holds one, lists. Raises AppError naming the bad line."""
    file = where / "frames.csv" if where.is_dir() else where
    try:
        with file.open(newline="", encoding="utf-8-sig") as opened:
            rows = list(csv.DictReader(opened))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise AppError(f"{file} can't be read ({error}): give a folder with frames.csv and pictures.") from error
    if not rows:
        raise AppError(f"{file} lists no frame: add a line for each.")
    return [_frame(file, number, row) for number, row in enumerate(rows, start=2)]


def _frame(file: Path, number: int, row: dict[str, str]) -> LabelledFrame:
    where = f"{file} line {number}"
    try:
        label = row["label"]
        frame = LabelledFrame(
            path=file.parent / row["path"],
            label=label,
            focal_px=float(row["fx"]),
            reference_m=float(row["anchor_cm"]) / 100,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise AppError(f"{where}: path, label, anchor_cm and fx are due, and numbers where numbers are.") from error
    if label != SKIP:
        check_label(label, where)
    return frame


def pictures(frames: list[LabelledFrame]) -> Iterator[Image]:
    """The pictures of the frames. Raises AppError naming one that can't be read."""
    for frame in frames:
        image = cv2.imread(str(frame.path))
        if image is None:
            raise AppError(f"{frame.path} is no picture, or can't be read: mend the recording.")
        yield np.asarray(image, np.uint8)
