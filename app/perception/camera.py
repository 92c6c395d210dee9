"""Keeps a camera open: what breaks is closed, told in a sentence, and opened again with a growing pause."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from app.audit.sink import AuditSink
from app.ipc.messages import HandCommand, PerceptionCommand
from app.system.config import SessionSetup
from app.system.paths import Home
from hal.cameras.camera import Camera, CommandedHand, EndOfRecording, Frame
from hal.cameras.exposure import ImageFault, image_fault
from hal.cameras.recording import Recorder
from hal.errors import HardwareError, RecordingFault
from logs import records
from logs.reason import Reason, reason, reason_of

BACK_OFF_S = (0.2, 0.5, 1.0, 2.0, 4.0)


@dataclass(slots=True)
class CameraKeeper:
    """Frames from a camera that may be unplugged. `fault`: why nothing comes."""

    camera: Camera
    fault: Reason | None = None
    ended: bool = False
    _open: bool = False
    _failures: int = 0
    _next_try_s: float = 0.0
    on_fault: Callable[[Reason], None] = field(default=lambda _: None)

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
            self._lost(now_s, reason_of(error))
            return None
        if frame is not None:
            self.fault, self._failures = None, 0
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
            self._lost(now_s, reason_of(error))
            return False
        self._open = True
        return True

    def _lost(self, now_s: float, why: Reason) -> None:
        self.close()
        self._next_try_s = now_s + BACK_OFF_S[min(self._failures, len(BACK_OFF_S) - 1)]
        self._failures += 1
        if why != self.fault:
            self.on_fault(why)
        self.fault = why


class SessionRecorder:
    """Off until asked; a folder of its own every time it is switched on."""

    def __init__(self, setup: SessionSetup, sink: AuditSink, camera: str) -> None:
        self._setup = setup
        self._sink = sink
        self._camera = camera
        self._recorder: Recorder | None = None

    def handle(self, wish: PerceptionCommand) -> None:
        """Begin or end recording. To begin is to state that the patient has consented (the console asks)."""
        if wish.record is True and self._recorder is None:
            self._begin()
        elif wish.record is False:
            self.close()

    def take(self, frame: Frame) -> None:
        """Keep a frame, where recording is on."""
        if self._recorder is not None:
            self._recorder.write(frame)

    def close(self) -> None:
        """End the recording, if any; how much of it is missing goes into the trail."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        recorder.close()
        self._sink.emit(records.Recording(on=False, consent=True, path=recorder.folder.name))
        if recorder.dropped or recorder.fault:
            said = f"{recorder.dropped} frames of the recording were dropped. {recorder.fault}".strip()
            self._sink.emit(records.Note(text=said))

    def _begin(self) -> None:
        folder = Home(self._setup.home).recordings / f"{self._setup.session}-{time.strftime('%H%M%S', time.gmtime())}"
        try:
            self._recorder = Recorder(folder, self._camera)
        except HardwareError as error:
            self._sink.emit(records.Note(text=str(error)))
            return
        self._sink.emit(records.Recording(on=True, consent=True, path=folder.name))


def steer(camera: Camera, command: HandCommand) -> None:
    """Pass a command on to the digital hand. Raises HardwareError for what it can't do."""
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


LOOK_NS = 500_000_000
LASTING = 3  # looks in a row: a hand that covers the lens for a moment is not a dark room


@dataclass(slots=True)
class PictureHints:
    """Remembers the last looks."""

    fault: ImageFault | None = None
    _newest: ImageFault | None = None
    _count: int = 0
    _next_ns: int = 0

    def of(self, frame: Frame) -> Reason | None:
        """The fault in force after this frame; None when the image is good."""
        if frame.captured_ns < self._next_ns:
            return self._reason()
        self._next_ns = frame.captured_ns + LOOK_NS
        now = image_fault(frame.image_bgr)
        self._count = self._count + 1 if now == self._newest else 1
        self._newest = now
        if self._count >= LASTING:
            self.fault = now
        return self._reason()

    def _reason(self) -> Reason | None:
        return None if self.fault is None else reason(self.fault)
