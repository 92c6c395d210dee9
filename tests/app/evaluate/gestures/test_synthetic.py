from __future__ import annotations

import numpy as np

from app.evaluate.gestures.synthetic import FINGERS_OF, STAYS_IN, SYNTHETIC_NONE, HandSynthesizer
from app.evaluate.readings import GESTURE_NAMES
from kgdfa.features import FEATURES
from kgdfa.hand import FloatArray
from tests.kgdfa.hands import STATES, drawn_hand

PER_GESTURE = 5
NAMES = [feature.name for feature in FEATURES]


def made(seed: int = 3) -> tuple[FloatArray, list[str]]:
    """Hands recombined from five slightly different drawn hands a gesture."""
    random = np.random.default_rng(1)
    hands = [
        (gesture.value, drawn_hand(states).world_m + random.normal(0, 0.001, (21, 3)))
        for gesture, states in STATES.items()
        for _ in range(PER_GESTURE)
    ]
    labels = [label for label, _ in hands]
    return HandSynthesizer(np.array([world for _, world in hands]), np.ones(len(hands), bool), labels, seed).make(0.1)


def test_recombining_makes_every_gesture_and_what_is_none() -> None:
    values, labels = made()
    assert {*GESTURE_NAMES, SYNTHETIC_NONE} <= set(labels) <= {*FINGERS_OF, "7", SYNTHETIC_NONE}
    assert values.shape == (len(labels), len(FEATURES))
    assert np.isfinite(values).all()


def test_the_same_seed_makes_the_same_hands() -> None:
    (first, labels), (again, labels_again), (other, _) = made(), made(), made(seed=4)
    np.testing.assert_array_equal(first, again)
    assert labels == labels_again
    assert not np.array_equal(first, other)


def test_a_fist_is_a_zero_only_while_its_thumb_does_not_stand_out() -> None:
    values, labels = made()
    beyond = values[np.array(labels) == "0", NAMES.index("thumb tip beyond joints")]
    assert np.median(beyond) <= STAYS_IN
    assert np.percentile(beyond, 95) < 0.3  # noise and the view's turn move a measured tip


def test_straight_fingers_are_shown_together_and_spread() -> None:
    values, labels = made()
    splay = values[np.array(labels) == "4", NAMES.index("fore-middle splay")]
    assert np.ptp(splay) > 5
