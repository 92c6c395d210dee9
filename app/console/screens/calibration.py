"""Guided palm calibration: the picture, what to do, the count, the result with its residual; kept on the last word."""

from __future__ import annotations

import math
import multiprocessing
import os
import shutil
import time
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import Input, Label, Static

from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import Question
from app.console.sentences import sentence
from app.console.state import SessionState
from app.console.widgets.panel import bar
from app.console.widgets.picture import Picture
from app.ipc.messages import Preview
from app.session.host import make_setup
from app.system.config import SessionSetup
from app.text.catalogue import render, tr
from hal.errors import HardwareError
from kgdfa.errors import KgdfaError
from logs.records import Calibration as CalibrationRecord
from profiles.palm import Calibrated, with_calibration
from profiles.schema import Profile

DEFAULT_CM = {"digital-hand": "36"}  # where the digital hand rests
NEAREST_CM, FARTHEST_CM = 15.0, 70.0  # a palm fills the picture; a palm is a few pixels
BAR_CELLS = 20


class CalibrationScreen(ConsoleScreen):
    """Enter in the distance begins, Ctrl-S keeps, Escape leaves."""

    HELP_PAGE = "calibration"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "keep", "bind.calibration.keep"),
        Binding("escape", "back", "bind.start.back"),
    ]

    def __init__(self, profile: Profile) -> None:
        super().__init__()
        self._profile = profile
        self._words: Connection | None = None
        self._child: BaseProcess | None = None
        self._made: Calibrated | None = None

    def compose(self) -> ComposeResult:
        yield Label(tr("calibration.title", name=self._profile.identifier), id="title")
        with Horizontal(id="training"):
            with Vertical(id="seen"):
                yield Picture(id="picture")
            with Vertical(id="wanted"):
                yield Static(tr("calibration.words"), markup=False)
                start = DEFAULT_CM.get(self.console_app.config.camera.kind, "30")
                yield Input(start, id="distance", max_length=8)
                yield Static(tr("calibration.begin"), id="progress", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.query_one("#distance").focus()

    def on_unmount(self) -> None:
        self._end_child()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Begin, at the distance that was measured."""
        try:
            distance_cm = float(event.value.replace("cm", "").replace(",", "."))
        except ValueError:
            distance_cm = math.nan
        if not NEAREST_CM <= distance_cm <= FARTHEST_CM:
            self._say(tr("calibration.distance", least=f"{NEAREST_CM:.0f}", most=f"{FARTHEST_CM:.0f}"))
            return
        self._begin(distance_cm / 100)

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        try:
            while self._words is not None and self._words.poll():
                self._take(self._words.recv())
        except EOFError:
            self._end_child()
            if self._made is None:
                self._say(tr("calibration.died"))

    def action_keep(self) -> None:
        """Into the profile; one that is not plausible only after asking."""
        if self._made is None:
            self._say(tr("calibration.nothing"))
        elif self._made.doubt:
            self.app.push_screen(Question(tr("calibration.keep_title"), self._made.doubt), self._keep_if)
        else:
            self._keep_if(True)

    def action_back(self) -> None:
        """Leave; what was not kept is gone."""
        self.dismiss()

    def _begin(self, distance_m: float) -> None:
        self._end_child()
        self._made = None
        app = self.console_app
        setup = make_setup(app.home, app.config, self._profile, app.operator)
        shutil.rmtree(setup.links)  # no session: nobody needs its sockets
        context = multiprocessing.get_context("spawn")
        self._words, theirs = context.Pipe(duplex=False)
        self._child = context.Process(target=calibrate_palm, args=(theirs, setup, distance_m), daemon=True)
        self._child.start()
        theirs.close()
        self._say(tr("calibration.starting"))

    def _take(self, said: Progress | Preview | Calibrated | str) -> None:
        if isinstance(said, Preview):
            self.query_one(Picture).show_preview(said)
        elif isinstance(said, Progress):
            drawn = bar(said.samples / said.wanted, BAR_CELLS)
            self._say(f"{drawn} {said.samples}/{said.wanted}\n{sentence(said.hint)}")
        elif isinstance(said, str):
            self._say(f"✗ {sentence(said)}")
        else:
            self._made = said
            self._say(_result(said))

    def _keep_if(self, yes: bool | None) -> None:
        made, app = self._made, self.console_app
        if not yes or made is None:
            return
        with self.told():
            now = app.store.load(self._profile.identifier)
            known = with_calibration(now, made.calibration)
            why = f"calibrated with {made.calibration.camera}"
            app.store.save(known, by=app.operator, at=datetime.now(UTC), why=why)
            app.trail.emit(
                CalibrationRecord(
                    method="calibrated",
                    anchor_m=made.reference_m,
                    focal_px=made.calibration.focal_px,
                    residual_m=made.calibration.residual * made.reference_m,
                    text=f"{self._profile.identifier} with {made.calibration.camera}",
                )
            )
            self.notify(tr("calibration.kept", camera=made.calibration.camera))
            self.dismiss()

    def _say(self, words: str) -> None:
        self.query_one("#progress", Static).update(words)

    def _end_child(self) -> None:
        if self._child is not None and self._words is not None:
            self._child.kill()
            self._child.join()
            self._words.close()
        self._child = self._words = None


def _result(made: Calibrated) -> str:
    lines = [
        tr("calibration.anchor", cm=f"{made.reference_m * 100:.2f}", expected=f"{made.expected.length_m * 100:.2f}"),
        tr("calibration.residual", percent=f"{made.calibration.residual * 100:.1f}"),
        f"! {made.doubt}" if made.doubt else tr("calibration.plausible"),
        tr("calibration.keep"),
    ]
    return "\n".join(lines)


if TYPE_CHECKING:
    from hal.cameras.camera import Frame
    from profiles.palm import Calibrated

PREVIEW_PX = 160
SHOWN_HZ = 10.0


class Progress(NamedTuple):
    """How far the sampling is, and what to do."""

    samples: int
    wanted: int
    hint: str


def calibrate_palm(words: Connection, setup: SessionSetup, distance_m: float) -> None:
    """Open the configured camera, sample the palm, solve; ends with a `Calibrated` or an error's sentence."""
    _quiet()
    from app.system.errors import AppError
    from profiles.errors import ProfileError

    try:
        words.send(_sample(words, setup, distance_m))
    except (AppError, HardwareError, KgdfaError, ProfileError) as error:
        words.send(render(error))


def _sample(words: Connection, setup: SessionSetup, distance_m: float) -> Calibrated:
    from app.perception import pipeline as build
    from app.perception.palm_calibration import WANTED_SAMPLES, PalmSampler, sample_palm
    from app.perception.reporting import PreviewPacer

    camera = build.make_camera(setup)
    pacer = PreviewPacer(width_px=PREVIEW_PX, rate_hz=SHOWN_HZ)

    def show(sampler: PalmSampler, frame: Frame) -> None:
        if pacer.due(time.monotonic_ns()):
            words.send(pacer.message(frame.image_bgr, frame.captured_ns))
            words.send(Progress(len(sampler.samples_m), WANTED_SAMPLES, sampler.hint))

    with build.make_detector(setup) as detector:
        camera.open()
        try:
            _show_palm(camera)
            sampler = sample_palm(setup.profile, camera, detector, show)
            return sampler.solve(camera.name, distance_m, datetime.now(UTC))
        finally:
            camera.close()


def _show_palm(camera: object) -> None:
    """The digital hand has nobody to ask: it opens by itself."""
    from hal.cameras.digital_hand.driver import DigitalHandCamera

    if isinstance(camera, DigitalHandCamera):
        camera.command(gesture="5")


def _quiet() -> None:
    """Libraries write to stderr as they please; on the console's terminal that would tear the screen."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
