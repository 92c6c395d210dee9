"""Steps from joint angles alone: planned walks, whose footprints are known exactly; and legs that do not walk."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from app.ipc.states import Action
from app.motion.path import LEFT, RIGHT
from app.motion.plan import Patient, Phase, patient_of
from app.motion.trajectory import path_of
from app.outcomes.measures import LegHistory, Measures, asymmetry_percent, measure
from app.outcomes.steps import STILL_TICKS, find_steps, resting
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from hal.joints.protocol import TICK_HZ
from profiles.schema import GaitParameters, Profile, Sex

STANDING = 600  # ticks
ROLLED = (
    0.025  # a plan rolls both feet where its ankles are level; feet on a floor do not, see test_outcomes_command.py
)
PHASES = (Phase.WALK_START, Phase.WALK_RIGHT, Phase.WALK_LEFT, Phase.WALK_CLOSE_RIGHT)


def patient(stature_m: float, step_m: float, **lengths_m: float | None) -> Patient:
    profile = Profile(
        identifier="planned",
        sex=Sex.FEMALE,
        stature_m=stature_m,
        mass_kg=60.0,
        gait=GaitParameters(step_length_m=step_m),
        thigh_length_m=lengths_m.get("thigh_m"),
        shank_length_m=lengths_m.get("shank_m"),
    )
    return patient_of(profile, load_exoskeleton(DEFAULT_DEVICE))


def planned(who: Patient) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Standing, four steps, standing, as the planner makes them."""
    parts = [
        path_of(Action.WALK_END if phase is Phase.WALK_CLOSE_RIGHT else Action.WALK, phase, who).joints_rad
        for phase in PHASES
    ]
    still = [np.repeat(parts[0][:1], STANDING, axis=0), np.repeat(parts[-1][-1:], STANDING, axis=0)]
    return np.concatenate([still[0], *parts, still[1]])


def test_stairs_between_two_walks_are_no_walking() -> None:
    who = patient(1.70, 0.30)
    walk, stair = planned(who), path_of(Action.STAIR_UP, Phase.WHOLE, who).joints_rad
    rest = np.repeat(walk[:1], 300, axis=0)  # shorter than what counts as standing
    walk = walk[STANDING:-STANDING]
    parts = [(rest, True), (walk, True), (rest, True), (stair, False), (rest, True), (walk, True), (rest, True)]
    joints_rad = np.concatenate([part for part, _ in parts])
    walking = np.concatenate([np.full(len(part), walks) for part, walks in parts])
    always = np.ones(len(joints_rad), dtype=bool)
    found = measure(LegHistory(body=who.body, joints_rad=joints_rad, powered=always, walking=walking))
    alone = measured(who, np.concatenate([rest, walk, rest]))
    assert (found.steps, alone.steps) == (8, 4)
    assert alone.walking_time_s is not None
    assert found.walking_time_s == pytest.approx(2 * alone.walking_time_s, abs=0.1)
    assert found.range_of_motion["left_knee"].high_deg == pytest.approx(
        alone.range_of_motion["left_knee"].high_deg, abs=0.5
    )


