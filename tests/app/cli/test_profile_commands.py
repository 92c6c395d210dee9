"""`rleex profile calibrate` uses what `rleex camera calibrate` measured."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli.tree import tree
from app.system.paths import Home
from hal.errors import CameraFault, HardwareError


def test_a_palm_is_calibrated_with_the_cameras_measured_intrinsics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, folder = Home(tmp_path / "home"), tmp_path / "images"
    monkeypatch.setenv("RLEEX_HOME", str(place.root))
    for needed in (place.root, folder):
        needed.mkdir()
    cv2.imwrite(str(folder / "0001.png"), np.zeros((48, 64, 3), np.uint8))
    place.config.write_text(f'[camera]\nkind = "recording"\ndevice = "{folder}"\n')
    place.cameras.write_text("not a table")
    done = CliRunner().invoke(tree(), ["profile", "calibrate", "demo", "--distance", "30"])
    assert isinstance(done.exception, HardwareError), done.output
    assert done.exception.code is CameraFault.INTRINSICS_UNREADABLE
