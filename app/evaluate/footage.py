"""Labelled footage, whatever it comes as: a folder of frames with frames.csv, or a video file with a table of labels.

The table of a video file (`<its name>.csv` beside it, or one that is named) has the columns frame,label: a label holds
from that frame on, the first being 0, until the next line.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from app.evaluate.gesture_photos import check_label
from app.evaluate.sequence import PERIOD_NS, SKIP, pictures, read_frames
from app.system.errors import AppError
from hal.cameras.intrinsics import ASSUMED_FOCAL_PER_WIDTH
from kgdfa.preprocess import Image

_COLUMNS = ["frame", "label"]
_PALM_WIDTH_M = 0.0825  # between the two populations' means; gestures don't depend on it, only where a press is
_REFERENCE_OF_PALM = 0.75  # the paper's H: palm width less one finger of a quarter of it


@dataclass(frozen=True, slots=True, kw_only=True)
class Footage:
    """Frames in order and what each shows; `frames()` reads them anew. Metres, pixels, nanoseconds."""

    labels: tuple[str, ...]
    focal_px: float
    reference_m: float
    period_ns: int
    frames: Callable[[], Iterator[Image]]


def read_footage(where: Path, labels: Path | None = None) -> Footage:
    """A folder with frames.csv, such a file, or a video file. Raises AppError naming what, or which line, is wrong."""
    if where.is_dir() or where.suffix.lower() == ".csv":
        if labels is not None:
            raise AppError(f"{where} has its labels in frames.csv: give --labels with a video file only.")
        listed = read_frames(where)
        return Footage(
            labels=tuple(frame.label for frame in listed),
            focal_px=listed[0].focal_px,
            reference_m=listed[0].reference_m,
            period_ns=PERIOD_NS,
            frames=lambda: pictures(listed),
        )
    return _read_video(where, labels or where.with_suffix(".csv"))


def _read_video(where: Path, table: Path) -> Footage:
    count, width_px, rate_hz = _measure(where)
    return Footage(
        labels=_spread(table, _read_table(table), count),
        focal_px=ASSUMED_FOCAL_PER_WIDTH * width_px,
        reference_m=_REFERENCE_OF_PALM * _PALM_WIDTH_M,
        period_ns=round(1e9 / rate_hz) if rate_hz > 0 else PERIOD_NS,
        frames=lambda: _video_frames(where),
    )


def _measure(where: Path) -> tuple[int, float, float]:
    """How many frames a video really has (its header may lie), how wide they are, how many a second it claims."""
    video = _open(where)
    count = 0
    while video.grab():
        count += 1
    if not count:
        raise AppError(f"{where} holds no frame that can be read: give a video file, or a folder with frames.csv.")
    return count, video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FPS)


def _open(where: Path) -> cv2.VideoCapture:
    video = cv2.VideoCapture(str(where)) if where.is_file() else None
    if video is None or not video.isOpened():
        raise AppError(f"{where} is no video that can be read: give a video file, or a folder with frames.csv.")
    return video


def _video_frames(where: Path) -> Iterator[Image]:
    video = _open(where)
    try:
        while True:
            there, image = video.read()
            if not there:
                return
            yield np.asarray(image, dtype=np.uint8)
    finally:
        video.release()


def _read_table(table: Path) -> list[tuple[int, str]]:
    """Frame and label of every line."""
    try:
        with table.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise AppError(
            f"{table} can't be read ({error}): say with --labels which table belongs to the video."
        ) from error
    if not rows or rows[0] != _COLUMNS:
        raise AppError(f"{table} line 1: the columns must be {','.join(_COLUMNS)}.")
    return [_line(f"{table} line {number}", row) for number, row in enumerate(rows[1:], start=2)]


def _line(where: str, row: list[str]) -> tuple[int, str]:
    if len(row) != len(_COLUMNS) or not row[0].isdecimal():
        raise AppError(f"{where}: a frame's number and a label are due, like 90,none:rest.")
    if row[1] != SKIP:
        check_label(row[1], where)
    return int(row[0]), row[1]


def _spread(table: Path, lines: list[tuple[int, str]], count: int) -> tuple[str, ...]:
    """A label for each of `count` frames."""
    starts = [start for start, _ in lines]
    if not starts or starts[0] != 0:
        raise AppError(f"{table} line 2: the first label must begin with frame 0.")
    for number, (before, start) in enumerate(zip(starts, [*starts[1:], count], strict=True), start=3):
        if start <= before:
            what = f"line {number}" if number - 2 < len(starts) else f"line {number - 1}"
            raise AppError(f"{table} {what}: frames must grow from line to line and end before {count}.")
    stops = [*starts[1:], count]
    return tuple(label for (start, label), stop in zip(lines, stops, strict=True) for _ in range(start, stop))
