"""`rleex profile calibrate` uses what `rleex camera calibrate` measured."""

from __future__ import annotations

from contextlib import nullcontext
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import profile as commands
from app.cli.tree import tree
from app.perception import palm_calibration
from app.perception.palm_calibration import WANTED_SAMPLES, PalmSampler
from app.system.paths import Home
from hal.cameras.intrinsics import assumed
from hal.errors import CameraFault, HardwareError
from profiles.errors import ProfileError, ProfileFault
from profiles.schema import DEMO_PATIENT, Profile
from profiles.store import ProfileStore
from testing.authors import Named
from tests.support.calibrations import calibrated_with


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
    for distance in ("-1", "0", "14", "81", "1e30"):  # refused before a palm is asked for
        done = CliRunner().invoke(tree(), ["profile", "calibrate", "demo", f"--distance={distance}"])
        assert isinstance(done.exception, ProfileError), done.output
        assert (done.exception.code, done.output) == (ProfileFault.DISTANCE, "")


def test_what_others_change_while_a_palm_is_held_before_the_camera_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Home(tmp_path / "home")
    place.root.mkdir()
    monkeypatch.setenv("RLEEX_HOME", str(place.root))
    store = ProfileStore(place.profiles)

    def sample(profile: Profile, *_: Any) -> PalmSampler:
        noted = msgspec.structs.replace(DEMO_PATIENT, note="left side weak")
        store.save(noted, by=Named("Bea"), at=datetime.now(UTC))
        detector = SimpleNamespace(detect=lambda *_: ())
        return PalmSampler(profile, detector, [0.3] * WANTED_SAMPLES, _lens=assumed(1280, 720))

    monkeypatch.setattr(palm_calibration, "sample_palm", sample)
    monkeypatch.setattr(commands, "_watching", lambda _: nullcontext((SimpleNamespace(name="grey"), None)))
    done = CliRunner().invoke(tree(), ["profile", "calibrate", "demo", "--distance", "30"])
    assert done.exit_code == 0, done.output
    kept = store.load("demo")
    assert ([one.camera for one in kept.calibrations], kept.note) == (["grey"], "left side weak")


@pytest.mark.parametrize(
    "command", ["new P-1 --sex male --stature 170 --mass 70 identifier=P-9", "set demo identifier=P-9"]
)
def test_a_field_names_no_other_patient(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    place = Home(tmp_path / "home")
    place.root.mkdir()
    monkeypatch.setenv("RLEEX_HOME", str(place.root))
    done = CliRunner().invoke(tree(), ["profile", *command.split()])
    assert isinstance(done.exception, ProfileError), done.output
    assert done.exception.code is ProfileFault.IDENTIFIER_FIXED
    assert not list(place.profiles.glob("*.toml"))


def test_the_list_shows_a_palm_by_its_newest_calibration_and_names_the_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RLEEX_HOME", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "200")
    store = ProfileStore(Home(tmp_path).profiles)
    newest = calibrated_with(camera="[b]webcam", focal_anchor_px_m=36.0, calibrated_at="2026-05-20T06:00:00+00:00")
    older = msgspec.structs.replace(newest, camera="other", calibrated_at="2026-05-01T06:00:00+00:00")
    for name, calibrations in (("P-1", ()), ("P-2", (newest, older))):
        made = msgspec.structs.replace(DEMO_PATIENT, identifier=name, calibrations=calibrations)
        store.create(made, by=Named(""), at=datetime.now(UTC))
    lines = CliRunner().invoke(tree(), ["profile", "list"]).output.splitlines()
    (without,), (calibrated,) = ([line for line in lines if name in line] for name in ("P-1", "P-2"))
    assert "cm, estimated " in without
    assert "6.0 ± 0.1 cm, calibrated, [b]webcam " in calibrated


def test_a_profile_is_shown_without_what_steers_a_terminal(tmp_path: Path) -> None:
    calibration = calibrated_with(camera="web\x9b2J\u202ecam\x85\u2028")
    noted = msgspec.structs.replace(DEMO_PATIENT, identifier="P-1", calibrations=(calibration,), note="a\nb")
    store = ProfileStore(Home(tmp_path).profiles)
    store.create(noted, by=Named(""), at=datetime.now(UTC))
    done = CliRunner().invoke(tree(), ["profile", "show", "P-1", "--home", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert [line for line in done.output.split("\n") if not line.isprintable()] == []
    assert "web\\x9b2J\\u202ecam\\x85\\u2028" in done.output
    assert "palm" in done.output


def test_a_sex_that_no_table_has_is_refused_with_those_there_are(tmp_path: Path) -> None:
    arguments = ["profile", "new", "P-1", "--sex", "x", "--stature", "170", "--mass", "70"]
    done = CliRunner().invoke(tree(), [*arguments, "--home", str(tmp_path)])
    assert done.exit_code == 2
    assert "'female', 'male'" in done.output
