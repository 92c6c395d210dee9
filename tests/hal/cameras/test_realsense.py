"""The RealSense driver on librealsense's software device, live: zeros, silence, a lost stream, coming back."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hal.cameras.camera import Frame, Intrinsics, IntrinsicsSource, LatestFrame
from hal.cameras.digital_hand.depth import LEAST_M
from hal.cameras.digital_hand.render import lens_for
from hal.cameras.factory import open_camera
from hal.cameras.realsense import RealSenseCamera, clean_depth
from hal.cameras.realsense_devices import find_device, library
from hal.cameras.software_realsense import SERIAL, SoftwareRealSense
from hal.errors import CameraFault, HardwareError
from kgdfa.depth import DepthFault, DepthRange, read_published, sample_palm
from kgdfa.distance import HALF_PALM_M
from kgdfa.hand import Hand, Keypoint, Side
from tests.support.errors import refused
from tests.support.known_hands import known_hand
from tests.support.software_realsense import HEIGHT, PERIOD_NS, WIDTH, a_hand, feed

LIMIT_S = 20.0


@pytest.fixture(autouse=True, scope="module")
def _rendered_before() -> None:
    """The room is drawn with a process's first frame, which on a busy machine outlasts what counts as silence."""
    a_hand().render(PERIOD_NS)


@pytest.fixture
def software() -> SoftwareRealSense:
    return SoftwareRealSense(a_hand().lens)


@pytest.fixture
def camera(software: SoftwareRealSense) -> Iterator[RealSenseCamera]:
    made = RealSenseCamera(software=software.device)
    made.open()
    yield made
    made.close()


def next_frame(camera: RealSenseCamera, software: SoftwareRealSense, rest_m: float, first: int = 1) -> Frame:
    """Feed the hand at that distance until a whole frame comes out."""
    hand, give_up, number = a_hand(rest_m), time.monotonic() + LIMIT_S, first
    while time.monotonic() < give_up:
        feed(software, hand, number)
        number += 1
        frame = camera.read(0.3)
        if frame is not None:
            return frame
    raise AssertionError("no frame came")


def read_for(camera: RealSenseCamera, seconds: float) -> None:
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        camera.read(0.2)


def seen_hand(rest_m: float) -> Hand:
    hand = known_hand(a_hand(rest_m).scene(PERIOD_NS))
    assert hand is not None
    return hand


class Connected:
    """A context with these devices: librealsense's own does not list software devices."""

    def __init__(self, *devices: Any) -> None:
        self._devices = devices

    def query_devices(self) -> Connected:
        return self

    def size(self) -> int:
        return len(self._devices)

    def __getitem__(self, number: int) -> Any:
        return self._devices[number]


def test_a_camera_that_is_not_connected_is_told_from_one_of_another_serial_number(
    software: SoftwareRealSense,
) -> None:
    rs = library()
    with refused(CameraFault.REALSENSE_NOT_FOUND):
        find_device(rs, Connected(), "123")
    assert find_device(rs, Connected(software.device), SERIAL) is software.device
    with refused(CameraFault.REALSENSE_IS_ANOTHER, serial="123", known=SERIAL):
        find_device(rs, Connected(software.device), "123")


def test_colour_and_depth_of_the_fed_hand_come_out_aligned(
    camera: RealSenseCamera, software: SoftwareRealSense
) -> None:
    frame = next_frame(camera, software, 0.40)
    assert camera.name.startswith("Software D435I")
    assert frame.image_bgr.shape == (HEIGHT, WIDTH, 3)
    assert frame.depth_m is not None
    sample = sample_palm(seen_hand(0.40), frame.depth_m)
    assert sample.depth_m == pytest.approx(0.40, abs=0.03)


