"""Palm calibration in a process of its own: camera and hand model live there, the console shows what it sends."""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, NamedTuple

from app.system.config import SessionSetup
from hal.errors import HardwareError
from kgdfa.errors import KgdfaError

if TYPE_CHECKING:
    from hal.cameras.camera import Frame
    from profiles.calibration import Calibrated

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
        words.send(str(error))


def _sample(words: Connection, setup: SessionSetup, distance_m: float) -> Calibrated:
    from app.perception import build
    from app.perception.palm_calibration import WANTED_SAMPLES, PalmSampler, sample_palm
    from app.perception.preview import PreviewPacer

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
    from hal.cameras.digital_hand.camera import DigitalHandCamera

    if isinstance(camera, DigitalHandCamera):
        camera.command(gesture="5")


def _quiet() -> None:
    """Libraries write to stderr as they please; on the console's terminal that would tear the screen."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
