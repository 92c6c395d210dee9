"""`rleex camera`: its arguments, its output, and its errors."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from app.cli.camera import cli
from hal.cameras.intrinsics import load
from hal.errors import CameraFault, HardwareError, RecordingFault
from tests.hal.cameras.conftest import Kept
from tests.hal.cameras.test_intrinsics import BOARD, LENS, VIEWS, seen_board
from tests.support.errors import refused


def run(home: Path, *text: str) -> str:
    """The command's output; what it raises goes to the program's own last line of defence."""
    result = CliRunner().invoke(cli, [*text, "--home", str(home)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


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


def test_calibrate_refuses_a_folder_without_a_name_or_a_board(kept: Kept, tmp_path: Path) -> None:
    with refused(CameraFault.CAMERA_NAME_MISSING):
        run(tmp_path, "calibrate", str(kept.folder))
    with refused(CameraFault.TOO_FEW_CHESSBOARDS, found=0):
        run(tmp_path, "calibrate", str(kept.folder), "--camera", "x")
