from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.evaluate.gestures.synthetic import BETWEEN_LABEL, NATURALLY_OPEN, near_scenes
from app.evaluate.gestures.thresholds import CANDIDATES, MOST_ACCEPTED, choose_thresholds
from app.evaluate.readings import GESTURE_NAMES, check_label
from kgdfa.hand import FloatArray

ONE, FIVE = GESTURE_NAMES.index("1"), GESTURE_NAMES.index("5")


def hands(*some: tuple[str, int, float, int]) -> tuple[NDArray[np.str_], FloatArray]:
    """Rows of (label, place of the likeliest gesture, its chance, how many)."""
    labels = np.array([label for label, _, _, often in some for _ in range(often)])
    places = np.array([place for _, place, _, often in some for _ in range(often)])
    chances = np.zeros((len(labels), len(GESTURE_NAMES)))
    chances[np.arange(len(labels)), places] = [chance for _, _, chance, often in some for _ in range(often)]
    return labels, chances


def test_a_gesture_that_nothing_resembles_is_accepted_as_soon_as_it_is_likelier_than_not() -> None:
    labels, chances = hands(("1", ONE, 0.55, 50), ("none:ok", FIVE, 0.2, 50))
    assert choose_thresholds(labels, chances)[ONE] == CANDIDATES[0]


def test_only_the_gesture_that_accepts_in_error_grows_stricter() -> None:
    labels, chances = hands(("1", ONE, 0.6, 50), ("5", FIVE, 0.9, 50), ("none:natural_open", FIVE, 0.72, 50))
    thresholds = choose_thresholds(labels, chances)
    assert thresholds[ONE] == CANDIDATES[0]
    assert 0.72 < thresholds[FIVE] <= 0.9


def test_refusing_comes_before_recognising() -> None:
    """Where a gesture lies below its look-alikes, its threshold gives the gesture up, not the refusal."""
    labels, chances = hands(("5", FIVE, 0.7, 900), ("1", ONE, 0.9, 900), ("none:natural_open", FIVE, 0.8, 20))
    accepted = chances[labels == "none:natural_open", FIVE] >= choose_thresholds(labels, chances)[FIVE]
    assert accepted.mean() <= MOST_ACCEPTED


def test_without_undefined_hands_every_gesture_keeps_its_best_f1() -> None:
    labels, chances = hands(("1", ONE, 0.8, 10), ("5", ONE, 0.6, 10))
    threshold = choose_thresholds(labels, chances)[ONE]
    assert 0.6 < threshold <= 0.8


def test_a_rare_confusion_raises_no_threshold_but_an_undefined_hand_does() -> None:
    observed = (("1", ONE, 0.8, 300), ("5", ONE, 0.5, 2))
    assert choose_thresholds(*hands(*observed))[ONE] == CANDIDATES[0]
    assert choose_thresholds(*hands(*observed, ("none:ok", ONE, 0.5, 5)))[ONE] > 0.5


def test_a_hand_that_counts_for_three_holds_the_threshold_down_as_three_would() -> None:
    labels, chances = hands(("1", ONE, 0.5, 10), ("1", ONE, 0.9, 10), ("5", ONE, 0.5, 30))
    thrice = np.where(labels == "1", 3.0, 1.0)
    assert choose_thresholds(labels, chances)[ONE] > 0.5
    assert choose_thresholds(labels, chances, thrice)[ONE] == CANDIDATES[0]


def test_undefined_hands_count_as_a_little_surer_than_they_were_judged() -> None:
    labels, chances = hands(("1", ONE, 0.75, 50), ("none:ok", ONE, 0.6, 5))
    assert 0.69 < choose_thresholds(labels, chances)[ONE] <= 0.75


def test_digital_hands_count_as_sure_as_they_were_judged() -> None:
    labels, chances = hands(("1", ONE, 0.75, 50), ("none:ok", ONE, 0.6, 5))
    assert 0.6 < choose_thresholds(labels, chances, photos=labels == "1")[ONE] <= 0.63


def test_hands_caught_halfway_raise_a_threshold_only_where_more_than_their_share_pass() -> None:
    few = (("1", ONE, 0.8, 300), (BETWEEN_LABEL, ONE, 0.7, 10), (BETWEEN_LABEL, FIVE, 0.1, 90))
    many = (("1", ONE, 0.8, 300), (BETWEEN_LABEL, ONE, 0.7, 60), (BETWEEN_LABEL, FIVE, 0.1, 40))
    assert choose_thresholds(*hands(*few))[ONE] == CANDIDATES[0]
    assert choose_thresholds(*hands(*many))[ONE] > 0.7


def test_hands_near_the_gestures_are_labelled_as_they_are_shaped() -> None:
    scenes = list(near_scenes(people=1))
    labels = [photo.label for photo, _, _ in scenes]
    for label in labels:
        check_label(label, Path("labels.csv"), 1)
    assert set(GESTURE_NAMES) <= set(labels)
    assert labels.count("none:natural_open") == NATURALLY_OPEN + 1
    assert BETWEEN_LABEL in labels
    assert len({seed for _, _, seed in scenes}) == len(scenes)
    assert all(np.isfinite(scene.angles_deg).all() and scene.place is not None for _, scene, _ in scenes)
