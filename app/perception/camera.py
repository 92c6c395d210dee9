"""The camera of a session: supervised, its images checked for light and focus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

from app.ipc.messages import HandCommand
from app.system.diagnostics_log import get_logger
from hal.cameras.camera import Camera, CommandedHand, EndOfRecording, FiniteSource, Frame
from hal.cameras.exposure import image_fault
from hal.errors import HardwareError, RecordingFault
from logs.reason import Reason, reason, reason_of

_log = get_logger("camera")

BACK_OFF_S = (0.2, 0.5, 1.0, 2.0, 4.0)
CHECK_PERIOD_NS = 500_000_000
LASTING_CHECKS = 3  # in a row: a hand that covers the lens for a moment is not a dark room


class PerceptionNote(Enum):
    """What perception reports of its camera and model."""

    MODEL_LOADING = "model loading"
    THRESHOLD_UNSUITED = "threshold unsuited"  # threshold_m, zone: the press zone's explanation
    NO_DEPTH = "no depth"  # camera: the patient commands by depth
    CALIBRATION_UNUSED = "calibration unused"  # camera: it gives images of another shape or size than were calibrated


@dataclass(slots=True)
class CameraSupervisor:
    """Frames from a camera that may be unplugged: closed when it fails, opened again with a growing pause.

    fault: why no frames come, None while they do. openings: how often it was opened. A recording that fails has ended:
    opened again, it would repeat its gestures.
    """

    camera: Camera
    on_fault: Callable[[Reason], None] = field(default=lambda _: None)
    fault: Reason | None = None
    ended: bool = False
    openings: int = 0
    _open: bool = False
    _failed: bool = False
    _failures: int = 0
    _next_try_s: float = 0.0

    def read(self, now_s: float, timeout_s: float) -> Frame | None:
        """The next frame, or None: none in time, the camera is lost, or the recording has ended."""
        if self.ended or not self._opened(now_s):
            return None
        try:
            frame = self.camera.read(timeout_s)
        except EndOfRecording:
            self.ended, self.fault = True, reason(RecordingFault.ENDED)
            return None
        except HardwareError as error:
            self.ended = isinstance(self.camera, FiniteSource) and self.camera.finite
            self._lost(now_s, reason_of(error))
            return None
        if frame is not None:
            self.fault, self._failures = None, 0
        return frame

    def close(self) -> None:
        """Stop the camera."""
        if self._open:
            self.camera.close()
        self._open = self._failed = False

    def _opened(self, now_s: float) -> bool:
        if self._open and not self._failed:
            return True
        self.close()  # not in `_lost`: a driver that hangs takes a second, and its fault is reported before
        if now_s < self._next_try_s:
            return False
        try:
            self.camera.open()
        except HardwareError as error:
            self._lost(now_s, reason_of(error))
            return False
        self._open = True
        self.openings += 1
        _log.info("camera opened", camera=self.camera.name)
        return True

    def _lost(self, now_s: float, fault: Reason) -> None:
        self._failed = True
        self._next_try_s = now_s + BACK_OFF_S[min(self._failures, len(BACK_OFF_S) - 1)]
        self._failures += 1
        if fault != self.fault:
            _log.warning("camera lost", camera=self.camera.name, code=fault.code, values=fault.values)
            self.on_fault(fault)
        self.fault = fault


def move_hand(camera: Camera, command: HandCommand) -> None:
    """Pass a command on to the digital hand; other cameras have none. Raises HardwareError for what it can't do."""
    if not isinstance(camera, CommandedHand):
        return
    shape = command.gesture or command.pose
    moved = (command.move_x_m, command.move_y_m, command.move_z_m)
    camera.command(
        gesture=shape.value if shape is not None else None,
        press=command.press,
        click_s=command.click_s,
        move_m=moved if any(moved) else None,
    )


@dataclass(slots=True)
class ImageCheck:
    """What is wrong with the images: checked twice a second, reported only when it lasts."""

    reported: Reason | None = None
    _found: Reason | None = None
    _count: int = 0
    _next_ns: int = 0

    def update(self, frame: Frame) -> Reason | None:
        """What is wrong as of this frame; None when the images are good."""
        if frame.captured_ns < self._next_ns:
            return self.reported
        self._next_ns = frame.captured_ns + CHECK_PERIOD_NS
        found = image_fault(frame.image_bgr)
        now = None if found is None else reason(found)
        self._count = self._count + 1 if now == self._found else 1
        self._found = now
        if self._count >= LASTING_CHECKS:
            self.reported = now
        return self.reported
