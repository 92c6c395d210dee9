"""Labelled data: still images (labels.csv), frames (frames.csv), and video files with a table of labels beside them.

A video's table (`<its name>.csv`, or one that is named) has the columns frame,label: a label holds from that frame on,
the first being 0, until the next line.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from app.evaluate.harness import FRAME_NS, EvaluateFault
from app.system.errors import AppError
from hal.cameras.intrinsics import assumed_focal_px
from hal.cameras.playback import decode_image, frame_period_ns, open_video
from kgdfa.errors import KgdfaError
from kgdfa.gesture import GESTURE_NAMED, Gesture
from kgdfa.hand import Hand
from kgdfa.preprocess import Image, as_bgr8, reduced
from logs.reading.errors import cause_of
from logs.reading.regular import read_text
from logs.reason import Reason, reason, reason_of
from profiles.palm import REFERENCE_OF_PALM

NONE_PREFIX = "none:"
NO_HAND = "none:nohand"
UNPREPARED = "none"  # of `PREPARATIONS`, and of stored keypoints that name none
SKIP = "skip"  # between gestures: any verdict is right
GESTURE_COLUMNS = ("path", "label", "anchor_cm", "fx")
SPEED_COLUMNS = ("path", "anchor_cm", "fx")
DISTANCE_COLUMNS = ("path", "distance_cm", "anchor_cm", "fx", "cx", "cy")
_IMAGE_COLUMNS = ("path", "label", "source", "group")
_VIDEO_COLUMNS = ("frame", "label")
UPRIGHT = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH  # IMREAD_UNCHANGED leaves a phone's photos as its sensor lay
_PALM_WIDTH_M = 0.0825  # between the two populations' means; gestures don't depend on it, only where a press is
NO_MEMORY = (cv2.error, MemoryError)  # what OpenCV and NumPy raise where an image takes more than there is
Item = TypeVar("Item")
GESTURE_NAMES = tuple(gesture.value for gesture in Gesture)


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledImage:
    """One line of labels.csv."""

    path: str
    label: str  # a gesture's name, or none:<what>
    source: str = ""
    group: str = ""

    @property
    def gesture(self) -> Gesture | None:
        """The gesture it shows, or None."""
        return GESTURE_NAMED.get(self.label)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectedImage:
    """A labelled image and the hands found in its views, the plain view's first; `error` where it can't be read.

    contents: SHA-256 of its file; empty where there was none, or it is not known.
    """

    image: LabelledImage
    hands: tuple[Hand, ...]
    error: Reason | None = None
    contents: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledFrame:
    """One line of frames.csv; metres and pixels. Label and distance are there if their column was required."""

    path: Path
    focal_px: float
    reference_m: float
    label: str = ""
    distance_m: float = math.nan
    centre_px: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Footage:
    """Frames in order and what each shows; `frames()` reads them anew, None for one that can't be read.

    Metres, pixels, nanoseconds.
    """

    labels: tuple[str, ...]
    focal_px: float
    reference_m: float
    period_ns: int
    frames: Callable[[], Iterator[Image | None]]
    paths: tuple[Path, ...] = ()  # of the frames; a video's have none
    claimed_frames: int | None = None  # by a video's header, which may estimate; of a folder nothing claims any


Row = dict[str, str]


def read_table(file: Path, columns: Sequence[str], *, exact: bool = True) -> list[tuple[int, Row]]:
    """Line numbers, the last of a row that has several, and rows of a table with these columns.

    Raises AppError naming the file and the line. exact: it has these columns and no others, and every row fills them.
    """
    try:
        reader = csv.reader(io.StringIO(read_text(file), newline=""))
        head = next(reader, [])
        numbered = [(reader.line_num, row) for row in reader if row]
    except (OSError, csv.Error) as error:
        raise AppError(EvaluateFault.FILE_UNREADABLE, file=file, detail=cause_of(error)) from error
    if head != [*columns] if exact else not {*columns} <= {*head}:
        raise AppError(EvaluateFault.TABLE_COLUMNS, file=file, columns=",".join(columns))
    for line, row in numbered:
        if len(row) != len(head):
            raise AppError(EvaluateFault.ROW_FIELDS, file=file, line=line, found=len(row), due=len(head))
    return [(line, dict(zip(head, row, strict=True))) for line, row in numbered]


def check_label(label: str, file: Path, line: int) -> None:
    """Raises AppError unless it is a gesture or none:<what>."""
    if label not in GESTURE_NAMED and not (label.startswith(NONE_PREFIX) and len(label) > len(NONE_PREFIX)):
        raise AppError(EvaluateFault.ROW_LABEL, file=file, line=line, label=label)


def read_labels(directory: Path) -> list[LabelledImage]:
    """The images that labels.csv lists. Raises AppError naming the line that can't be used."""
    file = directory / "labels.csv"
    images = []
    for line, row in read_table(file, _IMAGE_COLUMNS):
        check_label(row["label"], file, line)
        if not row["path"]:
            raise AppError(EvaluateFault.ROW_PATH, file=file, line=line)
        images.append(LabelledImage(**row))
    return _some(images, file)


def read_image(labelled: LabelledImage, directory: Path) -> Image | Reason:
    """A listed image, or why it can't be used: an error to be counted, not an exception."""
    image = decode_image(directory / labelled.path, UPRIGHT)
    if image is None:
        return unreadable_image(labelled)
    try:
        return as_bgr8(image)
    except KgdfaError as error:
        return reason_of(error)
    except NO_MEMORY:
        return unreadable_image(labelled)


def unreadable_image(labelled: LabelledImage) -> Reason:
    """Why a listed image can't be used, where nothing more is known."""
    return reason(EvaluateFault.IMAGE_UNREADABLE, file=labelled.path)


