"""Webcams through OpenCV: opened by name or index, resolution and rate negotiated."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from hal.cameras.camera import LATE_NS, Frame, ImageArray, Intrinsics, LatestFrame, UsualDelay
from hal.cameras.intrinsics import choose
from hal.cameras.webcam_list import SYSFS, find_webcam, list_webcams
from hal.errors import CameraFault, HardwareError

COMPARED_ROWS = 8  # every eighth: no sensor gives the same noise in 90 rows twice
LONGEST_AGE_NS = 300_000_000_000  # by a stamp; an older image's stamp is of another clock, or none
AWAY_NS = 250_000_000  # between two images without stamps, more than usual; a button takes no more for one motion


class WebcamCamera:
    """A webcam, read in a thread."""

    def __init__(
        self,
        device: str = "",
        *,
        width_px: int = 1280,
        height_px: int = 720,
        rate_hz: float = 30.0,
        focal_px: float | None = None,
        mirrored: bool = False,
        store: Path | None = None,
        sysfs: Path = SYSFS,
    ) -> None:
        """mirrored: the camera delivers mirrored images; they are turned back. store: a cameras.toml."""
        self._device = device
        self._wanted = (width_px, height_px, rate_hz)
        self._focal_px = focal_px
        self._mirrored = mirrored
        self._store = store
        self._sysfs = sysfs
        self._capture: Any = None
        self._latest: LatestFrame[tuple[ImageArray, int]] | None = None
        self._intrinsics: Intrinsics | None = None
        self._sequence = 0
        self._before: ImageArray | None = None
        self._delay = UsualDelay()
        self._read_ns = 0  # when the newest image came; 0: none has
        self._name = device or "webcam"

    @property
    def name(self) -> str:
        return self._name

    def open(self) -> None:
        """Find and start it. Raises HardwareError when it is not there, busy, or not allowed."""
        entry = find_webcam(self._device, list_webcams(self._sysfs))
        self._name = entry.name
        capture = cv2.VideoCapture(entry.index, cv2.CAP_V4L2)
        if not capture.isOpened():
            capture.release()
            raise HardwareError(CameraFault.WEBCAM_BUSY, camera=entry.name, index=entry.index)
        self._capture = capture
        try:
            width, height = self._negotiate(capture)
            self._intrinsics = choose(
                width,
                height,
                camera=entry.name,
                focal_px=self._focal_px,
                focal_size_px=self._wanted[:2],
                store=self._store,
            )
        except HardwareError:
            self.close()
            raise
        self._delay, self._read_ns = UsualDelay(), 0
        self._latest = LatestFrame(self._grab, lost=HardwareError(CameraFault.NO_FRAMES, camera=entry.name))

    def read(self, timeout_s: float) -> Frame | None:
        """The newest image. Raises HardwareError when the camera is gone, silent, or sends another size than said."""
        if self._latest is None or self._intrinsics is None:
            raise HardwareError(CameraFault.NOT_OPEN, camera=self._name)
        taken = self._latest.take(timeout_s)
        if taken is None:
            return None
        image, captured_ns = taken
        lens, (height_px, width_px) = self._intrinsics, image.shape[:2]
        if (width_px, height_px) != (lens.width_px, lens.height_px):
            stated = {"width_px": lens.width_px, "height_px": lens.height_px}
            taken_px = {"image_width_px": width_px, "image_height_px": height_px}
            raise HardwareError(CameraFault.IMAGES_OTHER_SIZE, camera=self._name, **stated, **taken_px)
        self._sequence += 1
        return Frame(image_bgr=image, captured_ns=captured_ns, sequence=self._sequence, intrinsics=self._intrinsics)

    def close(self) -> None:
        ended = self._latest.stop() if self._latest is not None else True
        if self._capture is not None and ended:
            self._capture.release()
        self._latest = self._capture = None

    def _negotiate(self, capture: Any) -> tuple[int, int]:
        """Ask for the wanted mode; the size that the camera took instead, (width, height)."""
        width, height, rate = self._wanted
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))  # raw 720p does not fit into USB 2
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        capture.set(cv2.CAP_PROP_FPS, rate)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        return (int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))

    def _grab(self) -> tuple[ImageArray, int] | None:
        there, image = self._capture.read()
        captured_ns = time.monotonic_ns()
        if not there:
            raise HardwareError(CameraFault.UNPLUGGED, camera=self._name)
        late = self._is_late(captured_ns)
        before, self._before = self._before, image
        if before is not None and np.array_equal(image[::COMPARED_ROWS], before[::COMPARED_ROWS]):
            return None  # a camera that hangs repeats its last image: the hand in it may have gone
        return None if late else ((cv2.flip(image, 1) if self._mirrored else image), captured_ns)

    def _is_late(self, captured_ns: int) -> bool:
        """Whether the image may be from before this process stood still: V4L2 fills its one buffer and then waits.

        OpenCV gives the buffer's own stamp, of CLOCK_MONOTONIC (uvcvideo's default) at the image's first packet.
        """
        before_ns, self._read_ns = self._read_ns, captured_ns
        stamp_ns = round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        age_ns = captured_ns - stamp_ns
        if stamp_ns > 0 and 0 <= age_ns < LONGEST_AGE_NS:
            late = self._delay.exceeded(age_ns, captured_ns)
            return late or (not before_ns and age_ns > LATE_NS)
        return bool(before_ns) and self._delay.exceeded(captured_ns - before_ns, captured_ns, AWAY_NS)
