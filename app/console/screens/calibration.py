"""Guided palm calibration: the picture, hints, the count, the result with its residual; saved when you keep it."""

from __future__ import annotations

import math
import shutil
import time
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import Input, Label, Static

from app.console.patient_fields import half_width
from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import Wording, ask
from app.console.state import SessionState
from app.console.widgets.panel import bar
from app.console.widgets.picture import Picture
from app.console.worker import Worker
from app.ipc.messages import Preview
from app.session.setup import make_setup
from app.system.config import SessionSetup
from app.system.diagnostics_log import discard_output
from app.system.operators import Permission
from app.text.catalogue import render, tr
from hal.errors import HardwareError
from kgdfa.errors import KgdfaError
from logs.reason import Reason, reason, reason_of
from logs.records import Calibration as CalibrationRecord
from profiles.palm import DISTANCE_RANGE_M, Calibrated, ReferenceSource, with_calibration
from profiles.schema import Profile
from profiles.store import ChangeCause

if TYPE_CHECKING:
    from hal.cameras.camera import Frame

DEFAULT_CM = {"digital-hand": "36"}  # where the digital hand rests
NEAREST_CM, FARTHEST_CM = (100.0 * limit_m for limit_m in DISTANCE_RANGE_M)
BAR_CELLS = 20
PREVIEW_PX = 160
PREVIEW_HZ = 10.0


