"""The perception process: camera → pipeline → report, and the image for the screen. A thin shell.

Every frame ends in one sent report, also when there is no hand, no model yet or no camera: silence means that this
process is gone, and control treats it so. Between two frames of a slow camera the last report is sent again.
"""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from contextlib import closing

from app.audit.sink import AuditSink
from app.ipc import streams as processes
from app.ipc.links import OrderedReceiver, Publisher, address
from app.ipc.messages import HandCommand, PerceptionCommand, TriggerReport
from app.ipc.states import Event
from app.perception import pipeline as assembly
from app.perception.camera import CameraSupervisor, ImageCheck, PerceptionNote, move_hand
from app.perception.frames import DecisionRecorder, button_record
from app.perception.pipeline import Loading
from app.perception.recording import PictureRecorder, ReportRecorder
from app.perception.reporting import (
    FPS_WINDOW,
    MeasuredRate,
    PreviewPacer,
    Scale,
    frames_per_second,
    with_counts,
    with_report,
)
from app.system.config import SessionSetup
from app.system.scheduling import avoid_control_core, gc_freeze, set_scheduling
from hal.cameras.camera import Frame, Intrinsics
from kgdfa.button_state import STALE_NS, ButtonMode, ButtonPlace
from kgdfa.draw import draw
from kgdfa.errors import KgdfaError
from kgdfa.pipeline import Pipeline, PipelineInput, Report
from kgdfa.press_zone import PressZone
from logs.reason import Reason, reason, reason_of
from logs.records import EventRaised, ProcessEnd, ProcessStart

FRAME_TIMEOUT_S = 0.1
RATE_AFTER_NS = 5_000_000_000  # of frames: then the camera's measured rate is recorded
LOADING = reason(PerceptionNote.MODEL_LOADING)


def run_perception(setup: SessionSetup) -> None:
    """Run until the session ends, its process dies, or SIGTERM."""
    # Both before any thread starts: they inherit it.
    set_scheduling("perception")
    avoid_control_core(setup.config.control_core)
    with closing(Perception(setup)) as perception:
        signal.signal(signal.SIGTERM, lambda *_: perception.end())
        perception.run()


