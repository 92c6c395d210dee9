"""Finite sources as a Camera: a video file, a folder of images."""

from __future__ import annotations

import os
import re
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from hal.cameras.camera import EndOfRecording, Frame, ImageArray, Intrinsics
from hal.cameras.intrinsics import check_size, choose
from hal.errors import CameraFault, HardwareError, RecordingFault
from logs.reading.errors import cause_of
from logs.reading.regular import MAX_IMAGE, read_bytes

MAX_PIXELS = 100_000_000  # of an image: 300 MB decoded; a file of a megabyte can claim a thousand times as many
Image.MAX_IMAGE_PIXELS = None  # Pillow's own limit warns; here it only reads headers
NS_PER_MS = 1_000_000
PNG_HEADER = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"  # the first chunk's name included: the size follows (W3C PNG, 11.2.1)
IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff"})


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFrame:
    """One recorded image. offset_ns: since the first."""

    offset_ns: int
    image_bgr: ImageArray


FrameSource = Callable[[], Iterator[RecordedFrame]]


class PlaybackCamera:
    """Plays images back at the pace they were recorded, or as fast as they are read; slower where it can't decode so.

    Captured times are of this host's clock now: for the chain a recording is a live camera.
    """

    def __init__(
        self,
        path: Path,
        source: FrameSource,
        *,
        focal_px: float | None = None,
        focal_size_px: tuple[int, int] | None = None,
        mirrored: bool = False,
        paced: bool = True,
        store: Path | None = None,
    ) -> None:
        """source: starts it anew; raises HardwareError when it can't be read. paced: as it was recorded.

        focal_size_px: width and height of the images that `focal_px` is of; None: of the recording's.
        """
        self._path = path
        self._source = source
        self._focal_px = focal_px
        self._focal_size_px = focal_size_px
        self._mirrored = mirrored
        self._paced = paced
        self._store = store
        self._pending: Iterator[RecordedFrame] | None = None
        self._next: RecordedFrame | None = None
        self._error: HardwareError | None = None  # of what comes after `_next`
        self._started_ns = 0
        self._sequence = 0
        self._intrinsics: Intrinsics | None = None

    @property
    def name(self) -> str:
        return self._path.name

    @property
    def finite(self) -> bool:
        return True

    def open(self) -> None:
        """Start from the beginning. Raises HardwareError without one readable image."""
        self._pending, self._error = self._source(), None
        self._next = next(self._pending, None)
        if self._next is None:
            raise HardwareError(RecordingFault.EMPTY, path=self._path)
        height, width = self._next.image_bgr.shape[:2]
        self._intrinsics = choose(
            width,
            height,
            camera=self.name,
            focal_px=self._focal_px,
            focal_size_px=self._focal_size_px,
            store=self._store,
        )
        self._started_ns = time.monotonic_ns()
        self._sequence = 0

    def read(self, timeout_s: float) -> Frame | None:
        """The next image; paced, when it is due, and the newest that is. Raises EndOfRecording after the last one."""
        if self._pending is None or self._intrinsics is None:
            raise HardwareError(CameraFault.NOT_OPEN, camera=self.name)
        frame = self._next
        if frame is None:
            raise self._error or EndOfRecording()
        if self._paced and not _wait_until(self._due_ns(frame), timeout_s):
            return None
        begun_ns = time.monotonic_ns()
        limit_ns = begun_ns + round(timeout_s * 1e9)
        self._next = self._read_ahead(self._pending)
        while self._paced and self._next is not None and self._due_ns(self._next) <= (now_ns := time.monotonic_ns()):
            # Where decoding alone is slower than the video, skipping gains nothing: it plays slower, as of now.
            if now_ns >= limit_ns or now_ns - begun_ns > self._next.offset_ns - frame.offset_ns:
                self._started_ns += now_ns - self._due_ns(self._next)
                break
            frame, begun_ns = self._next, now_ns
            self._next = self._read_ahead(self._pending)
        height, width = frame.image_bgr.shape[:2]
        check_size(self._intrinsics, width, height, self.name)
        self._sequence += 1
        return Frame(
            image_bgr=np.asarray(cv2.flip(frame.image_bgr, 1), np.uint8) if self._mirrored else frame.image_bgr,
            captured_ns=self._due_ns(frame),
            sequence=self._sequence,
            intrinsics=self._intrinsics,
        )

    def close(self) -> None:
        self._pending = self._next = None

    def _read_ahead(self, pending: Iterator[RecordedFrame]) -> RecordedFrame | None:
        """The image after the next, None without one: why is kept until the next one is given."""
        try:
            return next(pending, None)
        except HardwareError as error:
            self._error = error
            return None

    def _due_ns(self, frame: RecordedFrame) -> int:
        return self._started_ns + frame.offset_ns


