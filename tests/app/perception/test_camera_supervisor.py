"""A camera that is missing, lost and found again: always a sentence, never an exception, and frames when it is back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from app.perception.camera import BACK_OFF_S, CameraSupervisor
from hal.cameras.camera import EndOfRecording, Frame, Intrinsics, IntrinsicsSource
from hal.errors import CameraFault, HardwareError, RecordingFault
from logs.reason import Reason, reason

INTRINSICS = Intrinsics(width_px=4, height_px=4, fx_px=4, fy_px=4, cx_px=2, cy_px=2, source=IntrinsicsSource.ASSUMED)


@dataclass
class Fragile:
    """A camera on a loose cable: `works` is the cable."""

    works: bool = True
    frames_left: int = 1000
    opened: int = 0
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
        pass


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
