"""A camera that is missing, lost and found again: always a sentence, never an exception, and frames when it is back."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from app.perception.camera import BACK_OFF_S, CameraSupervisor
from hal.cameras.camera import EndOfRecording, Frame, Intrinsics, IntrinsicsSource
from hal.cameras.playback import PlaybackCamera, folder_source
from hal.errors import CameraFault, HardwareError, RecordingFault
from logs.reason import Reason, reason

INTRINSICS = Intrinsics(width_px=4, height_px=4, fx_px=4, fy_px=4, cx_px=2, cy_px=2, source=IntrinsicsSource.ASSUMED)


@dataclass
class Fragile:
    """A camera on a loose cable: `works` is the cable."""

    works: bool = True
    frames_left: int = 1000
    opened: int = 0
    closed: int = 0
    faults: list[str] = field(default_factory=list)
    name: str = "fragile"

    def open(self) -> None:
        if not self.works:
            raise HardwareError(CameraFault.WEBCAM_NOT_FOUND, device="fragile", known="")
        self.opened += 1

    def read(self, timeout_s: float) -> Frame | None:
        if not self.works:
            raise HardwareError(CameraFault.UNPLUGGED, camera="fragile")
        if not self.frames_left:
            raise EndOfRecording
        self.frames_left -= 1
        image = np.zeros((4, 4, 3), np.uint8)
        return Frame(image_bgr=image, captured_ns=1, sequence=1, intrinsics=INTRINSICS)

    def close(self) -> None:
        self.closed += 1


def test_unplugged_and_plugged_in_again() -> None:
    camera = Fragile()
    faults: list[Reason] = []
    keeper = CameraSupervisor(camera, on_fault=faults.append)
    assert keeper.read(0.0, 0.1) is not None
    camera.works = False
    assert keeper.read(1.0, 0.1) is None
    assert faults == [reason(CameraFault.UNPLUGGED, camera="fragile")]
    assert keeper.read(1.0 + BACK_OFF_S[0], 0.1) is None
    camera.works = True
    assert keeper.read(10.0, 0.1) is not None
    assert not keeper.fault
    assert len(faults) == 2  # unplugged, then not plugged in


def test_a_fault_is_reported_before_a_driver_that_may_hang_is_closed() -> None:
    camera = Fragile()
    closed: list[int] = []
    keeper = CameraSupervisor(camera, on_fault=lambda _: closed.append(camera.closed))
    keeper.read(0.0, 0.1)
    camera.works = False
    assert keeper.read(1.0, 0.1) is None
    assert (closed, camera.closed) == ([0], 0)
    assert keeper.read(1.1, 0.1) is None
    assert (closed, camera.closed) == ([0], 1)


def test_a_missing_camera_is_not_hammered() -> None:
    camera = Fragile(works=False)
    keeper = CameraSupervisor(camera)
    attempts = []
    camera_open = camera.open

    def counted() -> None:
        attempts.append(1)
        camera_open()

    camera.open = counted  # type: ignore[method-assign]
    for step in range(1000):
        keeper.read(step * 0.01, 0.1)
    assert len(attempts) <= len(BACK_OFF_S) + 2


def test_the_end_of_a_recording_is_reported_and_final() -> None:
    keeper = CameraSupervisor(Fragile(frames_left=1))
    assert keeper.read(0.0, 0.1) is not None
    assert keeper.read(0.1, 0.1) is None
    assert keeper.ended
    assert keeper.fault == reason(RecordingFault.ENDED)
    assert keeper.read(99.0, 0.1) is None


def test_a_recording_with_a_bad_image_ends_there_and_does_not_begin_anew(tmp_path: Path) -> None:
    for number in range(5):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((24, 32, 3), 120, np.uint8))
    (tmp_path / "5.png").write_bytes(b"no image")
    faults: list[Reason] = []
    camera = PlaybackCamera(tmp_path, folder_source(tmp_path), paced=False)
    keeper = CameraSupervisor(camera, on_fault=faults.append)
    given, end_s = 0, time.monotonic() + 20
    while not keeper.ended and time.monotonic() < end_s:
        given += keeper.read(time.monotonic(), 1.0) is not None
    assert (given, keeper.openings) == (5, 1)
    assert keeper.fault == reason(RecordingFault.IMAGE_UNREADABLE, path=tmp_path / "5.png")
    assert faults == [keeper.fault]
