"""Digital patients: what each kind can't do, and the vocabulary that an enrolment finds for them."""

from __future__ import annotations

import numpy as np
import pytest

from app.evaluate.gestures.enrolment import (
    LIMITS,
    DigitalPatient,
    EnrolledPatient,
    PatientKind,
    enrol_patient,
    enrolment_table,
)
from app.evaluate.gestures.joint_space import label_by_joints
from hal.cameras.digital_hand.skeleton import POSES
from kgdfa.gesture import Gesture
from kgdfa.robust import RobustRules
from tests.app.evaluate.gestures.test_joint_space import NO_ERRORS

G, K = Gesture, PatientKind


def enrolled(kind: PatientKind) -> EnrolledPatient:
    return enrol_patient(DigitalPatient(kind=kind, person=7_000_001, rules=RobustRules(), errors=NO_ERRORS), 1)


def test_who_can_not_extend_two_fingers_shows_no_gesture_that_needs_them() -> None:
    limited = {gesture: LIMITS[K.TWO_FINGERS](POSES[gesture.value].angles_deg) for gesture in Gesture}
    assert {gesture for gesture, angles in limited.items() if label_by_joints(angles) != gesture.value} >= {
        G.THREE,
        G.FOUR,
        G.FIVE,
        G.SIX,
        G.LOVE,
        G.ROCK,
    }
    assert all(label_by_joints(limited[gesture]) == gesture.value for gesture in (G.ZERO, G.ONE, G.TWO, G.EIGHT))


def test_who_can_not_spread_keeps_folded_fingers_as_they_are() -> None:
    fist, hand = POSES["0"].angles_deg, POSES["5"].angles_deg
    assert np.array_equal(LIMITS[K.NO_SPREAD](fist)[1:], fist[1:])
    assert not np.array_equal(LIMITS[K.NO_SPREAD](hand)[1:, 0], hand[1:, 0])


def test_an_enrolment_finds_what_the_hand_can_do() -> None:
    bent = enrolled(K.TWO_FINGERS)
    assert not {G.THREE, G.FOUR, G.FIVE, G.SIX, G.LOVE, G.ROCK} & set(bent.vocabulary)
    assert set(bent.vocabulary) >= {G.ZERO, G.ONE, G.TWO}
    assert bent.recognised > 0.8
    assert bent.unintended == 0
    assert bent.tried > 0, "a 3 without the ring finger is a 2"
    text = enrolment_table([bent]).columns
    assert [column.header for column in text][-1] == "rock"


def test_the_same_seed_gives_the_same_result() -> None:
    assert enrolled(K.NO_SPREAD) == enrolled(K.NO_SPREAD)


@pytest.mark.parametrize("kind", PatientKind)
def test_every_kind_has_its_limits(kind: PatientKind) -> None:
    angles = POSES["5"].angles_deg
    before = angles.copy()
    LIMITS[kind](angles)
    assert np.array_equal(angles, before), "the pose itself is not changed"
