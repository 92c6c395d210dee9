"""`rleex camera`: its arguments, its output, and its errors."""

from __future__ import annotations

import re
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli.camera import _images, cli
from app.system.paths import find_home
from hal.cameras import webcam
from hal.cameras.camera import ImageArray
from hal.cameras.intrinsics import load, save
from hal.cameras.webcam_list import WebcamEntry
from hal.errors import CameraFault, HardwareError, RecordingFault
from tests.hal.cameras.conftest import Kept
from tests.hal.cameras.test_intrinsics import BOARD, LENS, VIEWS, seen_board
from tests.hal.cameras.test_webcam import Capture
from tests.support.errors import refused


def run(home: Path, *text: str) -> str:
    """The command's output; what it raises goes to the program's own last line of defence."""
    result = CliRunner().invoke(cli, [*text, "--home", str(home)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


class GreyCapture(Capture):
    """It shows no board."""

    def read(self) -> tuple[bool, ImageArray]:
        return True, np.full((480, 640, 3), 128, np.uint8)


def test_list_names_the_simulated_camera_and_where_to_choose(tmp_path: Path) -> None:
    output = run(tmp_path, "list")
    assert "digital-hand" in output
    assert "config.toml" in output


@pytest.mark.parametrize("kind", ["video", "folder", "realsense"])
def test_show_reports_resolution_lens_and_its_source(kept: Kept, tmp_path: Path, kind: str) -> None:
    output = run(tmp_path, "show", str(getattr(kept, kind)))
    assert "320x180" in output
    source = {"video": "assumed", "folder": "assumed", "realsense": "measured"}[kind]
    assert source in output
    assert (re.search(r"depth +yes", output) is not None) == (kind == "realsense")


@pytest.mark.parametrize("source", ["no such webcam", "/nowhere/film.avi", "/nowhere/film.bag"])
def test_show_refuses_what_is_not_there(tmp_path: Path, source: str) -> None:
    with pytest.raises(HardwareError) as caught:
        run(tmp_path, "show", source)
    assert caught.value.code in (
        CameraFault.NO_WEBCAM, CameraFault.WEBCAM_NOT_FOUND, RecordingFault.NOT_FOUND
    )  # fmt: skip


def test_calibrate_measures_a_folder_of_boards_and_keeps_it(tmp_path: Path) -> None:
    boards = tmp_path / "boards"
    boards.mkdir()
    for number, view in enumerate(VIEWS):
        cv2.imwrite(str(boards / f"{number}.png"), seen_board(LENS, *view))
    home = tmp_path / "home"
    size = ("--columns", str(BOARD.columns), "--rows", str(BOARD.rows), "--square-mm", "30")
    output = run(home, "calibrate", str(boards), "--camera", "USB Cam", *size)
    assert "residual" in output
    kept = load(home / "cameras.toml", "USB Cam")
    assert kept is not None
    assert kept.fx_px == pytest.approx(LENS.fx_px, rel=0.01)


def test_calibrate_opens_a_camera_measured_before_at_another_resolution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = find_home(tmp_path)
    save(home.cameras, "C920", LENS, 0.2, print)
    monkeypatch.setattr(cv2, "VideoCapture", GreyCapture)
    monkeypatch.setattr(webcam, "list_webcams", lambda _: (WebcamEntry(index=0, name="C920"),))
    name, images = _images("C920", "", home)
    with closing(images):
        assert (name, next(images).shape) == ("C920", (480, 640, 3))


def test_calibrate_ends_with_a_video_and_refuses_a_realsense(kept: Kept, tmp_path: Path) -> None:
    with refused(CameraFault.TOO_FEW_CHESSBOARDS, found=0):
        run(tmp_path, "calibrate", str(kept.video))
    with refused(CameraFault.FACTORY_CALIBRATED):
        run(tmp_path, "calibrate", "realsense")


def test_calibrate_refuses_a_folder_without_a_name_or_a_board(kept: Kept, tmp_path: Path) -> None:
    with refused(CameraFault.CAMERA_NAME_MISSING):
        run(tmp_path, "calibrate", str(kept.folder))
    with refused(CameraFault.TOO_FEW_CHESSBOARDS, found=0):
        run(tmp_path, "calibrate", str(kept.folder), "--camera", "x")
