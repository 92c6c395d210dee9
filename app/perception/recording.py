"""What perception hands to the recording: each frame's report once, and with the patient's consent its pictures.

Perception hands a picture over and goes on: a thread makes it smaller and encodes it. What comes while that is busy, or
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
from msgspec.structs import replace
from numpy.typing import NDArray

from app.ipc.messages import TriggerReport
from app.ipc.recording import Picture
from app.ipc.streams import PICTURES, RECORDING, LinkDirectory
from app.perception.reporting import hand_frame
from app.recording.schemas import HAND_TOPICS
from app.recording.sink import RecordingSink
from app.system.scheduling import set_scheduling
from hal.cameras.camera import DepthArray, Frame, ImageArray
from kgdfa.button_state import STALE_NS
from kgdfa.pipeline import Report
from logs.records import RecordingSent

RATE_HZ = 10.0
WIDTH_PX = 640
JPEG_QUALITY = 75
QUEUE = 20  # pictures: 2 s
END_S = 0.5
_PERIOD_NS = int(1e9 / RATE_HZ)


class ReportRecorder:
    """Numbers what it hands over by itself, without gaps: the recording counts by it what was lost."""

    def __init__(self, links: LinkDirectory) -> None:
        self._sink = RecordingSink(links, RECORDING)
        self._number = 0
        self._captured_ns = 0  # of the newest frame
        self._paused = False

    def take(self, message: TriggerReport, report: Report | None) -> None:
        """One sent report. Between two frames only the first without a hand is new; it has its own time, no capture."""
        if message.captured_ns != self._captured_ns:
            self._captured_ns, self._paused = message.captured_ns, report is None
        elif report is not None or self._paused:
            return
        else:
            self._paused = True
            # Not later than the button counts a pause: the next frame may be captured before this report is sent.
            stale_ns = self._captured_ns + STALE_NS if self._captured_ns else message.sent_ns
            message = replace(message, captured_ns=0, sent_ns=min(message.sent_ns, stale_ns))
        self._number += 1
        self._sink.send(hand_frame(replace(message, sequence=self._number), report, self._sink.lost))

    def close(self) -> RecordingSent:
        """Let what is queued leave; how much was made, lost included."""
        self._sink.close()
        return RecordingSent(messages=dict.fromkeys(HAND_TOPICS, self._number))


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
