"""Finding webcams by name or number, on a sysfs tree of our own."""

from __future__ import annotations

from contextlib import closing, nullcontext
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hal.cameras import webcam, webcam_list
from hal.cameras.camera import ImageArray
from hal.cameras.intrinsics import assumed, save
from hal.cameras.webcam import WebcamCamera
from hal.cameras.webcam_list import find_webcam, list_webcams, same_webcam
from hal.errors import CameraFault
from kgdfa.button_state import ButtonMode, ButtonPlace
from kgdfa.gesture import Gesture
from kgdfa.recognition import FrameReading, Recognition, recognise
from tests.support.errors import refused


@pytest.fixture
def sysfs(tmp_path: Path) -> Path:
    for number, name in ((10, "Late Cam"), (0, "Integrated Camera: HD"), (2, "USB Cam C920")):
        folder = tmp_path / f"video{number}"
        folder.mkdir()
        (folder / "name").write_text(name + "\n")
    (tmp_path / "v4l-subdev0").mkdir()
    (tmp_path / "video7").mkdir()  # vanished while we looked: no name any more
    (tmp_path / "video8").mkdir()  # vanishes between two looks: reading its name fails
    (tmp_path / "video8" / "name").symlink_to("/proc/self/mem")
    return tmp_path


def test_webcams_are_listed_by_number(sysfs: Path) -> None:
    assert [(entry.index, entry.name) for entry in list_webcams(sysfs)] == [
        (0, "Integrated Camera: HD"),
        (2, "USB Cam C920"),
        (10, "Late Cam"),
    ]


def test_a_machine_without_video_devices_lists_none(tmp_path: Path) -> None:
    assert list_webcams(tmp_path / "nothing") == ()


@pytest.mark.parametrize(
    ("device", "index"), [("", 0), ("2", 2), ("10", 10), ("c920", 2), ("/dev/video10", 10), ("integrated", 0)]
)
def test_a_webcam_is_found_by_number_path_or_part_of_its_name(sysfs: Path, device: str, index: int) -> None:
    assert find_webcam(device, list_webcams(sysfs)).index == index


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [("2", "C920", True), ("0", "c920", False), ("", "0", True), ("gone", "gone", True), ("gone", "2", False)],
)
def test_two_names_of_one_webcam_are_recognised(
    sysfs: Path, monkeypatch: pytest.MonkeyPatch, first: str, second: str, same: bool
) -> None:
    listed = list_webcams(sysfs)
    monkeypatch.setattr(webcam_list, "list_webcams", lambda: listed)
    assert same_webcam(first, second) is same


@pytest.mark.parametrize("device", ["1", "9", "logi", "/dev/video3"])
def test_an_unknown_webcam_is_refused_with_what_there_is(sysfs: Path, device: str) -> None:
    with refused(CameraFault.WEBCAM_NOT_FOUND, known="0 (Integrated Camera: HD), 2 (USB Cam C920), 10 (Late Cam)"):
        find_webcam(device, list_webcams(sysfs))


def test_a_listed_camera_that_cannot_be_opened_reports_what_to_check(tmp_path: Path) -> None:
    folder = tmp_path / "video99"
    folder.mkdir()
    (folder / "name").write_text("Ghost")
    camera = WebcamCamera("ghost", sysfs=tmp_path)
    with refused(CameraFault.WEBCAM_BUSY):
        camera.open()
    camera.close()


def test_no_camera_at_all_is_a_sentence(tmp_path: Path) -> None:
    with refused(CameraFault.NO_WEBCAM):
        WebcamCamera(sysfs=tmp_path).open()


class Capture:
    """A camera that gives other sizes than asked for, and that can be opened once at a time."""

    in_use = 0

    def __init__(self, *_: int) -> None:
        self._mine = Capture.in_use == 0
        Capture.in_use += 1

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return self._mine

    def set(self, *_: float) -> None: ...

    def get(self, what: int) -> float:
        return {cv2.CAP_PROP_FRAME_WIDTH: 640.0, cv2.CAP_PROP_FRAME_HEIGHT: 480.0}.get(what, 0.0)

    def release(self) -> None:
        Capture.in_use -= 1


