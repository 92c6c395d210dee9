"""A camera that only looks, in its own process: it ends with the reason why, not with a guess."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.cli.compare_cameras import compare_cameras
from app.system.errors import AppError
from app.system.hand_model import ModelFault
from app.system.paths import Home
from hal.errors import CameraFault
from logs.reason import reason
from profiles.schema import DEMO_PATIENT

pytestmark = pytest.mark.serial


def test_a_comparison_sets_up_the_hand_model_first_as_a_session_does(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text('model = "/nowhere/hand.task"\n', encoding="utf-8")
    done = CliRunner().invoke(cli, ["camera", "compare", "digital-hand", "digital-d435i", "--home", str(tmp_path)])
    assert isinstance(done.exception, AppError)
    assert done.exception.code is ModelFault.CONFIGURED_MISSING


def test_a_camera_that_can_t_be_opened_ends_the_comparison_with_its_reason(tmp_path: Path) -> None:
    home = Home(tmp_path)
    (tmp_path / "hand.task").touch()  # it is not come to
    home.config.write_text(f'model = "{tmp_path / "hand.task"}"\n', encoding="utf-8")
    sources = ("digital-hand@999", "digital-hand")
    found = compare_cameras(home, sources, seconds=1, alone_s=0, ruler_m=None, patient=DEMO_PATIENT)
    fault = found.faults[0]
    assert fault is not None
    assert fault.code == reason(CameraFault.RATE_OUT_OF_RANGE).code
