"""`rleex simulate`: what it prints, keeps and draws, and what a rehearsal is blamed for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import msgspec
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.evaluate.loop.rehearsal import actions_named, corner_profiles, read_norm
from app.ipc.states import Action
from app.motion.plan import PlanFault, patient_of
from app.motion.preflight import cleared_actions
from app.motion.rehearsal_checks import RehearsalFault, RehearsalVerdict, faults_of
from app.playback.film import FilmFault
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render
from hal.joints.device import load_exoskeleton
from logs.reason import key_of, reason
from profiles.files import encode
from profiles.schema import DEMO_PATIENT
from tests.support.disks import full_disk

GOOD = RehearsalVerdict(
    action=Action.WALK,
    passed=True,
    reasons=(),
    peak_torque_nm=(50.0, 50.0, 50.0, 50.0),
    torque_limit_nm=(100.0, 100.0, 100.0, 100.0),
    peak_speed_deg_s=(90.0, 90.0, 90.0, 90.0),
    speed_limit_deg_s=(200.0, 200.0, 200.0, 200.0),
    tracking_rms_deg=(1.0, 1.0, 1.0, 1.0),
    clearance_m=0.03,
    slide_m=0.01,
    penetration_m=0.002,
)
F = RehearsalFault
BAD: dict[RehearsalFault, dict[str, Any]] = {
    F.TRACKING_ERROR: {"tracking_rms_deg": (1.0, 2.1, 1.0, 1.0)},
    F.TOO_FAST: {"peak_speed_deg_s": (90.0, 90.0, 201.0, 90.0)},
    F.SATURATED: {"peak_torque_nm": (100.0, 50.0, 50.0, 50.0)},
    F.TOO_LITTLE_CLEARANCE: {"clearance_m": 0.019},
    F.FOOT_SLIDES: {"slide_m": 0.021},
    F.PENETRATION: {"penetration_m": 0.006},
}


@pytest.mark.parametrize("fault", BAD)
def test_each_figure_beyond_its_limit_is_the_only_fault(fault: RehearsalFault) -> None:
    (found,) = faults_of(msgspec.structs.replace(GOOD, **BAD[fault]), 0.0, struck=False)
    assert found.code == key_of(fault)
    assert render(found)


def test_a_good_rehearsal_passes_and_where_no_foot_swings_none_comes_too_near() -> None:
    assert list(faults_of(GOOD, 0.1, struck=False)) == []
    assert list(faults_of(msgspec.structs.replace(GOOD, clearance_m=None), 0.0, struck=False)) == []


def test_a_struck_obstacle_and_a_wrong_end_are_reported() -> None:
    found = list(faults_of(GOOD, 0.2, struck=True))
    assert found == [reason(F.WRONG_END_POSE, angle_rad=0.2), reason(F.STRIKES_OBSTACLE)]


def test_an_action_is_rehearsed_drawn_filmed_and_kept(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("figures.json", "plot.png", "film.mp4")]
    options = ["--preflight", "--json", str(files[0]), "--plot", str(files[1]), "--video", str(files[2])]
    result = CliRunner().invoke(cli, ["simulate", "sit-down", "--home", str(tmp_path), *options])
    assert result.exit_code == 0, result.output
    assert "passed" in result.output
    assert "patient" in result.output
    (figures,) = json.loads(files[0].read_text(encoding="utf-8"))
    assert figures["passed"]
    assert 0 < max(figures["tracking_rms_deg"]) <= 2
    assert cv2.imread(str(files[1])) is not None
    film = cv2.VideoCapture(str(files[2]))
    assert film.read()[0]
    film.release()
    device = load_exoskeleton()
    assert cleared_actions(Home(tmp_path), patient_of(DEMO_PATIENT, device), device) == {Action.SIT_DOWN}


def test_a_film_that_did_not_reach_the_disk_is_refused_and_nothing_is_left_of_it(tmp_path: Path) -> None:
    with full_disk(20_000):
        options = ["sit-down", "--home", str(tmp_path), "--video", str(tmp_path / "film.mp4")]
        result = CliRunner().invoke(cli, ["simulate", *options])
    assert isinstance(result.exception, AppError)
    assert result.exception.code is FilmFault.NOT_WHOLE
    assert not list(tmp_path.iterdir())


def test_an_action_that_does_not_pass_is_reported_by_the_exit_status(tmp_path: Path) -> None:
    high = msgspec.structs.replace(DEMO_PATIENT.gait, chair_height_m=0.6)
    short = msgspec.structs.replace(DEMO_PATIENT, stature_m=1.2, gait=high)
    profile = tmp_path / "short.toml"
    profile.write_text(encode(short), encoding="utf-8")
    figures = tmp_path / "figures.json"
    options = ["--profile", str(profile), "--home", str(tmp_path), "--json", str(figures)]
    result = CliRunner().invoke(cli, ["simulate", "sit-down", *options])
    assert result.exit_code == 1, result.output
    (verdict,) = json.loads(figures.read_text(encoding="utf-8"))
    assert not verdict["passed"]
    assert verdict["reasons"][0]["code"] == key_of(PlanFault.CHAIR_DOES_NOT_FIT)


def test_an_unknown_action_is_answered_with_the_names() -> None:
    with pytest.raises(AppError, match="stair-up"):
        actions_named("jump")


def test_a_folder_without_curves_is_named(tmp_path: Path) -> None:
    with pytest.raises(AppError, match=str(tmp_path)):
        read_norm(tmp_path)


def test_the_corners_are_the_four_extremes() -> None:
    found = {(profile.stature_m, profile.mass_kg) for profile in corner_profiles()}
    assert found == {(1.45, 45.0), (1.45, 110.0), (1.95, 45.0), (1.95, 110.0)}
