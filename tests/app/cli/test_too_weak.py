"""Simulations of a patient whom the device can't carry: one sentence with the reason, and status 2."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from msgspec.structs import replace

from app.cli import main
from hal.joints.device import DEFAULT_DEVICE
from profiles.files import encode
from profiles.schema import DEMO_PATIENT


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "config.toml").touch()
    return tmp_path


def refused(
    arguments: list[str], home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> str:
    """The one line that `rleex` writes to stderr before it ends with status 2."""
    monkeypatch.setattr(sys, "argv", ["rleex", *arguments, "--home", str(home)])
    with pytest.raises(SystemExit) as caught:
        main()
    (line,) = capsys.readouterr().err.splitlines()
    assert caught.value.code == 2
    return line


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("evaluate outcomes", "The simulated patients can't walk in this device: The right hip would need 31 Nm"),
        ("simulate dropout", "This patient can't carry out “step, right first” in this device: The left hip"),
    ],
)
def test_a_device_with_weak_joints_is_refused(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str, named: str
) -> None:
    described = DEFAULT_DEVICE.read_text(encoding="utf-8")
    weak = described.replace("max_torque_nm = 110.0", "max_torque_nm = 30.0")
    (home / "weak.toml").write_text(weak, encoding="utf-8")
    (home / "config.toml").write_text(f'[joints]\ndevice = "{home / "weak.toml"}"\n', encoding="utf-8")
    line = refused(command.split(), home, monkeypatch, capsys)
    assert line.startswith(f"rleex: {named}")
    assert "its limit is 27 Nm" in line


def test_a_patient_too_heavy_for_an_action_is_refused(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    heavy = replace(DEMO_PATIENT, identifier="heavy", stature_m=2.1, mass_kg=180.0)
    (home / "heavy.toml").write_text(encode(heavy), encoding="utf-8")
    line = refused(["simulate", "dropout", "-p", str(home / "heavy.toml")], home, monkeypatch, capsys)
    assert line.startswith("rleex: This patient can't carry out “step, right first” in this device: The left hip")
    assert "its limit is 99 Nm" in line
