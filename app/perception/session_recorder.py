"""Records a session's frames when the operator has noted the patient's consent; both go into the audit trail."""

from __future__ import annotations

import time

from app.audit.sink import AuditSink
from app.ipc.messages import PerceptionCommand
from app.system.config import SessionSetup
from app.system.paths import Home
from hal.cameras.camera import Frame
from hal.cameras.recording import Recorder
from hal.errors import HardwareError
from logs import records


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