class CalibrationScreen(ConsoleScreen):
    """Enter in the distance begins, Ctrl-S keeps, Escape leaves; a result is of the distance that it began with."""

    HELP_PAGE = "calibration"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "keep", "bind.calibration.keep"),
        Binding("escape", "dismiss", "bind.start.back"),  # what was not kept is lost
    ]

    def __init__(self, profile: Profile) -> None:
        super().__init__()
        self._profile = profile
        self._worker: Worker | None = None
        self._result: Calibrated | None = None
        self._begun: str | None = None  # the distance as typed for what runs or has ended; None: nothing has begun
        self._progress: Wording = lambda: tr("calibration.begin")

    def compose(self) -> ComposeResult:
        yield Label(tr("calibration.title", name=self._profile.identifier), id="title")
        with Horizontal(id="training"):
            with Vertical(id="seen"):
                yield Picture(id="picture")
            with Vertical(id="wanted"):
                yield Static(tr("calibration.text"), markup=False)
                start = DEFAULT_CM.get(self.console_app.config.camera.kind, "30")
                yield Input(start if self._begun is None else self._begun, id="measured", max_length=8)
                yield Static(id="progress", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.fill()
        self.query_one("#measured").focus()

    def fill(self) -> None:
        """How far it is, or what came of it."""
        self._show(self._progress)

    def on_unmount(self) -> None:
        self._end_child()

    def on_input_changed(self, event: Input.Changed) -> None:
        self._give_up_unless(event.value)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Begin, at the typed distance."""
        try:
            distance_cm = float(half_width(event.value).replace("cm", "").replace(",", "."))
        except ValueError:
            distance_cm = math.nan
        if not NEAREST_CM <= distance_cm <= FARTHEST_CM:
            self._show(lambda: tr("calibration.distance", least_cm=NEAREST_CM, most_cm=FARTHEST_CM))
            return
        self._begun = event.value
        with self.notify_errors():
            self._begin(distance_cm / 100)

    def keep(self) -> bool:
        return self._result is None

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        try:
            while self._worker is not None and self._worker.pipe.poll():
                self._receive(self._worker.pipe.recv())
        except EOFError:
            self._end_child()
            if self._result is None:
                self._show(lambda: tr("calibration.died"))

    def action_keep(self) -> None:
        """Into the profile; an implausible one only after a question."""
        self._give_up_unless(self.query_one("#measured", Input).value)
        if self._result is None:
            self._show(lambda: tr("calibration.nothing"))
        elif doubt := self._result.doubt:
            ask(self.app, lambda: tr("calibration.keep_title"), lambda: render(doubt), self._keep)
        else:
            self._keep()

    def _give_up_unless(self, typed: str) -> None:
        """The distance that a measurement began with is part of it: where another one is typed, it must begin anew."""
        if self._begun in (None, typed):
            return
        self._end_child()
        self._result = self._begun = None
        self._show(lambda: tr("calibration.begin"))

    def _begin(self, distance_m: float) -> None:
        self._end_child()
        self._result = None
        app = self.console_app
        setup = make_setup(app.home, app.config, self._profile, app.signed_in, Permission.CALIBRATE)
        shutil.rmtree(setup.links)  # no session: nobody needs its sockets
        try:
            self._worker = Worker(calibrate_palm, setup, distance_m)
        except OSError:
            self._show(lambda: tr("calibration.died"))
            raise
        self._show(lambda: tr("calibration.starting"))

    def _receive(self, message: Progress | Preview | Calibrated | Reason) -> None:
        match message:
            case Preview():
                self.query_one(Picture).show_preview(message)
            case Progress(samples=samples, wanted=wanted, hint=hint):
                drawn = bar(samples / wanted, BAR_CELLS)
                self._show(lambda: f"{drawn} {samples}/{wanted}\n{render(hint)}")
            case Reason():
                self._end_child()  # whose end would read as unexpected
                self._show(lambda: f"✗ {render(message)}")
            case _:
                self._result = message
                self._show(lambda: _summary(message))

    def _keep(self) -> None:
        result, app = self._result, self.console_app
        if result is None:
            return
        with self.notify_errors():
            current = app.store.load(self._profile.identifier)
            calibrated = with_calibration(current, result.calibration)
            app.store.save(calibrated, by=app.authority, at=datetime.now(UTC), why=ChangeCause.CALIBRATED.key)
            app.trail.emit(calibration_record(self._profile.identifier, result))
            self.notify(tr("calibration.kept", camera=result.calibration.camera))
            self.dismiss()

    def _show(self, progress: Wording) -> None:
        self._progress = progress
        self.query_one("#progress", Static).update(progress())

    def _end_child(self) -> None:
        if self._worker is not None:
            self._worker.end()
        self._worker = None


def _summary(result: Calibrated) -> str:
    lines = [
        tr("calibration.reference", reference_m=result.reference_m, expected_m=result.expected.length_m),
        tr("calibration.residual", residual=result.calibration.residual),
        f"! {render(result.doubt)}" if result.doubt else tr("calibration.plausible"),
        tr("calibration.keep"),
    ]
    return "\n".join(lines)


class Progress(NamedTuple):
    """How far the sampling is, and what to do."""

    samples: int
    wanted: int
    hint: Reason


def calibrate_palm(pipe: Connection, setup: SessionSetup, distance_m: float) -> None:
    """Open the configured camera, sample the palm, solve; ends with a `Calibrated` or the reason of a fault."""
    discard_output()
    from app.system.errors import AppError
    from profiles.errors import ProfileError

    try:
        pipe.send(_sample(pipe, setup, distance_m))
    except (AppError, HardwareError, KgdfaError, ProfileError) as error:
        pipe.send(reason_of(error))


def _sample(pipe: Connection, setup: SessionSetup, distance_m: float) -> Calibrated:
    from app.perception import pipeline
    from app.perception.palm_calibration import WANTED_SAMPLES, PalmSampler, sample_palm
    from app.perception.reporting import PreviewPacer
    from hal.cameras.camera import CommandedHand

    camera = pipeline.make_camera(setup)
    pacer = PreviewPacer(width_px=PREVIEW_PX, rate_hz=PREVIEW_HZ)

    def show(sampler: PalmSampler, frame: Frame) -> None:
        if pacer.due(time.monotonic_ns()):
            pipe.send(pacer.message(frame.image_bgr, frame.captured_ns))
            pipe.send(Progress(len(sampler.samples_m), WANTED_SAMPLES, reason(sampler.hint)))

    with pipeline.make_detector(setup) as detector:
        camera.open()
        try:
            if isinstance(camera, CommandedHand):  # the digital hand opens by itself, without following hints
                camera.command(gesture="5")
            sampler = sample_palm(setup.profile, camera, detector, show)
            return sampler.solve(camera.name, distance_m, datetime.now(UTC))
        finally:
            camera.close()


def calibration_record(patient: str, result: Calibrated) -> CalibrationRecord:
    """A kept calibration for the trail; the residual is that of the fit, on the reference segment."""
    found = result.calibration
    return CalibrationRecord(
        method=ReferenceSource.CALIBRATED.value,
        anchor_m=result.reference_m,
        focal_px=found.focal_px,
        residual_m=found.residual * result.reference_m,
        text=reason(ChangeCause.CALIBRATED, patient=patient, camera=found.camera),
    )
