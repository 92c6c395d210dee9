"""Images and recordings of the digital hand, made once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import pytest

from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.render import lens_for
from tests.support import software_realsense

WIDTH, HEIGHT, FRAMES = 320, 180, 8
PERIOD_NS = 33_333_333


@dataclass(frozen=True)
class Kept:
    """Where the same eight frames lie, in every form that a camera can play."""

    video: Path
    folder: Path
    realsense: Path


def small_hand(depth: bool = True) -> DigitalHandCamera:
    """A digital hand on a small image, on a clock that tests set."""
    return DigitalHandCamera(
        seed=1, lens=lens_for(WIDTH, HEIGHT), depth=depth, gesture="5", rest_m=0.4, clock_ns=lambda: 0
    )


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Kept:
    root = tmp_path_factory.mktemp("kept")
    hand = small_hand()
    frames = [hand.render(number * PERIOD_NS, sequence=number) for number in range(1, FRAMES + 1)]
    folder = root / "pictures"
    folder.mkdir()
    video = cv2.VideoWriter(str(root / "hand.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, (WIDTH, HEIGHT))
    for frame in frames:
        video.write(frame.image_bgr)
        cv2.imwrite(str(folder / f"{frame.sequence:03d}.png"), frame.image_bgr)
    video.release()
    software_realsense.record(root / "hand.db3", FRAMES)
    return Kept(root / "hand.avi", folder, root / "hand.db3")
