"""The camera of a session: supervised, recorded where the patient consents, its images checked for light and focus."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

from app.audit.sink import AuditSink
from app.ipc.messages import HandCommand, PerceptionCommand
from app.system.config import SessionSetup
from app.system.diagnostics_log import get_logger
from app.system.paths import Home
from hal.cameras.camera import Camera, CommandedHand, EndOfRecording, Frame
from hal.cameras.exposure import image_fault
from hal.cameras.recording import Recorder
from hal.errors import HardwareError, RecordingFault
from logs import records
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
    FRAMES_DROPPED = "frames dropped"  # count
    FRAMES_DROPPED_BY_FAULT = "frames dropped by fault"  # count, fault


@dataclass(slots=True)
class CameraSupervisor:
    """Frames from a camera that may be unplugged: closed when it fails, opened again with a growing pause.

    fault: why no frames come, None while they do.
    """

    camera: Camera
    on_fault: Callable[[Reason], None] = field(default=lambda _: None)
    fault: Reason | None = None
    ended: bool = False
    _open: bool = False
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
        _log.info("camera opened", camera=self.camera.name)
        return True

    def _lost(self, now_s: float, fault: Reason) -> None:
        self.close()
        self._next_try_s = now_s + BACK_OFF_S[min(self._failures, len(BACK_OFF_S) - 1)]
        self._failures += 1
        if fault != self.fault:
            _log.warning("camera lost", camera=self.camera.name, code=fault.code, values=fault.values)
            self.on_fault(fault)
        self.fault = fault


class SessionRecorder:
    """Records frames once the operator has noted the patient's consent; each recording has a folder of its own."""

    def __init__(self, setup: SessionSetup, sink: AuditSink, camera: str) -> None:
        self._setup = setup
        self._sink = sink
        self._camera = camera
        self._recorder: Recorder | None = None

    def handle(self, command: PerceptionCommand) -> None:
        """Begin or end recording. To begin is to state that the patient has consented (the console asks)."""
        if command.record is True and self._recorder is None:
            self._begin()
        elif command.record is False:
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
        if recorder.fault:
            dropped = reason(PerceptionNote.FRAMES_DROPPED_BY_FAULT, count=recorder.dropped, fault=recorder.fault)
            self._sink.emit(records.Note(text=dropped))
        elif recorder.dropped:
            self._sink.emit(records.Note(text=reason(PerceptionNote.FRAMES_DROPPED, count=recorder.dropped)))

    def _begin(self) -> None:
        folder = Home(self._setup.home).recordings / f"{self._setup.session}-{time.strftime('%H%M%S', time.gmtime())}"
        try:
            self._recorder = Recorder(folder, self._camera)
        except HardwareError as error:
            self._sink.emit(records.Note(text=reason_of(error)))
            return
        self._sink.emit(records.Recording(on=True, consent=True, path=folder.name))


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
