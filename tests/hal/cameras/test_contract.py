"""What every camera driver keeps, whatever stands behind it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
import pytest

from app.system.config import CameraKind
from hal.cameras.camera import Camera, EndOfRecording, Frame
from hal.cameras.factory import open_camera
from hal.errors import CameraFault, HardwareError
from tests.hal.cameras.conftest import HEIGHT, WIDTH, Kept
from tests.support.errors import refused

Make = Callable[[], Camera]


class Case(NamedTuple):
    """One camera: its kind, what it plays, whether it gives depth, and whether it ends."""

    kind: CameraKind
    device: Callable[[Kept], Path | str] = lambda _: ""
    depth: bool = True
    ends: bool = True


CASES = {
    "digital hand": Case("digital-hand", ends=False),
    "video": Case("recording", lambda kept: kept.video, depth=False),
    "pictures": Case("recording", lambda kept: kept.folder, depth=False),
    "realsense": Case("realsense", lambda kept: kept.realsense),
}


def test_every_kind_that_needs_no_hardware_is_held_to_it() -> None:
    missing = set(get_args(CameraKind)) - {case.kind for case in CASES.values()} - {"webcam"}
    assert not missing, f"nothing here runs over {missing}: add a case to CASES in {__file__}"


def test_whoever_can_be_built_can_be_configured() -> None:
    with pytest.raises(HardwareError) as caught:
        open_camera("none")
    built = set(str(caught.value.values["known"]).split(", "))
    assert built == set(get_args(CameraKind)), "_BUILDERS in hal/cameras/factory.py, CameraKind in app/system/config.py"


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


@pytest.fixture
def make_camera(case: Case, kept: Kept) -> Make:
    settings = {"device": str(case.device(kept)), "width_px": WIDTH, "height_px": HEIGHT, "depth": True}
    return lambda: open_camera(case.kind, **settings)


@pytest.fixture
def camera(make_camera: Make) -> Iterator[Camera]:
    made = make_camera()
    made.open()
    yield made
    made.close()


def some(camera: Camera, wanted: int) -> list[Frame]:
    """The next few frames; fewer when a recording ends."""
    frames: list[Frame] = []
    give_up = time.monotonic() + 20
    while len(frames) < wanted and time.monotonic() < give_up:
        try:
            frame = camera.read(1.0)
        except EndOfRecording:
            break
        if frame is not None:
            frames.append(frame)
    return frames


def test_frames_are_images_with_matching_intrinsics(camera: Camera) -> None:
    (frame,) = some(camera, 1)
    assert frame.image_bgr.dtype == np.uint8
    assert frame.image_bgr.shape == (frame.intrinsics.height_px, frame.intrinsics.width_px, 3)
    assert frame.image_bgr.std() > 1
    assert frame.intrinsics.fx_px > 0


def test_captured_times_and_numbers_grow_and_are_of_this_hosts_clock(camera: Camera) -> None:
    before = time.monotonic_ns()
    frames = some(camera, 2)
    assert [frame.sequence for frame in frames] == sorted({frame.sequence for frame in frames})
    times = [frame.captured_ns for frame in frames]
    assert times == sorted(set(times))
    assert before - 1_000_000_000 <= times[0]
    assert times[-1] <= time.monotonic_ns()


def test_depth_is_metres_aligned_to_the_image_where_there_is_any(camera: Camera, case: Case) -> None:
    (frame,) = some(camera, 1)
    assert (frame.depth_m is not None) is case.depth
    if frame.depth_m is None:
        return
    assert frame.depth_m.dtype == np.float32
    assert frame.depth_m.shape == frame.image_bgr.shape[:2]
    assert np.isfinite(frame.depth_m).all()
    known = frame.depth_m[frame.depth_m > 0]
    assert known.size > 1000
    assert 0.2 < known.min() <= known.max() < 20


def test_reading_a_closed_camera_is_an_error_that_is_reported(make_camera: Make) -> None:
    camera = make_camera()
    with refused(CameraFault.NOT_OPEN):
        camera.read(0.0)
    camera.open()
    camera.close()
    camera.close()
    with refused(CameraFault.NOT_OPEN):
        camera.read(0.0)


def test_it_opens_again_after_closing(make_camera: Make) -> None:
    camera = make_camera()
    for _ in range(2):
        camera.open()
        try:
            assert len(some(camera, 1)) == 1
        finally:
            camera.close()


def test_it_has_a_name(camera: Camera) -> None:
    assert camera.name


def test_a_recording_ends(camera: Camera, case: Case) -> None:
    if not case.ends:
        return
    some(camera, 200)
    with pytest.raises(EndOfRecording):
        camera.read(1.0)
