"""Keeps a camera open: what breaks is closed, told in a sentence, and opened again with a growing pause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from hal.cameras.camera import Camera, EndOfRecording, Frame
from hal.errors import HardwareError

BACK_OFF_S = (0.2, 0.5, 1.0, 2.0, 4.0)


@dataclass(slots=True)
class CameraKeeper:
    """Frames from a camera that may be unplugged. `fault` is the sentence for people while nothing comes."""

    camera: Camera
    fault: str = ""
    ended: bool = False
    _open: bool = False
    _failures: int = 0
    _next_try_s: float = 0.0
    on_fault: Callable[[str], None] = field(default=lambda _: None)

    def read(self, now_s: float, timeout_s: float) -> Frame | None:
        """The next frame, or None: none in time, the camera is lost, or the recording has ended."""
        if self.ended or not self._opened(now_s):
            return None
        try:
            frame = self.camera.read(timeout_s)
        except EndOfRecording:
            self.ended, self.fault = True, "The recording has ended; choose another or start it again."
            return None
        except HardwareError as error:
            self._lost(now_s, str(error))
            return None
        if frame is not None:
            self.fault, self._failures = "", 0
        return frame

    def close(self) -> None:
        """Stop the camera."""
        if self._open:
            self.camera.close()
        self._open = False

    def _opened(self, now_s: float) -> bool:
        if self._open:
            return True
        if now_s < self._next_try_s:
            return False
        try:
            self.camera.open()
        except HardwareError as error:
            self._lost(now_s, str(error))
            return False
        self._open = True
        return True

    def _lost(self, now_s: float, why: str) -> None:
        self.close()
        self._next_try_s = now_s + BACK_OFF_S[min(self._failures, len(BACK_OFF_S) - 1)]
        self._failures += 1
        if why != self.fault:
            self.on_fault(why)
        self.fault = why
