from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from app.evaluate.gestures import simulated
from app.evaluate.gestures.joint_space import LABEL
from app.evaluate.gestures.simulated import simulate
from app.evaluate.gestures.synthetic import near_scenes
from app.evaluate.noise import with_noise
from app.evaluate.readings import GESTURE_NAMES, DetectedImage, LabelledImage
from kgdfa.features import FEATURES

COUNT = 120


def found(scenes: int = 3) -> list[DetectedImage]:
    """The first hands of the fit, as a detector without error finds them."""
    made = []
    for labelled, scene, _ in islice(near_scenes(1), scenes):
        hand = with_noise(scene, np.zeros((21, 2)), np.zeros((21, 3)))
        assert hand is not None
        made.append(DetectedImage(image=labelled, hands=(hand,)))
    return made


@pytest.fixture(autouse=True)
def one_person(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their scenes are searched for those that were found: one person is enough."""
    monkeypatch.setattr(simulated, "near_scenes", lambda: near_scenes(1))


def test_simulated_hands_are_labelled_and_most_show_no_gesture() -> None:
    hands = simulate(found(), COUNT)
    assert hands.values.shape == (len(hands.labels), len(FEATURES))
    assert 0.8 * COUNT < len(hands.labels) <= COUNT
    assert set(hands.labels) <= {*GESTURE_NAMES, LABEL}
    assert 0.7 < np.mean(hands.labels == LABEL) < 1
    assert np.isfinite(hands.values).all()


def test_another_seed_draws_other_hands_and_the_same_one_the_same() -> None:
    first, again, other = (simulate(found(), COUNT, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.values, again.values)
    assert not np.array_equal(first.values[:40], other.values[:40])


def test_without_rendered_hands_there_are_no_errors_and_so_no_hands() -> None:
    strangers = [DetectedImage(image=LabelledImage(path="x.jpg", label="1"), hands=())]
    hands = simulate(strangers, COUNT)
    assert hands.values.shape == (0, len(FEATURES))
    assert len(hands.labels) == 0
