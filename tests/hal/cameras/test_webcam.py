"""Finding webcams by name or number, on a sysfs tree of our own."""

from __future__ import annotations

from contextlib import closing, nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest

from hal.cameras import webcam_list
from hal.cameras.camera import ImageArray
from hal.cameras.intrinsics import assumed, save
from hal.cameras.webcam import WebcamCamera
from hal.cameras.webcam_list import find_webcam, list_webcams, same_webcam
from hal.errors import CameraFault
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
        return 640.0 if what == cv2.CAP_PROP_FRAME_WIDTH else 480.0

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
