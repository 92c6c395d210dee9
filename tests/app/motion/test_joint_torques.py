"""The estimated torque of a path, against energy: what the joints do is what the masses gain."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.kinematics import Array
from app.motion.path import LEFT, RIGHT, Path, path_of_joints, ticks
from app.motion.plan import Patient, patient_of
from app.motion.plan_check import GRAVITY_M_S2, ankle_moment, joint_torques
from hal.joints.body import (
    COM_OF_SHANK,
    COM_OF_THIGH,
    DEVICE_ON_SHANK,
    DEVICE_ON_THIGH,
    GYRATION_OF_SHANK,
    GYRATION_OF_THIGH,
    TRUNK_COM_OF_STATURE,
)
from hal.joints.device import load_exoskeleton
from hal.joints.protocol import TICK_HZ
from profiles.schema import Profile, Sex

PATIENT = patient_of(Profile(identifier="p", sex=Sex.MALE, stature_m=1.75, mass_kg=70.0), load_exoskeleton())
TIME_S = ticks(2.0)


def supported(share: float) -> Patient:
    return replace(PATIENT, body=replace(PATIENT.body, body_weight_support=share))


def bends(amounts_rad: tuple[float, float, float, float]) -> Array:
    """Each joint from straight to the given angle and back, smoothly, (n, 4)."""
    bend: Array = (1 - np.cos(2 * np.pi * TIME_S / TIME_S[-1])) / 2
    return np.multiply.outer(bend, amounts_rad)


def on_left_foot(who: Patient, joints_rad: Array, left_share: float, lean_rad: float) -> Path:
    """The left foot stays on the floor, the trunk keeps its lean; the right foot goes where its joints put it."""
    leans = np.full(len(TIME_S), lean_rad)
    path = path_of_joints(who.body, TIME_S, joints_rad + np.outer(leans, [1, 0, 1, 0]), leans)
    shares = (np.full(len(TIME_S), left_share), np.full(len(TIME_S), 1 - left_share))
    left, right = (replace(foot, share=share) for foot, share in zip(path.feet, shares, strict=True))
    return replace(path, feet=(left, right))


def rate(values: Array) -> Array:
    turned: Array = np.gradient(values, 1 / TICK_HZ, axis=0)
    return turned


def thigh_angle(path: Path, side: int) -> Array:
    """From the vertical, (n,) radians."""
    angle: Array = path.joints_rad[:, 2 * side] - path.lean_rad
    return angle


def shank_angle(path: Path, side: int) -> Array:
    """From the vertical, (n,) radians."""
    return thigh_angle(path, side) - path.joints_rad[:, 2 * side + 1]


def along(angle_rad: Array) -> Array:
    return np.stack([np.sin(angle_rad), -np.cos(angle_rad)], axis=-1)


class Mass(NamedTuple):
    """A segment with what of the device is on it: place (n, 2), angle (n,)."""

    mass_kg: float
    gyration_m: float
    place_m: Array
    angle_rad: Array


def masses(who: Patient, path: Path) -> list[Mass]:
    """Trunk, thighs, shanks and feet."""
    body = who.body
    trunk_kg = body.trunk_kg + (1 - 2 * DEVICE_ON_THIGH - 2 * DEVICE_ON_SHANK) * who.device_kg
    found = [
        Mass(trunk_kg, 0.0, path.hip_m - TRUNK_COM_OF_STATURE * body.stature_m * along(-path.lean_rad), path.lean_rad)
    ]
    for side in (LEFT, RIGHT):
        thigh, shank = thigh_angle(path, side), shank_angle(path, side)
        thigh_m = path.hip_m + COM_OF_THIGH * body.thigh_m * along(thigh)
        shank_m = path.hip_m + body.thigh_m * along(thigh) + COM_OF_SHANK * body.shank_m * along(shank)
        thigh_kg = body.thigh_kg + DEVICE_ON_THIGH * who.device_kg
        shank_kg = body.shank_kg + DEVICE_ON_SHANK * who.device_kg
        found += [
            Mass(thigh_kg, GYRATION_OF_THIGH * body.thigh_m, thigh_m, thigh),
            Mass(shank_kg, GYRATION_OF_SHANK * body.shank_m, shank_m, shank),
            Mass(body.foot_kg, 0.0, path.feet[side].ankle_m, shank),
        ]
    return found


def energy(segments: list[Mass]) -> Array:
    """Kinetic and potential, (n,) joules."""
    total: Array = np.sum(
        [
            mass * (GRAVITY_M_S2 * place[:, 1] + (rate(place) ** 2).sum(axis=1) / 2)
            + mass * gyration**2 * rate(angle) ** 2 / 2
            for mass, gyration, place, angle in segments
        ],
        axis=0,
    )
    return total


def assert_power_is_balanced(who: Patient, path: Path) -> None:
    """Joints, the harness at the trunk and the passive ankles of the feet on the floor do all the work."""
    body, segments = who.body, masses(who, path)
    weight_n = sum(segment.mass_kg for segment in segments) * GRAVITY_M_S2
    harness_n = body.body_weight_support * weight_n
    rising_n = np.sum([segment.mass_kg * rate(rate(segment.place_m[:, 1])) for segment in segments], axis=0)
    given_w = (joint_torques(who, path) * rate(path.joints_rad)).sum(axis=1) + harness_n * rate(path.hip_m[:, 1])
    for side in (LEFT, RIGHT):
        shank = shank_angle(path, side)
        under_foot_n = path.feet[side].share * (weight_n + rising_n - harness_n)
        moment = np.clip(ankle_moment(-shank), -body.heel_m * under_foot_n, body.toe_m * under_foot_n)
        given_w += moment * rate(shank)
    gained_w = rate(energy(segments))
    inside = slice(3, -3)  # differences at the ends are coarse
    np.testing.assert_allclose(given_w[inside], gained_w[inside], atol=0.01 * float(np.abs(gained_w).max()))


BENDS_RAD = st.tuples(st.floats(0.1, 0.8), st.floats(0.2, 0.8))  # hip, knee
SWINGS_RAD = st.tuples(st.floats(-0.2, 1.0), st.floats(0.2, 1.2))
SUPPORTS = st.sampled_from([0.0, 0.3])
LEANS_RAD = st.floats(-0.1, 0.4)


@given(BENDS_RAD, SWINGS_RAD, SUPPORTS, LEANS_RAD)
@settings(max_examples=30, deadline=None)
def test_the_joints_do_the_work_of_a_leg_that_swings(
    bend_rad: tuple[float, float], swing_rad: tuple[float, float], support: float, lean_rad: float
) -> None:
    who = supported(support)
    assert_power_is_balanced(who, on_left_foot(who, bends((*bend_rad, *swing_rad)), 1.0, lean_rad))


@given(BENDS_RAD, st.sampled_from([0.0, 0.05, 0.5, 0.95]), SUPPORTS, LEANS_RAD)
@settings(max_examples=30, deadline=None)
def test_the_joints_do_the_work_of_two_legs_that_bend_on_the_floor(
    bend_rad: tuple[float, float], left_share: float, support: float, lean_rad: float
) -> None:
    who = supported(support)
    assert_power_is_balanced(who, on_left_foot(who, bends((*bend_rad, *bend_rad)), left_share, lean_rad))
