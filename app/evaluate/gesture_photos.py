"""Labelled photos of hands: reading the list, and looking at every picture once."""

from __future__ import annotations

import csv
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import cv2

from app.system.errors import AppError
from kgdfa.augmentation import FALLBACK_THRESHOLD, StillDetector, detect_photo
from kgdfa.errors import KgdfaError
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.preprocess import Prepare, as_bgr8

NONE_PREFIX = "none:"
_COLUMNS = ["path", "label", "source", "group"]
_BY_VALUE = {gesture.value: gesture for gesture in Gesture}


@dataclass(frozen=True, slots=True, kw_only=True)
class Photo:
    """One line of labels.csv."""

    path: str
    label: str  # a gesture's name, or none:<what>
    source: str = ""
    group: str = ""

    @property
    def gesture(self) -> Gesture | None:
        """The gesture it shows, or None."""
        return _BY_VALUE.get(self.label)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenPhoto:
    """A photo and the hands its looks found, the plain look's first; `error` where it can't be read."""

    photo: Photo
    hands: tuple[Hand, ...]
    error: str = ""


def check_label(label: str, where: str) -> None:
    """Raises AppError unless it is a gesture or none:<what>."""
    if label not in _BY_VALUE and not (label.startswith(NONE_PREFIX) and len(label) > len(NONE_PREFIX)):
        raise AppError(f"{where}: unknown label {label!r}; use 0 to 9, love, rock or none:<what>.")


def read_labels(directory: Path) -> list[Photo]:
    """The photos that labels.csv lists. Raises AppError naming the line that can't be used."""
    where = directory / "labels.csv"
    try:
        with where.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise AppError(f"{where} can't be read ({error}): give a folder with labels.csv and pictures.") from error
    if not rows or rows[0] != _COLUMNS:
        raise AppError(f"{where} line 1: the columns must be {','.join(_COLUMNS)}.")
    photos = [_photo(f"{where} line {number}", row) for number, row in enumerate(rows[1:], start=2) if row]
    if not photos:
        raise AppError(f"{where} lists no picture: add a line for each.")
    return photos


def _photo(where: str, row: list[str]) -> Photo:
    if len(row) != len(_COLUMNS):
        raise AppError(f"{where}: {len(row)} fields where {len(_COLUMNS)} are due.")
    photo = Photo(path=row[0], label=row[1], source=row[2], group=row[3])
    check_label(photo.label, where)
    if not photo.path:
        raise AppError(f"{where}: the path is empty.")
    return photo


class PhotoLooker:
    """Looks at photos with the real detector; each thread that asks gets detectors of its own."""

    def __init__(self, directory: Path, model: Path, prepare: Prepare = as_bgr8) -> None:
        self._directory = directory
        self._prepare = prepare
        self._model = model
        self._own = threading.local()
        self._closing = ExitStack()  # MediaPipe's detectors can't be left to the interpreter's end

    def close(self) -> None:
        """Close every thread's detectors; no thread may be looking."""
        self._closing.close()

    def see(self, photo: Photo) -> SeenPhoto:
        """Every look at one photo; a picture that can't be read is an error to be counted, not an exception."""
        image = cv2.imread(str(self._directory / photo.path), cv2.IMREAD_UNCHANGED)
        if image is None:
            return SeenPhoto(photo=photo, hands=(), error="no picture, or one that can't be read")
        detector, eager = self._detectors()
        try:
            return SeenPhoto(photo=photo, hands=detect_photo(detector, eager, self._prepare(image)))
        except KgdfaError as error:
            return SeenPhoto(photo=photo, hands=(), error=str(error))

    def _detectors(self) -> tuple[StillDetector, StillDetector]:
        from kgdfa.keypoints import HandDetector

        if not hasattr(self._own, "pair"):
            low = FALLBACK_THRESHOLD
            eager = HandDetector(self._model, still=True, max_hands=2, min_detection=low, min_presence=low)
            plain = HandDetector(self._model, still=True, max_hands=2)
            self._own.pair = (plain, eager)
            self._closing.callback(plain.close)
            self._closing.callback(eager.close)
        pair: tuple[StillDetector, StillDetector] = self._own.pair
        return pair


def see_all(
    photos: list[Photo], directory: Path, model: Path, tell: Callable[[], None], prepare: Prepare = as_bgr8
) -> list[SeenPhoto]:
    """Every photo looked at, in order; `tell` is called after each."""
    looker = PhotoLooker(directory, model, prepare)
    seen = []
    with closing(looker), ThreadPoolExecutor(os.cpu_count()) as pool:
        for one in pool.map(looker.see, photos):
            seen.append(one)
            tell()
    return seen
