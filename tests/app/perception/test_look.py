"""A camera that only looks, in its own process: it ends with the reason why, not with a guess."""

from __future__ import annotations

from multiprocessing import Pipe
from pathlib import Path
from threading import Thread
from unittest.mock import sentinel

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.cli.compare_cameras import compare_cameras
from app.ipc.streams import LinkDirectory
from app.perception import camera_names
from app.perception.look import LookFault, _Look
from app.system.config import Config, SessionSetup
from app.system.errors import AppError
from app.system.hand_model import ModelFault
from app.system.paths import Home
from hal.errors import CameraFault, RecordingFault
from logs.reason import Reason, reason
from profiles.schema import DEMO_PATIENT
from tests.app.perception.test_camera_supervisor import Fragile

pytestmark = pytest.mark.serial
LIMIT_S = 30.0


def test_a_comparison_sets_up_the_hand_model_first_as_a_session_does(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text('model = "/nowhere/hand.task"\n', encoding="utf-8")
    done = CliRunner().invoke(cli, ["camera", "compare", "digital-hand", "digital-d435i", "--home", str(tmp_path)])
    assert isinstance(done.exception, AppError)
    assert done.exception.code is ModelFault.CONFIGURED_MISSING


def test_a_camera_that_can_t_be_opened_ends_the_comparison_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = Home(tmp_path)
    (tmp_path / "hand.task").touch()  # it is not come to
    home.config.write_text(f'model = "{tmp_path / "hand.task"}"\n', encoding="utf-8")
    monkeypatch.setattr(camera_names, "RATES_HZ", (0.1, 999.0))  # the digital hand itself refuses it, in its process
    sources = ("digital-hand@999", "digital-hand")
    with pytest.raises(AppError) as refused:
        compare_cameras(home, sources, seconds=1, alone_s=0, ruler_m=None, patient=DEMO_PATIENT)
    assert refused.value.code is LookFault.NO_FRAME
    assert refused.value.values["camera"] == sources[0]
    why = refused.value.values["why"]
    assert isinstance(why, Reason)
    assert why.code == reason(CameraFault.RATE_OUT_OF_RANGE).code


def test_a_recording_that_ends_ends_the_looking_with_its_reason(tmp_path: Path) -> None:
    links = LinkDirectory(path=tmp_path, public=b"", secret=b"")
    setup = SessionSetup(session="s", home=tmp_path, links=links, config=Config(), profile=DEMO_PATIENT, operator="")
    ours, theirs = Pipe()
    looking = Thread(target=_Look(theirs, setup, Fragile(frames_left=0), sentinel.unused).run, daemon=True)
    looking.start()
    looking.join(LIMIT_S)
    assert not looking.is_alive()
    assert ours.recv() == reason(RecordingFault.ENDED)
