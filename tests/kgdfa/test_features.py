from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kgdfa.features import FEATURES, Unit, features
from kgdfa.gesture import Finger
from kgdfa.hand import (
    INNER_HULL,
    OUTER_HULL,
    TIPS,
    FloatArray,
    Keypoint,
    angles_deg,
    apart,
    finger_angles_deg,
    hull,
    tip_depths,
)
from tests.kgdfa.hands import drawn_hand, drawn_points

JOINTS = ("root", "middle", "end")
angle = st.floats(-np.pi, np.pi)
shaken = arrays(np.float64, (21, 3), elements=st.floats(-0.01, 0.01))


def posed(shake: FloatArray) -> tuple[FloatArray, FloatArray]:
    world = drawn_hand("ofoho".replace("h", "f")).world_m + shake
    return world[:, :2] * 3000 + 400, world


def turned(points: FloatArray, radians: float) -> FloatArray:
    cosine, sine = np.cos(radians), np.sin(radians)
    out = points.copy()
    out[:, 0], out[:, 1] = (
        cosine * points[:, 0] - sine * points[:, 1],
        sine * points[:, 0] + cosine * points[:, 1],
    )
    return out


@given(shaken, st.floats(0.1, 10), st.floats(0.1, 10), angle)
def test_size_place_and_turn_in_the_image_change_nothing(
    shake: FloatArray, zoom: float, size: float, radians: float
) -> None:
    picture, world = posed(shake)
    moved = features(turned(picture, radians) * zoom + 77, turned(world, radians) * size)
    np.testing.assert_allclose(moved, features(picture, world), atol=1e-2)


@given(shaken)
def test_the_mirrored_hand_measures_the_same(shake: FloatArray) -> None:
    picture, world = posed(shake)
    np.testing.assert_allclose(features(picture * (-1, 1), world * (-1, 1, 1)), features(picture, world), atol=1e-2)


@given(shaken, angle, angle)
def test_the_view_changes_nothing_in_space(shake: FloatArray, first: float, second: float) -> None:
    picture, world = posed(shake)
    tilted = turned(turned(world, first)[:, [1, 2, 0]], second)
    spatial = [k for k, feature in enumerate(FEATURES) if not feature.on_image and "hull" not in feature.name]
    np.testing.assert_allclose(features(picture, tilted)[spatial], features(picture, world)[spatial], atol=1e-2)


def test_every_feature_has_a_name_of_its_own_and_stays_in_its_unit() -> None:
    picture, world = posed(np.zeros((21, 3)))
    values = features(picture, world)
    assert len({feature.name for feature in FEATURES}) == len(FEATURES) == len(values)
    degrees = [value for value, feature in zip(values, FEATURES, strict=True) if feature.unit is Unit.DEGREES]
    assert all(0 <= value <= 180 for value in degrees)


@given(shaken)
def test_the_batch_measures_what_the_single_measures_give(shake: FloatArray) -> None:
    """Angles, hulls and distances computed one by one, as the published rules do."""
    picture, world = posed(shake)
    by_name = {feature.name: value for feature, value in zip(FEATURES, features(picture, world), strict=True)}
    palm, observed_palm = (
        max(apart(points, Keypoint(a), Keypoint(b)) for a, b in ((5, 0), (9, 0), (17, 0), (5, 17)))
        for points in (world, picture)
    )
    outer, inner = tip_depths(picture, OUTER_HULL, INNER_HULL) / -observed_palm
    for finger in Finger:
        name, tip = finger.name.lower(), TIPS[finger]
        expected = {
            f"{name} angle": finger_angles_deg(world)[finger],
            f"{name} angle on image": finger_angles_deg(picture)[finger],
            f"{name} tip beyond outer hull": outer[finger],
            f"{name} tip beyond inner hull": inner[finger],
            f"{name} tip to wrist": apart(world, tip, Keypoint.WRIST) / palm,
        }
        for where, points in (("", world), (" on image", picture)):
            bones = np.diff(points[[0, *range(4 * finger + 1, 4 * finger + 5)]], axis=0)
            bends = angles_deg(-bones[:-1], bones[1:])
            expected |= {f"{name} {joint} joint{where}": bend for joint, bend in zip(JOINTS, bends, strict=True)}
        for other in (other for other in Finger if other > finger):
            pair = f"{name}-{other.name.lower()} tips apart"
            expected[pair] = apart(world, tip, TIPS[other]) / palm
            expected[f"{pair} on image"] = apart(picture, tip, TIPS[other]) / observed_palm
        # Next to 180° a rounding of the cosine in its last place turns the angle by 1e-6°.
        assert {key: by_name[key] for key in expected} == pytest.approx(expected, abs=1e-5)


def test_a_hand_without_size_is_finite() -> None:
    assert np.isfinite(features(np.zeros((21, 2)), np.zeros((21, 3)))).all()


def test_angles_distinguish_open_from_folded() -> None:
    opened, folded = finger_angles_deg(drawn_points("ooooo")), finger_angles_deg(drawn_points("fffff"))
    assert (opened[1:] > 170).all()
    assert (folded[1:] < 49).all()
    assert opened[0] > 53 > folded[0]


@pytest.mark.parametrize(("states", "outside"), [("ooooo", True), ("fffff", False)])
def test_hulls_distinguish_tips_outside_from_inside(states: str, outside: bool) -> None:
    points = drawn_points(states)
    assert ((tip_depths(points, OUTER_HULL) < 0) == outside).all()
    assert ((tip_depths(points, INNER_HULL) < 0) == outside).all()


def test_the_hull_is_made_of_its_own_members() -> None:
    points = drawn_points("ooooo")
    corners = {tuple(corner) for corner in hull(points, INNER_HULL)}
    assert corners <= {tuple(points[member]) for member in INNER_HULL}