def open_video(path: Path) -> cv2.VideoCapture | None:
    """A video file, None when it is none; never a pattern, a device or an address, as a relative `10:30.mp4` is."""
    file = os.path.isfile(path)  # noqa: PTH113 - that of pathlib raises for what may not be looked at
    capture = cv2.VideoCapture(str(path.absolute())) if file else None
    return capture if capture is not None and capture.isOpened() else None


def frame_period_ns(video: cv2.VideoCapture) -> int:
    """At the video's own rate; at 30/s where it has none, or one that is its clock's (Matroska's: milliseconds)."""
    rate_hz = video.get(cv2.CAP_PROP_FPS)
    return round(1e9 / (rate_hz if 0 < rate_hz < 1000 else 30.0))


def video_source(path: Path) -> FrameSource:
    """A video file's images by their own times, where it has any: those of telephones and browsers come unevenly."""

    def source() -> Iterator[RecordedFrame]:
        capture = open_video(path)
        if capture is None:
            raise HardwareError(RecordingFault.VIDEO_UNREADABLE, path=path)
        if capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT) > MAX_PIXELS:
            raise HardwareError(RecordingFault.VIDEO_UNREADABLE, path=path)
        period_ns = frame_period_ns(capture)  # at most: the shortest time between two images so far
        offset_ns = -period_ns
        try:
            while True:
                there, image = capture.read()
                if not there:
                    return
                stamp_ns = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
                if stamp_ns - offset_ns > NS_PER_MS:
                    period_ns, offset_ns = min(period_ns, stamp_ns - offset_ns), stamp_ns
                else:
                    offset_ns += period_ns
                yield RecordedFrame(offset_ns=offset_ns, image_bgr=np.asarray(image, np.uint8))
        finally:
            capture.release()

    return source


def folder_source(folder: Path, rate_hz: float = 30.0) -> FrameSource:
    """A folder's images by name, at the given rate. An unreadable one ends with HardwareError naming it."""

    def source() -> Iterator[RecordedFrame]:
        for number, path in enumerate(image_files(folder)):
            yield RecordedFrame(offset_ns=round(number * 1e9 / rate_hz), image_bgr=read_image(path))

    return source


def image_files(folder: Path) -> list[Path]:
    """The images in a folder, by name: 2 before 10. Raises HardwareError when there are none, or it may not be read."""
    if not os.path.isdir(folder):  # noqa: PTH112 - that of pathlib raises for what may not be looked at
        raise HardwareError(RecordingFault.FOLDER_NOT_FOUND, path=folder)
    try:
        files = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    except OSError as error:
        raise HardwareError(RecordingFault.FOLDER_UNREADABLE, path=folder, detail=cause_of(error)) from error
    if not files:
        raise HardwareError(RecordingFault.FOLDER_EMPTY, path=folder, known=", ".join(sorted(IMAGE_SUFFIXES)))
    return sorted(files, key=_by_number)


def _by_number(path: Path) -> tuple[list[tuple[int, str]], str]:
    """A name's words and numbers in turn, then the name itself: 1 and 01 keep one order."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts], path.name


def read_image(path: Path) -> ImageArray:
    """(height, width, 3) uint8. Raises HardwareError naming the file."""
    image = decode_image(path, cv2.IMREAD_COLOR)
    if image is None:
        raise HardwareError(RecordingFault.IMAGE_UNREADABLE, path=path)
    return np.asarray(image, dtype=np.uint8)


def decode_image(path: Path, flags: int) -> NDArray[Any] | None:
    """A regular file decoded by OpenCV, None when that can't be done, or would take gigabytes."""
    try:
        data = read_bytes(path, MAX_IMAGE)
        if pixels_of(data) > MAX_PIXELS:
            return None
        image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except (OSError, ValueError, cv2.error, MemoryError):
        return None
    return image


def pixels_of(data: bytes) -> int:
    """Width times height as an image's header claims them. Raises OSError when it is no image."""
    if data.startswith(PNG_HEADER):  # Pillow reads on to the pixels, and refuses text or a colour profile above 1 MB
        width, height = struct.unpack_from(">II", data.ljust(len(PNG_HEADER) + 8, b"\0"), len(PNG_HEADER))
        return int(width * height)
    with Image.open(BytesIO(data), formats=("BMP", "JPEG", "PNG", "TIFF", "WEBP")) as image:
        return image.width * image.height


def _wait_until(due_ns: int, timeout_s: float) -> bool:
    """Sleep until then, or for the time-out; whether it has come."""
    wait_s = (due_ns - time.monotonic_ns()) / 1e9
    if wait_s > timeout_s:
        time.sleep(timeout_s)
        return False
    if wait_s > 0:
        time.sleep(wait_s)
    return True