def measured(who: Patient, joints_rad: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> Measures:
    always = np.ones(len(joints_rad), dtype=bool)
    return measure(LegHistory(body=who.body, joints_rad=joints_rad, powered=always, walking=always))


@pytest.mark.parametrize(
    ("stature_m", "step_m", "thigh_m", "shank_m"),
    [(1.55, 0.22, None, None), (1.70, 0.30, None, None), (1.75, 0.30, 0.46, 0.40)],
)
def test_planned_footprints(stature_m: float, step_m: float, thigh_m: float | None, shank_m: float | None) -> None:
    who = patient(stature_m, step_m, thigh_m=thigh_m, shank_m=shank_m)
    found = measured(who, planned(who))
    assert found.steps == 4
    assert found.distance_m == pytest.approx(3 * step_m, rel=ROLLED)
    assert found.step_length_left_m == pytest.approx(step_m, rel=ROLLED)
    assert found.step_length_right_m == pytest.approx(step_m, rel=ROLLED)


@pytest.mark.parametrize(("step_m", "step_s"), [(0.10, 10.0), (0.10, 8.0), (0.05, 10.0)])
def test_legs_that_creep_where_the_foot_lands_do_not_stand(step_m: float, step_s: float) -> None:
    """The joints are as slow as at rest for some tenths of a second there, and the ankles 13 mm from level."""
    who = patient(1.70, step_m)
    who = replace(who, gait=msgspec.structs.replace(who.gait, step_time_s=step_s))
    joints_rad = planned(who)
    found = measured(who, joints_rad)
    assert [step.from_standing for step in find_steps(who.body, joints_rad)] == [True, False, False, False]
    assert found.distance_m == pytest.approx(3 * step_m, abs=3 * 0.006)
    assert found.step_length_left_m == pytest.approx(step_m, abs=0.006)
    assert found.step_length_right_m == pytest.approx(step_m, abs=0.006)
    assert found.cadence_steps_min == pytest.approx(60 / step_s, rel=0.01)


def test_sides_in_order() -> None:
    who = patient(1.70, 0.30)
    steps = find_steps(who.body, planned(who))
    assert [step.side for step in steps] == [LEFT, RIGHT, LEFT, RIGHT]
    assert [step.from_standing for step in steps] == [True, False, False, False]
    assert all(step.began < step.landed for step in steps)


def test_a_step_paused_in_the_air_is_one_step() -> None:
    who = patient(1.70, 0.30)
    joints_rad = planned(who)
    first = find_steps(who.body, joints_rad)[1]
    middle = (first.began + first.landed) // 2
    paused = np.concatenate(
        [joints_rad[:middle], np.repeat(joints_rad[middle : middle + 1], 1500, axis=0), joints_rad[middle:]]
    )
    before, after = measured(who, joints_rad), measured(who, paused)
    assert after.steps == before.steps
    assert after.distance_m == pytest.approx(before.distance_m)
    assert after.walking_time_s == pytest.approx(before.walking_time_s, abs=0.1)  # a pause of 3 s is no walking


@pytest.mark.parametrize("ticks", [0, 1, 30, 2000])
def test_standing_still(ticks: int) -> None:
    who = patient(1.70, 0.30)
    joints_rad = np.repeat(planned(who)[:1], ticks, axis=0)
    found = measured(who, joints_rad)
    assert (found.steps, found.distance_m, found.speed_m_s, found.cadence_steps_min) == (0, None, None, None)
    assert found.up_time_s == pytest.approx(ticks * 0.002)
    assert resting(joints_rad).sum() == (ticks if ticks >= STILL_TICKS else 0)


def test_asymmetry_by_robinson() -> None:
    assert asymmetry_percent(0.3, 0.2) == pytest.approx(40.0)
    assert asymmetry_percent(0.2, 0.3) == asymmetry_percent(0.3, 0.2)
    assert asymmetry_percent(None, 0.3) is None


@pytest.mark.parametrize(("speed_rad_s", "seconds"), [(0.015, 6.0), (0.010, 8.0), (0.005, 15.0), (0.018, 3.0)])
def test_a_leg_that_creeps_and_then_rests_makes_no_step(speed_rad_s: float, seconds: float) -> None:
    """Slower than what counts as motion, after a twitch of the other knee that ends the rest before."""
    time_s = np.arange(20_000) / TICK_HZ
    joints_rad = np.full((len(time_s), 4), np.radians(8.0))
    joints_rad[:, 3] += 0.006 * np.clip((time_s - 5.0) / 0.1, 0.0, 1.0)
    joints_rad[:, 0] += speed_rad_s * np.clip(time_s - 5.3, 0.0, seconds)
    for angles_rad in (joints_rad, joints_rad[::-1]):
        found = measured(patient(1.70, 0.30), angles_rad)
        assert (found.steps, found.walking_time_s) == (0, 0)