def test_a_smaller_depth_stream_is_aligned_to_the_colour_image() -> None:
    software = SoftwareRealSense(a_hand().lens, depth_size=(WIDTH // 2, HEIGHT // 2))
    camera = RealSenseCamera(software=software.device)
    camera.open()
    try:
        frame = next_frame(camera, software, 0.40)
    finally:
        camera.close()
    assert frame.depth_m is not None
    assert frame.depth_m.shape == (HEIGHT, WIDTH)
    assert sample_palm(seen_hand(0.40), frame.depth_m).depth_m == pytest.approx(0.40, abs=0.03)


def test_nearer_than_the_camera_can_see_is_zero_for_published_and_no_measurement_for_robust(
    camera: RealSenseCamera, software: SoftwareRealSense
) -> None:
    near_m = LEAST_M - 0.07
    frame, hand = next_frame(camera, software, near_m), seen_hand(near_m)
    assert frame.depth_m is not None
    assert read_published(frame.depth_m, hand).safe_m == 0.0
    reader = DepthRange(mode="robust")
    assert reader.measure(frame.depth_m, hand, frame.captured_ns) is None
    assert reader.fault is DepthFault.ZERO


def test_a_stream_that_stops_is_reported_and_comes_back(camera: RealSenseCamera, software: SoftwareRealSense) -> None:
    next_frame(camera, software, 0.40)
    with refused(CameraFault.NO_FRAMES):
        read_for(camera, LIMIT_S)
    camera.close()
    camera.open()
    assert next_frame(camera, software, 0.40, first=1000).depth_m is not None


def frame_set(colour: int, depth: int, period_ns: int = PERIOD_NS, epoch_ns: int = 0) -> Any:
    """As librealsense gives it, of small images with these frame numbers, stamped by them."""

    def frame(number: int, pixels: Any) -> Any:
        layout = SimpleNamespace(format=lambda: SimpleNamespace(name="bgr8"))
        stamp_ms = (epoch_ns + number * period_ns) / 1e6
        calls = {"get_frame_number": number, "get_timestamp": stamp_ms, "get_data": pixels}
        return SimpleNamespace(profile=layout, **{name: lambda value=value: value for name, value in calls.items()})

    images = frame(colour, np.zeros((2, 2, 3), np.uint8)), frame(depth, np.full((2, 2), 400, np.uint16))
    return SimpleNamespace(get_color_frame=lambda: images[0], get_depth_frame=lambda: images[1])


@pytest.fixture
def unaligned() -> RealSenseCamera:
    """Not open, for frame sets of ours."""
    camera = RealSenseCamera()
    camera._align = SimpleNamespace(process=lambda frames: frames)
    return camera


def test_a_stalled_streams_last_frame_beside_a_live_one_is_no_new_one(
    unaligned: RealSenseCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    sets = {0: (1, 1), 1: (1, 2), 2: (2, 3), 3: (3, 3), 8: (8, 3), 9: (9, 9)}  # by images since the first
    given = []
    for image, numbers in sets.items():
        monkeypatch.setattr("hal.cameras.realsense.time.monotonic_ns", lambda image=image: 10**9 + image * PERIOD_NS)
        streams: Any = SimpleNamespace(wait=lambda _, numbers=numbers: frame_set(*numbers))
        given.append(unaligned._grab(streams))
    depths = [one and one.depth_m is not None for one in given]
    assert depths == [True, None, True, True, False, True], "one image late is none too old"
    came = [one and (one.depth_ns - 10**9) // PERIOD_NS for one in given]
    assert came == [0, None, 2, 2, 2, 9]


@pytest.mark.parametrize(("rate_hz", "epoch_ns"), [(30, 0), (30, 1_700_000_000_000_000_000), (6, 0)])
def test_frame_sets_that_waited_while_the_process_stood_still_are_none(
    unaligned: RealSenseCamera, monkeypatch: pytest.MonkeyPatch, rate_hz: int, epoch_ns: int
) -> None:
    """Dated by their arrival, they had shown a hand where it was long ago."""
    period_ns = 10**9 // rate_hz
    came = {1: 1, 2: 2, 3: 180, 4: 180, 5: 180, 181: 181, 182: 182}  # in which period, by number
    given = []
    for number, period in came.items():
        monkeypatch.setattr("hal.cameras.realsense.time.monotonic_ns", lambda period=period: 10**9 + period * period_ns)
        frames = frame_set(number, 5 if number == 181 else number, period_ns, epoch_ns)
        streams: Any = SimpleNamespace(wait=lambda _, frames=frames: frames)
        given.append(unaligned._grab(streams))
    assert [one is not None for one in given] == [True, True, False, False, False, True, True]
    assert [one.depth_m is not None for one in given if one] == [True, True, False, True], "its depth is as old"


@pytest.mark.parametrize("step_s", [-3600.0, -1.0, -0.3, 0.7])
def test_a_camera_whose_stamps_jump_is_back_within_a_second(
    unaligned: RealSenseCamera, monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    """By librealsense's default they follow this host's date, which may be set."""
    given = []
    for number in range(1, 200):
        monkeypatch.setattr("hal.cameras.realsense.time.monotonic_ns", lambda number=number: number * PERIOD_NS)
        frames = frame_set(number, number, epoch_ns=10**18 + round(step_s * 1e9 if number >= 100 else 0))
        streams: Any = SimpleNamespace(wait=lambda _, frames=frames: frames)
        given.append(unaligned._grab(streams) is not None)
    assert all(given[:99])
    assert all(given[130:])


def test_a_colour_stream_that_stalls_beside_a_live_depth_stream_is_lost(unaligned: RealSenseCamera) -> None:
    streams: Any = SimpleNamespace(wait=lambda _: frame_set(1, time.monotonic_ns()))
    lost = HardwareError(CameraFault.NO_FRAMES, camera=unaligned.name)
    unaligned._latest = LatestFrame(lambda: unaligned._grab(streams), lost=lost, silence_s=0.05)
    unaligned._intrinsics = LENS
    try:
        with refused(CameraFault.NO_FRAMES):
            read_for(unaligned, LIMIT_S)
    finally:
        unaligned.close()


# Of images of 320×180 through a lens of 162.5 px: what a damaged calibration may state instead.
LENS = a_hand().lens
IMPOSSIBLE = {
    "no focal length": replace(LENS, fx_px=0.0),
    "a negative one": replace(LENS, fy_px=-162.5),
    "not a number": replace(LENS, fx_px=float("nan")),
    "endless": replace(LENS, fx_px=float("inf"), fy_px=float("inf")),
    "a telescope": replace(LENS, fx_px=162.5 * 20, fy_px=162.5 * 20),
    "no pinhole": replace(LENS, fx_px=8.0, fy_px=8.0),
    "centre outside": replace(LENS, cx_px=400.0),
    "centre not finite": replace(LENS, cy_px=float("nan")),
    "of other images": lens_for(2 * WIDTH, 2 * HEIGHT),
}


@pytest.mark.parametrize("lens", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_a_device_whose_lens_is_impossible_is_refused(lens: Intrinsics) -> None:
    camera = RealSenseCamera(software=SoftwareRealSense(LENS, stated=lens).device)
    with refused(CameraFault.INTRINSICS_IMPOSSIBLE, camera="Software D435I", width_px=lens.width_px):
        camera.open()


@pytest.mark.parametrize("lens", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_a_device_whose_depth_lens_is_impossible_is_refused(lens: Intrinsics) -> None:
    camera = RealSenseCamera(software=SoftwareRealSense(LENS, stated_depth=lens).device)
    with refused(CameraFault.DEPTH_INTRINSICS_IMPOSSIBLE, camera="Software D435I", image_width_px=WIDTH):
        camera.open()


def test_what_is_no_depth_becomes_no_measurement() -> None:
    raw = np.array([[np.nan, -1.0, 0.0, 65535.0, 400.0, np.inf]])
    assert clean_depth(raw, 0.001).tolist() == [[0.0, 0.0, 0.0, 0.0, pytest.approx(0.4), 0.0]]


RECORDED = Path(os.environ.get("RLEEX_TEST_DATA", "")) / "realsense" / "single_depth_color_640x480.bag"


@pytest.mark.skipif(not RECORDED.is_file(), reason="RLEEX_TEST_DATA: folder of the data beside the project")
def test_a_recording_of_a_real_camera_opens_shows_depth_and_measures() -> None:
    """librealsense's own sample: one frame set of a D400 camera, nothing nearer than half a metre."""
    camera = open_camera("realsense", device=str(RECORDED))
    camera.open()
    try:
        frame = next(frame for _ in range(20) if (frame := camera.read(LIMIT_S)) is not None)
    finally:
        camera.close()
    depth = frame.depth_m
    assert depth is not None
    assert depth.shape == frame.image_bgr.shape[:2] == (480, 640)
    assert (depth > 0).mean() > 0.9
    assert frame.intrinsics.source is IntrinsicsSource.MEASURED
    places = [(x, y) for y in range(100, 380, 20) for x in range(100, 540, 20)]
    x, y = min(places, key=lambda at: float(np.ptp(depth[at[1] - 30 : at[1] + 31, at[0] - 30 : at[0] + 31])))
    image = np.full((21, 2), (x, y), float)
    image[Keypoint.INDEX_MCP], image[Keypoint.PINKY_MCP], image[Keypoint.WRIST] = (x - 20, y), (x + 20, y), (x, y + 25)
    palm = Hand(image_px=image, world_m=np.zeros((21, 3)), presence=0.9, side=Side.RIGHT)
    measured = DepthRange(mode="robust").measure(depth, palm, frame.captured_ns)
    assert measured is not None
    assert measured.shown_m == pytest.approx(float(np.median(depth[y : y + 20, x])) + HALF_PALM_M, rel=0.05)
