"""Finite sources as a Camera: a video file, a folder of pictures, a recorded session."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from hal.cameras.camera import DepthArray, EndOfRecording, Frame, ImageArray, Intrinsics
from hal.cameras.intrinsics import check_size, choose
from hal.errors import HardwareError

PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One recorded picture. offset_ns: since the first. intrinsics: as recorded, None where they weren't."""

    offset_ns: int
    image_bgr: ImageArray
    depth_m: DepthArray | None = None
    intrinsics: Intrinsics | None = None


Moments = Callable[[], Iterator[Moment]]


class PlaybackCamera:
    """Plays moments back at the pace they were recorded, or as fast as they are read.

    Captured times are of this host's clock now: for the chain a recording is a live camera.
    """

    def __init__(
        self,
        path: Path,
        moments: Moments,
        *,
        focal_px: float | None = None,
        mirrored: bool = False,
        paced: bool = True,
        store: Path | None = None,
    ) -> None:
        """moments: starts the source anew; raises HardwareError when it can't be read."""
        self._path = path
        self._moments = moments
        self._focal_px = focal_px
        self._mirrored = mirrored
        self._paced = paced
        self._store = store
        self._waiting: Iterator[Moment] | None = None
        self._next: Moment | None = None
        self._end: EndOfRecording | None = None
        self._started_ns = 0
        self._sequence = 0
        self._intrinsics: Intrinsics | None = None

    @property
    def name(self) -> str:
        """The file's name."""
        return self._path.name

    def open(self) -> None:
        """Start from the beginning. Raises HardwareError when there is not one readable picture."""
        self._waiting = self._moments()
        self._look_ahead()
        if self._next is None:
            raise HardwareError(str(self._end or f"The recording {self._path} holds no picture: choose another one."))
        height, width = self._next.image_bgr.shape[:2]
        self._intrinsics = self._choose(self._next, width, height)
        self._started_ns = time.monotonic_ns()
        self._sequence = 0

    def read(self, timeout_s: float) -> Frame | None:
        """The next picture when its time has come. Raises EndOfRecording after the last one."""
        if self._waiting is None or self._intrinsics is None:
            raise HardwareError(f"The recording {self._path} is not open: open it before reading.")
        moment = self._next
        if moment is None:
            raise self._end or EndOfRecording(f"The recording {self._path} ended after {self._sequence} pictures.")
        due_ns = self._started_ns + moment.offset_ns
        if self._paced and not _wait_until(due_ns, timeout_s):
            return None
        height, width = moment.image_bgr.shape[:2]
        check_size(self._intrinsics, width, height, self.name)
        self._look_ahead()
        self._sequence += 1
        return Frame(
            image_bgr=np.asarray(cv2.flip(moment.image_bgr, 1), np.uint8) if self._mirrored else moment.image_bgr,
            captured_ns=due_ns,
            sequence=self._sequence,
            intrinsics=self._intrinsics,
            depth_m=_turned(moment.depth_m) if self._mirrored else moment.depth_m,
        )

    def close(self) -> None:
        """Forget where it was."""
        self._waiting = self._next = self._end = None

    def _look_ahead(self) -> None:
        """Fetch the next picture; a cut found now is told when its turn comes."""
        assert self._waiting is not None
        self._next = None
        try:
            self._next = next(self._waiting, None)
        except EndOfRecording as end:
            self._end = end

    def _choose(self, first: Moment, width_px: int, height_px: int) -> Intrinsics:
        if first.intrinsics is not None and self._focal_px is None:
            return first.intrinsics
        return choose(width_px, height_px, camera=self.name, focal_px=self._focal_px, store=self._store)


def video_moments(path: Path) -> Moments:
    """A video file's pictures at its own rate (30/s where it tells none)."""

    def moments() -> Iterator[Moment]:
        capture = cv2.VideoCapture(str(path))
        if not capture.isOpened():
            raise HardwareError(f"The video {path} can't be opened: it is missing, damaged or cut off; choose another.")
        rate = capture.get(cv2.CAP_PROP_FPS)
        period_ns = 1e9 / (rate if 0 < rate <= 1000 else 30.0)
        number = 0
        try:
            while True:
                there, image = capture.read()
                if not there:
                    return
                yield Moment(offset_ns=round(number * period_ns), image_bgr=np.asarray(image, np.uint8))
                number += 1
        finally:
            capture.release()

    return moments


def folder_moments(folder: Path, rate_hz: float = 30.0) -> Moments:
    """A folder's pictures by name, at the given rate. An unreadable one ends with HardwareError naming it."""

    def moments() -> Iterator[Moment]:
        for number, path in enumerate(picture_files(folder)):
            yield Moment(offset_ns=round(number * 1e9 / rate_hz), image_bgr=read_picture(path))

    return moments


def picture_files(folder: Path) -> list[Path]:
    """The pictures in a folder, by name. Raises HardwareError when there are none."""
    if not folder.is_dir():
        raise HardwareError(f"The folder {folder} does not exist: give a folder of pictures.")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)
    if not files:
        raise HardwareError(f"The folder {folder} holds no pictures ({', '.join(sorted(PICTURES))}).")
    return files


def read_picture(path: Path) -> ImageArray:
    """(height, width, 3) uint8. Raises HardwareError naming the file."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise HardwareError(f"The picture {path} can't be read: it is missing, damaged or cut off.")
    return np.asarray(image, dtype=np.uint8)


def _wait_until(due_ns: int, timeout_s: float) -> bool:
    """Sleep until then, or for the time-out; whether it has come."""
    wait_s = (due_ns - time.monotonic_ns()) / 1e9
    if wait_s > timeout_s:
        time.sleep(timeout_s)
        return False
    if wait_s > 0:
        time.sleep(wait_s)
    return True


def _turned(depth_m: DepthArray | None) -> DepthArray | None:
    return None if depth_m is None else np.ascontiguousarray(depth_m[:, ::-1])