def test_a_camera_whose_lens_is_refused_is_released(
    sysfs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "cameras.toml"
    save(store, "USB Cam C920", assumed(1280, 720), 0.2, print)
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    camera = WebcamCamera("c920", store=store, sysfs=sysfs)
    for _ in range(2):
        with refused(CameraFault.OTHER_RESOLUTION):
            camera.open()
    assert Capture.in_use == 0


@pytest.mark.parametrize(("width_px", "height_px", "focal_px"), [(1280, 720, 950.0), (320, 240, 237.5)])
def test_a_focal_length_that_is_given_for_another_size_is_refused(
    sysfs: Path, monkeypatch: pytest.MonkeyPatch, width_px: int, height_px: int, focal_px: float
) -> None:
    """Every distance would be wrong by the ratio of the sizes: a press without a push, or none at all."""
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    camera = WebcamCamera("c920", width_px=width_px, height_px=height_px, focal_px=focal_px, sysfs=sysfs)
    stated = {"width_px": width_px, "height_px": height_px, "image_width_px": 640, "image_height_px": 480}
    with refused(CameraFault.FOCAL_LENGTH_OTHER_SIZE, **stated):
        camera.open()
    assert Capture.in_use == 0


def test_images_of_another_size_than_the_camera_says_are_refused(sysfs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every distance would be wrong by the ratio of the sizes."""

    class Larger(Capture):
        def read(self) -> tuple[bool, ImageArray]:
            return True, np.random.default_rng().integers(0, 255, (960, 1280, 3), np.uint8)

    monkeypatch.setattr(cv2, "VideoCapture", Larger)
    camera = WebcamCamera("c920", sysfs=sysfs)
    camera.open()
    sizes = {"width_px": 640, "height_px": 480, "image_width_px": 1280, "image_height_px": 960}
    with closing(camera), refused(CameraFault.IMAGES_OTHER_SIZE, **sizes):
        while camera.read(30.0) is None:
            pass


@pytest.mark.parametrize(("noise", "fault"), [(0, CameraFault.NO_FRAMES), (1, None)])
def test_the_same_image_again_and_again_is_none(
    sysfs: Path, monkeypatch: pytest.MonkeyPatch, noise: int, fault: CameraFault | None
) -> None:
    """Else a hand that a hung camera goes on showing would keep a walk going."""
    generator = np.random.default_rng(1)

    class Hung(Capture):
        def read(self) -> tuple[bool, ImageArray]:
            return True, np.full((480, 640, 3), 90, np.uint8) + generator.integers(
                0, noise + 1, (480, 640, 3), np.uint8
            )

    monkeypatch.setattr(cv2, "VideoCapture", Hung)
    camera = WebcamCamera("c920", sysfs=sysfs)
    camera.open()
    frames = 0
    with closing(camera), nullcontext() if fault is None else refused(fault):
        while frames < 30:
            frames += camera.read(0.05) is not None
    assert frames == (30 if fault is None else 1)


S_NS = 1_000_000_000
DECODING_NS = 15_000_000


class OneBuffer:
    """V4L2 with one buffer, and the clock of the process that reads it."""

    def __init__(self, rate_hz: float, *, stamps: bool, epoch_ns: int = 0) -> None:
        """stamps: whether a buffer has the time at which its image began to come; it comes for a whole period."""
        self.rate_hz = rate_hz
        self.now_ns = self.stamp_ns = 3600 * S_NS
        self.pause_ns = 0  # of the process, within the next `read`
        self._stamps, self._epoch_ns = stamps, epoch_ns

    def monotonic_ns(self) -> int:
        return self.now_ns

    def read(self) -> tuple[bool, ImageArray]:
        period_ns = round(S_NS / self.rate_hz)
        self.stamp_ns = (self.now_ns // period_ns + 1) * period_ns
        self.now_ns = max(self.stamp_ns + period_ns, self.now_ns + self.pause_ns) + DECODING_NS
        self.pause_ns = 0
        return True, np.full((16, 8, 3), self.stamp_ns // period_ns % 251, np.uint8)

    def get(self, what: int) -> float:
        return (self.stamp_ns - self._epoch_ns) / 1e6 if self._stamps and what == cv2.CAP_PROP_POS_MSEC else 0.0


STAMPS: dict[str, dict[str, Any]] = {
    "monotonic": {"stamps": True},
    "another clock, near": {"stamps": True, "epoch_ns": 20 * S_NS},
    "another clock, far": {"stamps": True, "epoch_ns": -(10**9) * S_NS},
    "none": {"stamps": False},
}


def buffered(monkeypatch: pytest.MonkeyPatch, rate_hz: float, **stamps: Any) -> tuple[WebcamCamera, OneBuffer]:
    """A camera behind one buffer, not opened: it is read image by image."""
    camera, buffer = WebcamCamera(), OneBuffer(rate_hz, **stamps)
    camera._capture = buffer
    monkeypatch.setattr(webcam, "time", buffer)
    return camera, buffer


@pytest.mark.parametrize("stamps", STAMPS.values(), ids=STAMPS)
@pytest.mark.parametrize(("rate_hz", "pause_s"), [(30.0, 0.5), (10.0, 0.5), (5.0, 0.8), (30.0, 5.0), (30.0, 600.0)])
def test_the_image_that_waited_while_the_process_stood_still_is_none(
    monkeypatch: pytest.MonkeyPatch, rate_hz: float, pause_s: float, stamps: dict[str, Any]
) -> None:
    camera, buffer = buffered(monkeypatch, rate_hz, **stamps)
    for _ in range(2):  # the second pause follows at once
        assert [camera._grab() is not None for _ in range(5)][1:] == [True] * 4
        for _ in range(2):
            buffer.pause_ns = round(pause_s * S_NS)
            assert camera._grab() is None
    came = camera._grab()
    assert came is not None
    assert came[1] == buffer.now_ns


def test_a_first_image_that_is_old_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    camera, buffer = buffered(monkeypatch, 30.0, stamps=True)
    buffer.pause_ns = 2 * S_NS
    assert camera._grab() is None
    assert camera._grab() is not None


SLOW_HZ: list[tuple[float, ...]] = [(10.0,), (5.0,), (3.0,), (1.5,), (30.0, 10.0), (10.0, 5.0)]


@pytest.mark.parametrize(("rates_hz", "stamps"), [*product(SLOW_HZ, STAMPS), ((30.0, 5.5), "monotonic")])
def test_a_slow_camera_keeps_its_images(
    monkeypatch: pytest.MonkeyPatch, rates_hz: tuple[float, ...], stamps: str
) -> None:
    """Also one that becomes slow as it gets dark."""
    camera, buffer = buffered(monkeypatch, rates_hz[0], **STAMPS[stamps])
    camera._grab()  # of a very slow one the first counts as old
    for rate_hz in rates_hz:
        buffer.rate_hz = rate_hz
        assert all(camera._grab() is not None for _ in range(200))


def test_a_camera_without_stamps_that_becomes_very_slow_is_back_within_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    camera, buffer = buffered(monkeypatch, 30.0, stamps=False)
    assert all(camera._grab() is not None for _ in range(30))
    buffer.rate_hz = 3.0
    assert [camera._grab() is not None for _ in range(6)] == [False, False, True, True, True, True]


@pytest.mark.parametrize("stamps", STAMPS.values(), ids=STAMPS)
def test_a_hand_that_came_near_while_the_process_stood_still_and_hovers_does_not_command(
    monkeypatch: pytest.MonkeyPatch, stamps: dict[str, Any]
) -> None:
    """The image that had waited showed it far, dated now: readiness, gesture and approach of a push that was none."""
    place = ButtonPlace.in_the_middle(1280, 720, 0.20)
    for hover_m in (0.15, 0.16, 0.17, 0.18, 0.19):
        camera, buffer = buffered(monkeypatch, 60.0, **stamps)
        after, paused_ns = Recognition(), buffer.now_ns + 2 * S_NS
        while buffer.now_ns < paused_ns + 12 * S_NS:
            buffer.pause_ns = 5 * S_NS if paused_ns <= buffer.now_ns < paused_ns + S_NS else 0
            came, hovered_s = camera._grab(), (buffer.stamp_ns - paused_ns) / S_NS - 7.0
            if came is not None:
                drawn_m = 0.02 * max(0.0, hovered_s)  # after two seconds, by 2 cm a second
                near_m = min(0.26, hover_m + drawn_m) if buffer.stamp_ns > paused_ns + S_NS else 0.25
                reading = FrameReading(
                    captured_ns=came[1], hand=1, gesture=Gesture.THREE, cut_off=False, distance_m=near_m, beside_px=0.0
                )
                after = recognise(after, reading, place, ButtonMode.ROBUST)
        assert after.button.release_count == 0
        assert after.button.ready, "it was outside again in the end"
