"""The hand model: named when missing, refused when damaged, built only from the networks that were checked."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from app.system.config import Config
from app.system.errors import AppError
from app.system.hand_model import build_bundle, find_model, set_up_model
from app.system.paths import Home


def test_missing_model_names_path_and_remedy(tmp_path: Path) -> None:
    with pytest.raises(AppError, match=r"MISSING path=.*hand_landmarker\.task"):
        find_model(Home(tmp_path), Config())


def test_damaged_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "hand_landmarker.task").write_bytes(b"not a model")
    with pytest.raises(AppError, match="DAMAGED"):
        set_up_model(Home(tmp_path), Config())


def test_configured_path_wins_and_must_exist(tmp_path: Path) -> None:
    own = tmp_path / "own.task"
    with pytest.raises(AppError, match="CONFIGURED_MISSING"):
        find_model(Home(tmp_path), Config(model=str(own)))
    own.write_bytes(b"the user's own")
    assert find_model(Home(tmp_path), Config(model=str(own))) == own


def test_wheel_with_another_network_is_refused(tmp_path: Path) -> None:
    wheel = tmp_path / "mediapipe.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("mediapipe/modules/palm_detection/palm_detection_full.tflite", b"tampered")
    with pytest.raises(AppError, match="UNEXPECTED_NETWORK"):
        build_bundle(wheel)


@pytest.mark.parametrize("content", [b"", b"not a zip"])
def test_broken_wheel_is_refused(tmp_path: Path, content: bytes) -> None:
    wheel = tmp_path / "mediapipe.whl"
    wheel.write_bytes(content)
    with pytest.raises(AppError, match="NOT_IN_WHEEL"):
        build_bundle(wheel)
