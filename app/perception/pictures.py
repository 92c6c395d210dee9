"""The camera's pictures for the recording, with the patient's consent: made smaller and encoded in a thread of its own.

Perception hands a frame over and goes on: what comes while the thread is busy, or
the queue is full, is lost and counted.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from queue import Full, Queue
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from app.ipc.recording import Picture
from app.ipc.streams import PICTURES, LinkDirectory
from app.recording.sink import RecordingSink
from app.system.scheduling import set_scheduling
from hal.cameras.camera import DepthArray, Frame, ImageArray

RATE_HZ = 10.0
WIDTH_PX = 640
JPEG_QUALITY = 75
QUEUE = 20  # pictures: 2 s
END_S = 0.5
_PERIOD_NS = int(1e9 / RATE_HZ)


class PictureRecorder:
    """Off until it is switched on."""

    def __init__(self, links: LinkDirectory) -> None:
        self.on = False
        self._sink = RecordingSink(links, PICTURES, queue=QUEUE)
        self._waiting: Queue[Frame | None] = Queue(maxsize=1)
        self._lost = 0
        self._incarnation = time.monotonic_ns() // 1_000_000
        self._next_ns = 0
        self._thread = threading.Thread(target=self._run, name="picture encoder", daemon=True)
        self._thread.start()

    def take(self, frame: Frame) -> None:
        """Hand a frame over, if one is due. Never waits."""
        if not self.on or frame.captured_ns < self._next_ns:
            return
        behind = frame.captured_ns - self._next_ns > _PERIOD_NS
        self._next_ns = (frame.captured_ns if behind else self._next_ns) + _PERIOD_NS
        try:
            self._waiting.put_nowait(frame)
        except Full:
            self._lost += 1

    def close(self) -> None:
        """Finish the picture at hand; a thread that is stuck or gone does not keep perception from its end."""
        self.on = False
        with suppress(Full):
            self._waiting.put(None, timeout=END_S)
        self._thread.join(END_S)
        self._sink.close()

    def _run(self) -> None:
        set_scheduling("recording")
        while (frame := self._waiting.get()) is not None:
            self._sink.send(encode(frame, self._lost + self._sink.lost, self._incarnation))


def encode(frame: Frame, lost: int = 0, incarnation: int = 0) -> Picture:
    """A frame as it is recorded: JPEG, and depth as PNG, both at most WIDTH_PX wide."""
    return Picture(
        captured_ns=frame.captured_ns,
        image_jpeg=_encoded(".jpg", _smaller(frame.image_bgr, cv2.INTER_AREA), cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY),
        depth_png=b"" if frame.depth_m is None else _encoded(".png", _millimetres(frame.depth_m)),
        lost=lost,
        incarnation=incarnation,
    )


def _millimetres(depth_m: DepthArray) -> NDArray[np.uint16]:
    """Holes stay holes: no value is made of its neighbours."""
    depth_mm = np.clip(np.rint(_smaller(depth_m, cv2.INTER_NEAREST) * 1000.0), 0, np.iinfo(np.uint16).max)
    return np.asarray(depth_mm, np.uint16)


def _smaller(image: ImageArray | DepthArray, interpolation: int) -> NDArray[Any]:
    height, width = image.shape[:2]
    scale = min(1.0, WIDTH_PX / width)
    return np.asarray(cv2.resize(image, (round(width * scale), round(height * scale)), interpolation=interpolation))


def _encoded(suffix: str, image: NDArray[Any], *parameters: int) -> bytes:
    done, data = cv2.imencode(suffix, image, parameters)
    assert done, "OpenCV encodes any image of 8 or 16 bits"
    return data.tobytes()
