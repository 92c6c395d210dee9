"""A camera that only looks, and comes back with another lens: distances are those of the new one."""

from __future__ import annotations

from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.ipc.streams import LinkDirectory
from app.perception.look import CameraSample, _Look
from app.system.config import Config, SessionSetup
from hal.cameras.camera import Frame
from hal.cameras.intrinsics import assumed
from kgdfa.hand import Hand
from kgdfa.preprocess import Image
from profiles.schema import DEMO_PATIENT
from tests.app.perception.test_camera_supervisor import Fragile
from tests.kgdfa.hands import drawn_hand

LIMIT_S = 20.0


class OneHand:
    """A detector of ours that finds the same hand in every image."""

    def detect(self, _image: Image, _captured_ns: int) -> tuple[Hand, ...]:
        return (drawn_hand("ooooo"),)

    def follow(self, _hand: object, _unknown: bool, _sought: object) -> None: ...


def test_a_camera_that_comes_back_with_another_lens_is_measured_by_it(tmp_path: Path) -> None:
    links = LinkDirectory(path=tmp_path, public=b"", secret=b"")
    setup = SessionSetup(session="s", home=tmp_path, links=links, config=Config(), profile=DEMO_PATIENT, operator="")
    ours, theirs = Pipe()
    detector: Any = OneHand()
    looking = _Look(theirs, setup, Fragile(), detector)
    lens = assumed(1280, 720)
    black = np.zeros((720, 1280, 3), np.uint8)
    distances_m = list[float]()
    for number, focal_px in enumerate((lens.fx_px, 2 * lens.fx_px), 1):
        now = replace(lens, fx_px=focal_px, fy_px=focal_px)
        looking._take(Frame(image_bgr=black, captured_ns=number * 33_000_000, sequence=number, intrinsics=now))
        sample = None
        while not isinstance(sample, CameraSample):
            assert ours.poll(LIMIT_S)
            sample = ours.recv()
        assert sample.distance_m is not None
        distances_m.append(sample.distance_m)
    assert distances_m[1] == pytest.approx(2 * distances_m[0], rel=0.05)