class Perception:
    """Owns the camera and the pipeline; its links are its only outputs."""

    def __init__(self, setup: SessionSetup) -> None:
        links = setup.links
        self._setup = setup
        self._sink = AuditSink(links, "perception", setup.operator)
        self._reports = Publisher(address(links, processes.TRIGGER.name))
        self._previews = Publisher(address(links, processes.PREVIEW.name))
        self._commands: OrderedReceiver[HandCommand | PerceptionCommand] = OrderedReceiver(
            address(links, processes.TO_PERCEPTION.name), HandCommand | PerceptionCommand
        )
        self._links = (self._reports, self._previews, self._commands)
        self._recording = ReportRecorder(links) if setup.config.recording.on else None
        self._pictures = PictureRecorder(links) if setup.config.recording.on else None
        self._camera = CameraSupervisor(assembly.make_camera(setup), on_fault=self._record_fault)
        self._detector = Loading(lambda: assembly.make_detector(setup))
        self._pipeline: Pipeline | None = None
        self._place: ButtonPlace | None = None
        self._hint: Reason | None = LOADING
        self._zone: PressZone | None = None
        self._ready = False
        self._image_check = ImageCheck()
        self._pacer = PreviewPacer()
        self._incarnation = time.monotonic_ns() // 1_000_000
        self._sequence = 0
        self._captures: deque[int] = deque(maxlen=FPS_WINDOW + 1)
        self._decisions: DecisionRecorder | None = None
        self._scale: Scale | None = None
        self._rate = MeasuredRate()
        self._frame: Frame | None = None  # the newest: it carries the intrinsics
        self._last: Report | None = None
        self._lens: tuple[str, Intrinsics] | None = None  # the camera that the pipeline is built for
        self._openings = 0
        self._last_captured_ns = 0
        self._ending = False

    def run(self) -> None:
        """Frame after frame."""
        self._sink.emit(ProcessStart(pid=os.getpid()))
        while not (self._ending or self._setup.orphaned):
            self._handle_commands()
            frame = self._camera.read(time.monotonic(), FRAME_TIMEOUT_S)
            if frame is not None or self._camera.fault:  # while there is no camera, there is time to load
                self._detector.begin()
            if frame is None:
                self._send_report(self._report_in_force(), self._last_captured_ns)
                if self._camera.fault:  # a closed camera returns at once: ten reports a second suffice
                    time.sleep(FRAME_TIMEOUT_S)
            else:
                self._take(frame)

    def end(self) -> None:
        """Finish the running frame and leave."""
        self._ending = True

    def close(self) -> None:
        """Release everything; the camera first, since others wait for it."""
        self._camera.close()
        self._detector.close()
        self._end_decisions()
        if self._recording is not None:
            self._sink.emit(self._recording.close())
        self._sink.emit(ProcessEnd(pid=os.getpid()))
        if self._pictures is not None:
            self._pictures.close()
        self._sink.close()
        for link in self._links:
            link.close()

    def _report_in_force(self) -> Report | None:
        """Between two frames of a slow camera the last one's; None once it has paused, as the button takes it."""
        paused = time.monotonic_ns() - self._last_captured_ns > STALE_NS
        return None if paused or self._camera.fault else self._last

    def _handle_commands(self) -> None:
        while (command := self._commands.receive()) is not None:
            if isinstance(command, HandCommand):
                move_hand(self._camera.camera, command)
            else:
                self._pacer.configure(command)
                if self._pictures is not None and command.record_pictures is not None:
                    self._pictures.on = command.record_pictures
        peers = sum(link.foreign_peers() for link in self._links)
        if peers:
            text = reason(Event.FOREIGN_PEER, count=peers)
            self._sink.emit(EventRaised(event=Event.FOREIGN_PEER.value, effect="note", text=text))

    def _end_decisions(self) -> None:
        self._record_rate()
        for record in self._decisions.end() if self._decisions else ():
            self._sink.emit(record)

    def _take(self, frame: Frame) -> None:
        self._check_camera(frame)
        self._last_captured_ns = frame.captured_ns
        self._captures.append(frame.captured_ns)
        loaded = self._detector.ready() is not None
        report = self._process(frame)
        self._send_report(report, frame.captured_ns)
        # From the next frame on: the first is late, since the pipeline is built in it. A lens may allow no pipeline.
        self._ready = loaded or report is not None
        if report is not None:
            self._last = report
            assert self._decisions is not None  # made with the pipeline
            for record in self._decisions.take(report):
                self._sink.emit(record)
            self._measure_rate(frame)
        if self._pictures is not None:
            self._pictures.take(frame)
        if self._pacer.due(time.monotonic_ns()):
            self._send_preview(frame, report)

    def _check_camera(self, frame: Frame) -> None:
        """Begin anew when the camera came back as another one, or with another lens or image size.

        Distances by the old lens would be wrong by as much as the images are larger. The new incarnation says that
        presses and releases are counted from 0 again.
        """
        lens = self._camera.camera.name, frame.intrinsics
        if self._openings != self._camera.openings and self._lens not in (None, lens):
            self._end_decisions()
            self._pipeline = self._place = self._zone = self._scale = self._decisions = self._last = self._frame = None
            self._rate, self._ready = MeasuredRate(), False
            self._captures.clear()
            self._incarnation = max(time.monotonic_ns() // 1_000_000, self._incarnation + 1)
        if self._openings != self._camera.openings:
            self._openings, self._lens = self._camera.openings, lens

    def _process(self, frame: Frame) -> Report | None:
        """The frame through the chain; None while the hand model is loading, and for a lens that makes no palm."""
        camera = self._camera.camera
        try:
            self._zone = self._zone or assembly.zone_for(self._setup, frame, camera.name)
        except KgdfaError as error:  # the palm was calibrated with another focal length
            before, self._hint = self._hint, reason_of(error)
            if self._hint != before:
                self._sink.emit(EventRaised(event="palm-impossible", effect="note", text=self._hint))
            return None
        self._hint = self._image_check.update(frame) or assembly.lasting_hint(
            self._setup, self._zone, frame, camera.name
        )
        detector = self._detector.ready()
        if detector is None:
            self._hint = LOADING
            return None
        if self._pipeline is None:
            self._pipeline, self._place = assembly.make_pipeline(self._setup, detector, frame, camera.name)
            self._scale = assembly.scale_of(self._setup, frame, camera.name)
            self._decisions = DecisionRecorder(self._scale)
            mode, choice = ButtonMode(self._setup.config.button.mode), assembly.choice_of(self._setup)
            setup = button_record(self._place, mode, choice)
            for record in (*assembly.camera_records(self._setup, camera.name, frame), setup):
                self._sink.emit(record)
            gc_freeze()
        source = PipelineInput(
            image_bgr=frame.image_bgr,
            captured_ns=frame.captured_ns,
            depth_m=frame.depth_m,
            depth_ns=frame.depth_ns,
        )
        return self._pipeline.process(source)

    def _measure_rate(self, frame: Frame) -> None:
        """Once after some seconds the camera is recorded again, with its measured rate; and at the end, see `close`."""
        self._frame = frame
        before_ns = self._rate.lasts_ns
        self._rate.add(frame.captured_ns, self._openings)
        if before_ns < RATE_AFTER_NS <= self._rate.lasts_ns:
            self._record_rate()

    def _record_rate(self) -> None:
        """Of the camera that the rate was measured with: another one may be open by now."""
        if self._frame is not None and self._lens is not None:
            record, _ = assembly.camera_records(self._setup, self._lens[0], self._frame, self._rate)
            self._sink.emit(record)

    def _send_report(self, report: Report | None, captured_ns: int) -> None:
        self._sequence += 1
        without_hand = TriggerReport(
            incarnation=self._incarnation,
            sequence=self._sequence,
            captured_ns=captured_ns,
            sent_ns=time.monotonic_ns(),
            hand=False,
            gesture=None,
            camera=self._camera.camera.name,
            threshold_m=self._setup.profile.press_threshold_m,
            fps=frames_per_second(list(self._captures)),
            camera_fault=self._camera.fault,
            hint=self._hint,
            detector_ready=self._ready,
            pictures_recorded=self._pictures is not None and self._pictures.on,
            focal_assumed=self._scale is not None and assembly.rests_on_assumption(self._scale),
            press_zone=self._zone,
        )
        message = with_report(without_hand, report) if report is not None else with_counts(without_hand, self._last)
        self._reports.send(message)
        if self._recording is not None:
            self._recording.take(message, report)

    def _send_preview(self, frame: Frame, report: Report | None) -> None:
        place = self._place
        drawn = None if report is None or place is None else lambda image, scale: draw(image, report, place, scale)
        self._previews.send(self._pacer.message(frame.image_bgr, frame.captured_ns, drawn))

    def _record_fault(self, fault: Reason) -> None:
        self._sink.emit(EventRaised(event="camera-lost", effect="note", text=fault))
