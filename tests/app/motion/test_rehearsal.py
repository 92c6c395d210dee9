"""Rehearsals: the short actions at the corners pass in simulation; a pre-flight holds for its own parameters only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from app.ipc.states import Action, GaitState
from app.motion.plan import Patient, Phase, PlanFault, PlanRequest, patient_of, quad
from app.motion.preflight import (
    PreflightFault,
    check_profile,
    cleared_actions,
    keep_verdict,
    preflight_passed,
    refuse_unfit,
)
from app.motion.rehearsal import rehearse
from app.motion.rehearsal_checks import RehearsalFault, RehearsalVerdict, faults_of
from app.motion.trajectory import nominal_pose, plan
from app.system.paths import Home
from app.text.catalogue import render
from hal.joints.device import Exoskeleton, load_exoskeleton
from logs.reason import Reason, key_of, reason
from profiles.errors import ProfileError
from profiles.schema import DEMO_PATIENT, Profile

DEVICE = load_exoskeleton()
# The corners where each movement asks most of the drives; `rleex simulate corners` runs them all.
WORST_CORNERS = (
    (Action.STEP_LEFT, 1.95, 110.0),
    (Action.STEP_LEFT, 1.45, 45.0),
    (Action.STAIR_UP, 1.95, 110.0),
    (Action.STAND_UP, 1.45, 110.0),
    (Action.STAND_UP, 1.95, 110.0),
)


def patient(profile: Profile = DEMO_PATIENT) -> Patient:
    return patient_of(profile, DEVICE)


def plan_walk(device: Exoskeleton, phase: Phase) -> Reason | None:
    """Why one step of a walk can't be planned."""
    action = Action.WALK_END if "CLOSE" in phase.name else Action.WALK
    state = GaitState.RIGHT_FORWARD if phase.name.endswith("LEFT") else GaitState.LEFT_FORWARD
    mine = patient_of(DEMO_PATIENT, device)
    start_rad = quad(nominal_pose(state, mine))
    request = PlanRequest(number=0, action=action, phase=phase, from_state=state, start_rad=start_rad)
    return plan(request, mine).check.reason


@pytest.mark.parametrize("action", list(Action))
def test_the_demo_patient_passes_every_action(action: Action) -> None:
    verdict = rehearse(patient(), DEVICE, action).verdict
    assert verdict.passed, verdict.reasons


@pytest.mark.parametrize(("action", "stature", "mass"), WORST_CORNERS)
def test_the_hardest_corners_pass(action: Action, stature: float, mass: float) -> None:
    profile = msgspec.structs.replace(DEMO_PATIENT, stature_m=stature, mass_kg=mass)
    verdict = rehearse(patient(profile), DEVICE, action).verdict
    assert verdict.passed, verdict.reasons


def test_what_cannot_be_planned_fails_with_its_reason() -> None:
    gait = msgspec.structs.replace(DEMO_PATIENT.gait, stair_rise_m=0.25, body_weight_support=0.0)
    verdict = rehearse(patient(msgspec.structs.replace(DEMO_PATIENT, gait=gait)), DEVICE, Action.STAIR_UP).verdict
    assert not verdict.passed
    assert verdict.reasons[0].code == key_of(PlanFault.TOO_MUCH_TORQUE)


SOUND = RehearsalVerdict(
    action=Action.WALK,
    passed=True,
    reasons=(),
    peak_torque_nm=(40.0, 40.0, 40.0, 40.0),
    torque_limit_nm=(80.0, 80.0, 80.0, 80.0),
    peak_speed_deg_s=(100.0, 100.0, 100.0, 100.0),
    speed_limit_deg_s=(200.0, 200.0, 200.0, 200.0),
    clearance_m=0.05,
)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({}, None),
        ({"clearance_m": None}, None),
        ({"tracking_rms_deg": (0.0, 1.9, 0.0, 0.0)}, None),
        ({"tracking_rms_deg": (0.0, 2.1, 0.0, 0.0)}, RehearsalFault.TRACKING_ERROR),
        ({"peak_speed_deg_s": (0.0, 200.1, 0.0, 0.0)}, RehearsalFault.TOO_FAST),
        ({"peak_torque_nm": (0.0, 0.0, 80.0, 0.0)}, RehearsalFault.SATURATED),
        ({"clearance_m": 0.019}, RehearsalFault.TOO_LITTLE_CLEARANCE),
        ({"slide_m": 0.021}, RehearsalFault.FOOT_SLIDES),
        ({"penetration_m": 0.0051}, RehearsalFault.PENETRATION),
    ],
)
def test_each_limit_of_a_rehearsal_fails_it_by_itself(changes: dict[str, Any], fault: RehearsalFault | None) -> None:
    found = faults_of(msgspec.structs.replace(SOUND, **changes), 0.0, struck=False)
    assert [one.code for one in found] == ([] if fault is None else [key_of(fault)])


