"""The digital hand's poses against the gestures' one table, which it may not import."""

from __future__ import annotations

import pytest

from hal.cameras.digital_hand.skeleton import ACROSS_THUMB, GESTURES, OPEN_THUMB, OVER_THUMB, PINCH_THUMB, Finger, Pose
from kgdfa.gesture import FINGER_STATES, FingerState, Gesture

THUMBS = {
    OPEN_THUMB: FingerState.OPEN,
    OVER_THUMB: FingerState.FOLDED,
    ACROSS_THUMB: FingerState.FOLDED,
    PINCH_THUMB: FingerState.PINCHED,
}


def state_of(finger: Finger) -> FingerState:
    _, knuckle_deg, middle_deg, _ = finger
    if middle_deg > 45:
        return FingerState.FOLDED if knuckle_deg > 45 else FingerState.HOOKED
    return FingerState.PINCHED if knuckle_deg > 45 else FingerState.OPEN


@pytest.mark.parametrize("pose", GESTURES, ids=lambda pose: pose.name)
def test_each_finger_is_as_its_gesture_wants(pose: Pose) -> None:
    fingers = (pose.index, pose.middle, pose.ring, pose.pinky)
    assert (THUMBS[pose.thumb], *map(state_of, fingers)) == FINGER_STATES[Gesture(pose.name)]
