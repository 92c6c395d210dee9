"""What a digital patient's hand can't do."""

from __future__ import annotations

import numpy as np
import pytest

from app.evaluate.gestures.joint_space import label_by_joints
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import TREMOR_DEG, HandLimit, limited, tremor_deg
from hal.cameras.digital_hand.skeleton import POSES
from kgdfa.gesture import Gesture

G, L = Gesture, HandLimit
AT_NS = 1_040_000_000


def test_who_can_not_extend_two_fingers_shows_no_gesture_that_needs_them() -> None:
    shown = {gesture: limited(L.TWO_FINGERS, POSES[gesture.value].angles_deg) for gesture in Gesture}
    assert {gesture for gesture, angles in shown.items() if label_by_joints(angles) != gesture.value} >= {
        G.THREE,
        G.FOUR,
        G.FIVE,
        G.SIX,
        G.LOVE,
        G.ROCK,
    }
    assert all(label_by_joints(shown[gesture]) == gesture.value for gesture in (G.ZERO, G.ONE, G.TWO, G.EIGHT))


def test_who_can_not_spread_keeps_folded_fingers_as_they_are() -> None:
    fist, hand = POSES["0"].angles_deg, POSES["5"].angles_deg
    assert np.array_equal(limited(L.NO_SPREAD, fist)[1:], fist[1:])
    assert not np.array_equal(limited(L.NO_SPREAD, hand)[1:, 0], hand[1:, 0])


@pytest.mark.parametrize("limit", HandLimit)
def test_the_pose_itself_is_not_changed(limit: HandLimit) -> None:
    angles = POSES["5"].angles_deg
    before = angles.copy()
    limited(limit, angles)
    assert np.array_equal(angles, before)


def test_only_a_tremor_shakes_and_by_no_more_than_it_says() -> None:
    times = np.arange(0, 1, 0.001)
    assert {tremor_deg(limit, time) for limit in (L.NONE, L.TWO_FINGERS, L.NO_SPREAD) for time in times} == {0.0}
    shaken = [tremor_deg(L.TREMOR, time) for time in times]
    assert max(shaken) == pytest.approx(TREMOR_DEG, rel=1e-3)
    assert min(shaken) == pytest.approx(-TREMOR_DEG, rel=1e-3)


@pytest.mark.parametrize("limit", HandLimit)
def test_the_camera_shows_the_hand_as_it_can_be(limit: HandLimit) -> None:
    camera = DigitalHandCamera(gesture="5", limit=limit)
    wanted = limited(limit, POSES["5"].angles_deg) + tremor_deg(limit, AT_NS / 1e9)
    assert np.allclose(camera.scene(AT_NS).angles_deg, wanted)