STIFF_LEFT_KNEE = msgspec.structs.replace(DEVICE, left_knee=msgspec.structs.replace(DEVICE.left_knee, max_deg=70.0))


@pytest.mark.parametrize("action", [Action.WALK, Action.WALK_END])
def test_a_walk_passes_only_if_each_leg_can_close_it(action: Action) -> None:
    """A left knee that bends far enough for its stride, and not for its closing step."""
    assert plan_walk(STIFF_LEFT_KNEE, Phase.WALK_LEFT) is None
    why = plan_walk(STIFF_LEFT_KNEE, Phase.WALK_CLOSE_LEFT)
    assert why is not None
    verdict = rehearse(patient_of(DEMO_PATIENT, STIFF_LEFT_KNEE), STIFF_LEFT_KNEE, action).verdict
    assert not verdict.passed
    assert [one.code for one in verdict.reasons] == [why.code]


def test_a_profile_is_refused_where_one_leg_cannot_close_a_walk() -> None:
    found = {str(why.values["action"]) for why in check_profile(DEMO_PATIENT, STIFF_LEFT_KNEE)}
    assert str(reason(PreflightFault.NOT_PLANNABLE, action=Action.WALK).values["action"]) in found


STRIKES = reason(RehearsalFault.STRIKES_OBSTACLE)


def verdict(action: Action, *, passed: bool) -> RehearsalVerdict:
    return RehearsalVerdict(action=action, passed=passed, reasons=() if passed else (STRIKES,))


def test_a_preflight_is_kept_for_exactly_its_parameters(tmp_path: Path) -> None:
    home = Home(tmp_path)
    assert not preflight_passed(home, patient(), DEVICE, Action.WALK).passed
    keep_verdict(home, patient(), DEVICE, Action.WALK, verdict(Action.WALK, passed=True))
    assert preflight_passed(home, patient(), DEVICE, Action.WALK).passed
    assert cleared_actions(home, patient(), DEVICE) == {Action.WALK}
    longer = msgspec.structs.replace(DEMO_PATIENT, gait=msgspec.structs.replace(DEMO_PATIENT.gait, step_length_m=0.31))
    assert not preflight_passed(home, patient(longer), DEVICE, Action.WALK).passed
    weaker = msgspec.structs.replace(DEVICE, mass_kg=15.0)
    assert not preflight_passed(home, patient(), weaker, Action.WALK).passed


def test_a_verdict_of_another_program_clears_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = Home(tmp_path)
    with monkeypatch.context() as earlier:
        earlier.setattr("app.motion.preflight.rehearsal_identity", lambda: "0" * 64)
        keep_verdict(home, patient(), DEVICE, Action.WALK, verdict(Action.WALK, passed=True))
        assert cleared_actions(home, patient(), DEVICE) == {Action.WALK}
    assert cleared_actions(home, patient(), DEVICE) == frozenset()


def test_a_failed_preflight_reports_why(tmp_path: Path) -> None:
    home = Home(tmp_path)
    keep_verdict(home, patient(), DEVICE, Action.OBSTACLE, verdict(Action.OBSTACLE, passed=False))
    result = preflight_passed(home, patient(), DEVICE, Action.OBSTACLE)
    assert not result.passed
    assert result.reason == reason(PreflightFault.FAILED, action=Action.OBSTACLE, reasons=(STRIKES,))
    assert "strikes the obstacle" in render(result.reason)


def test_a_damaged_record_does_not_clear(tmp_path: Path) -> None:
    home = Home(tmp_path)
    keep_verdict(home, patient(), DEVICE, Action.WALK, verdict(Action.WALK, passed=True))
    for record in (tmp_path / "preflight").iterdir():
        record.write_bytes(record.read_bytes()[:-3])
    result = preflight_passed(home, patient(), DEVICE, Action.WALK)
    assert result.reason is not None
    assert result.reason.code == key_of(PreflightFault.UNREADABLE)


def test_the_demo_patient_can_be_saved() -> None:
    assert check_profile(DEMO_PATIENT, DEVICE) == []


def test_stairs_that_a_leg_cannot_climb_are_refused_when_saved_with_joint_and_number() -> None:
    steep = msgspec.structs.replace(
        DEMO_PATIENT, knee_max_rad=1.0, gait=msgspec.structs.replace(DEMO_PATIENT.gait, stair_rise_m=0.25)
    )
    with pytest.raises(ProfileError, match=r"BEYOND_FLEXION.*KNEE"):
        refuse_unfit(DEVICE)(steep)


def test_a_range_beyond_the_devices_is_refused() -> None:
    loose = msgspec.structs.replace(DEMO_PATIENT, knee_max_rad=2.4)
    assert [found.code for found in check_profile(loose, DEVICE)] != []
