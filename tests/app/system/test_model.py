"""The hand model: named when missing, refused when damaged, built only from the networks that were checked."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

import pytest

from app.cli import main
from app.system import hand_model
from app.system.config import Config
from app.system.errors import AppError
from app.system.hand_model import MODEL_NAME, ModelFault, build_bundle, find_model, set_up_model
from app.system.paths import Home
from app.text.catalogue import render


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


def test_a_model_is_replaced_by_the_one_that_is_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def wheel(folder: Path) -> Path:
        with zipfile.ZipFile(folder / "mediapipe.whl", "w") as archive:
            archive.writestr("hand.tflite", b"network")
        return folder / "mediapipe.whl"

    networks = {"hand.tflite": ("hand.tflite", hashlib.sha256(b"network").hexdigest())}
    monkeypatch.setattr(hand_model, "_NETWORKS", networks)
    monkeypatch.setattr(hand_model, "_download", wheel)
    path = tmp_path / "models" / MODEL_NAME
    path.parent.mkdir()
    path.write_bytes(b"damaged")
    assert set_up_model(Home(tmp_path), Config(), again=True) == path
    with zipfile.ZipFile(path) as bundle:
        assert bundle.read("hand.tflite") == b"network"


def test_a_model_stays_when_no_other_can_be_had_or_another_is_configured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "1")  # as without a network
    path = tmp_path / "models" / MODEL_NAME
    path.parent.mkdir()
    path.write_bytes(b"a model")
    for config, fault in ((Config(), ModelFault.NOT_DOWNLOADED), (Config(model="own.task"), ModelFault.CONFIGURED)):
        with pytest.raises(AppError) as refused:
            set_up_model(Home(tmp_path), config, again=True)
        assert refused.value.code is fault
        assert render(refused.value)
        assert path.read_bytes() == b"a model"


def test_the_command_refuses_to_build_beside_a_configured_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "models" / MODEL_NAME
    path.parent.mkdir()
    path.write_bytes(b"a model")
    (tmp_path / "own.task").touch()
    (tmp_path / "config.toml").write_text(f'model = "{tmp_path}/own.task"')
    monkeypatch.setattr("sys.argv", ["rleex", "model", "--again", "--home", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert f"{tmp_path}/own.task" in capsys.readouterr().err
    assert path.read_bytes() == b"a model"
