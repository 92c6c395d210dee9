"""Leg kinematics: forward and inverse undo one another, and the signs are those of the drives."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.motion import kinematics
from hal.joints.body import average_body

statures = st.floats(1.2, 2.2)
hips = st.floats(np.radians(-30), np.radians(120))
knees = st.floats(np.radians(1), np.radians(130))
leans = st.floats(0, np.radians(30))


@given(statures, hips, knees, leans)
def test_inverse_kinematics_undoes_forward(stature: float, hip: float, knee: float, lean: float) -> None:
    body = average_body(stature, 70.0)
    found = kinematics.joints(body, kinematics.ankle(body, np.array(hip), np.array(knee), lean), lean)
    turned = (found.hip - hip + np.pi) % (2 * np.pi) - np.pi
    assert abs(turned) < 1e-6
    assert abs(found.knee - knee) < 1e-6


def test_flexing_the_hip_brings_the_foot_forward_and_flexing_the_knee_brings_it_back() -> None:
    body = average_body(1.7, 70.0)
    straight = kinematics.ankle(body, np.array(0.0), np.array(0.0))
    assert kinematics.ankle(body, np.array(0.3), np.array(0.0))[0] > straight[0]
    assert kinematics.ankle(body, np.array(0.0), np.array(0.3))[0] < straight[0]
    assert straight[1] == -(body.thigh_m + body.shank_m)


def test_a_place_out_of_reach_is_no_number() -> None:
    body = average_body(1.7, 70.0)
    assert np.isnan(kinematics.joints(body, np.array([0.0, -(body.thigh_m + body.shank_m) - 0.01])).knee)


@given(statures, st.floats(-0.8, 0.8))
def test_the_sole_keeps_its_length_and_its_height_below_the_ankle(stature: float, pitch: float) -> None:
    body = average_body(stature, 70.0)
    heel, toe = kinematics.sole(body, np.array(pitch))
    assert np.isclose(np.hypot(*(toe - heel)), body.heel_m + body.toe_m)
    assert np.isclose(np.hypot(*heel), np.hypot(body.heel_m, body.ankle_height_m))
    assert np.isclose(np.arctan2(toe[1] - heel[1], toe[0] - heel[0]), pitch)