def read_images(
    images: Iterable[LabelledImage], directory: Path, unreadable: dict[str, Reason]
) -> Iterator[tuple[LabelledImage, Image]]:
    """The images that can be read, reduced; the others are added to `unreadable`, by their paths."""
    for labelled in images:
        image = read_image(labelled, directory)
        if isinstance(image, Reason):
            unreadable[labelled.path] = image
        else:
            yield labelled, reduced(image)


def read_frames(where: Path, columns: Sequence[str] = GESTURE_COLUMNS) -> list[LabelledFrame]:
    """The frames that a frames.csv, or the folder that holds one, lists. Raises AppError naming the bad line.

    columns: what is required, GESTURE_COLUMNS, SPEED_COLUMNS or DISTANCE_COLUMNS.
    """
    file = where / "frames.csv" if where.is_dir() else where
    return _some([_frame(file, line, row, columns) for line, row in read_table(file, columns, exact=False)], file)


def _some(listed: list[Item], file: Path) -> list[Item]:
    if not listed:
        raise AppError(EvaluateFault.TABLE_EMPTY, file=file)
    return listed


_POSITIVE = {"fx": 100_000.0, "anchor_cm": 100.0}  # column → what no camera and no hand has


def _number(column: str, text: str) -> float:
    number = float(text)
    if not math.isfinite(number) or (column in _POSITIVE and not 0 < number < _POSITIVE[column]):
        raise ValueError(f"{column} = {text}")
    return number


def _frame(file: Path, line: int, row: Row, columns: Sequence[str]) -> LabelledFrame:
    try:
        number = {name: _number(name, row[name]) for name in columns if name not in ("path", "label", "distance_cm")}
        number |= {name: float(row[name]) for name in columns if name == "distance_cm"}  # has a fault of its own
    except ValueError as error:
        raise AppError(EvaluateFault.ROW_NUMBER, file=file, line=line, detail=str(error)) from error
    if "label" in columns and row["label"] != SKIP:
        check_label(row["label"], file, line)
    distance_cm = number.get("distance_cm", math.nan)
    if "distance_cm" in number and not (distance_cm > 0 and math.isfinite(distance_cm)):
        raise AppError(EvaluateFault.ROW_DISTANCE, file=file, line=line, distance_cm=distance_cm)
    return LabelledFrame(
        path=file.parent / row["path"],
        focal_px=number["fx"],
        reference_m=number["anchor_cm"] / 100,
        label=row.get("label", ""),
        distance_m=distance_cm / 100,
        centre_px=(number["cx"], number["cy"]) if "cx" in number else None,
    )


def images_of(frames: Sequence[LabelledFrame]) -> Iterator[Image | None]:
    """The images of the frames, None for one that can't be read."""
    for frame in frames:
        image = decode_image(frame.path, cv2.IMREAD_COLOR)
        yield None if image is None else np.asarray(image, np.uint8)


def read_footage(where: Path, labels: Path | None = None) -> Footage:
    """A folder with frames.csv, such a file, or a video file. Raises AppError naming what, or which line, is wrong."""
    if not (where.is_dir() or where.suffix.lower() == ".csv"):
        return _read_video(where, labels or where.with_suffix(".csv"))
    if labels is not None:
        raise AppError(EvaluateFault.LABELS_OPTION, file=where)
    listed = read_frames(where)
    return Footage(
        labels=tuple(frame.label for frame in listed),
        focal_px=listed[0].focal_px,
        reference_m=listed[0].reference_m,
        period_ns=FRAME_NS,
        frames=lambda: images_of(listed),
        paths=tuple(frame.path for frame in listed),
    )


def _read_video(where: Path, table: Path) -> Footage:
    video, count, last_ms = _open(where), 0, 0.0
    while video.grab():  # counted: a header may estimate, or name frames that were cut off
        count, last_ms = count + 1, video.get(cv2.CAP_PROP_POS_MSEC)
    if not count:
        raise AppError(EvaluateFault.VIDEO_UNREADABLE, file=where)
    width_px, height_px = video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)
    timed = last_ms > count  # else the container has no times, or impossible ones: above 1,000 frames a second
    return Footage(
        labels=_video_labels(table, count),
        focal_px=assumed_focal_px(width_px, height_px),
        reference_m=REFERENCE_OF_PALM * _PALM_WIDTH_M,
        period_ns=round(last_ms * 1e6 / (count - 1)) if timed else frame_period_ns(video),
        frames=lambda: _video_frames(where),
        claimed_frames=max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT))),
    )


def _open(where: Path) -> cv2.VideoCapture:
    video = open_video(where)
    if video is None:
        raise AppError(EvaluateFault.VIDEO_UNREADABLE, file=where)
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


def _video_labels(table: Path, count: int) -> tuple[str, ...]:
    """A label for each of `count` frames."""
    starts: list[int] = []
    labels: list[str] = []
    for line, row in read_table(table, _VIDEO_COLUMNS):
        if not (row["frame"].isdecimal() and len(row["frame"]) < 10):
            raise AppError(EvaluateFault.VIDEO_ROW, file=table, line=line)
        if row["label"] != SKIP:
            check_label(row["label"], table, line)
        start = int(row["frame"])
        if start >= count or (starts and start <= starts[-1]):
            raise AppError(EvaluateFault.VIDEO_ORDER, file=table, line=line, frames=count)
        starts.append(start)
        labels.append(row["label"])
    if not starts or starts[0] != 0:
        raise AppError(EvaluateFault.VIDEO_START, file=table)
    lengths = np.diff([*starts, count])
    return tuple(np.repeat(np.array(labels, dtype=object), lengths))
