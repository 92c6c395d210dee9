"""The vocabulary that an enrolment finds for digital patients."""

from __future__ import annotations

from app.evaluate.gestures.enrolment import (
    DigitalPatient,
    EnrolledPatient,
    enrol_patient,
    enrolment_table,
)
from hal.cameras.digital_hand.movement import HandLimit
from kgdfa.gesture import Gesture
from kgdfa.robust import RobustRules
from tests.app.evaluate.gestures.test_joint_space import NO_ERRORS

G, K = Gesture, HandLimit


def enrolled(limit: HandLimit) -> EnrolledPatient:
    return enrol_patient(DigitalPatient(limit=limit, person=7_000_001, rules=RobustRules(), errors=NO_ERRORS), 1)


def test_an_enrolment_finds_what_the_hand_can_do() -> None:
    bent = enrolled(K.TWO_FINGERS)
    assert not {G.THREE, G.FOUR, G.FIVE, G.SIX, G.LOVE, G.ROCK} & set(bent.vocabulary)
    assert set(bent.vocabulary) >= {G.ZERO, G.ONE, G.TWO}
    assert bent.recognised is not None
    assert bent.recognised > 0.8
    assert bent.unintended == 0
    assert bent.tried > 0, "a 3 without the ring finger is a 2"
    text = enrolment_table([bent]).columns
    assert [column.header for column in text][-1] == "rock"


def test_the_same_seed_gives_the_same_result() -> None:
    assert enrolled(K.NO_SPREAD) == enrolled(K.NO_SPREAD)
