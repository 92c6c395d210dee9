from __future__ import annotations

import pytest

from app.evaluate.gestures.measures import measure_sequence


def test_a_steady_sequence_is_all_right() -> None:
    labels = ["skip", *["1"] * 8, "skip", *["2"] * 8]
    voted = ["none", "none", "none", *["1"] * 9, *["2"] * 6]
    figures = measure_sequence(labels, labels, voted)
    assert (figures.shown, figures.recognised, figures.broken, figures.false_onsets) == (2, 2, 0, 0)
    assert figures.delay_frames == 2
    assert figures.frame_accuracy == 1
    assert figures.voted_accuracy == pytest.approx(12 / 16)


def test_a_broken_gesture_and_a_false_onset_are_counted() -> None:
    labels = [*["1"] * 10, *["none:ok"] * 30]
    voted = ["none", "none", "1", "1", "none", "1", "1", "1", "1", "1", *["none"] * 25, *["5"] * 5]
    figures = measure_sequence(labels, voted, voted)
    assert (figures.shown, figures.recognised, figures.broken, figures.false_onsets) == (1, 1, 1, 1)


def test_a_gesture_never_reported_is_not_recognised() -> None:
    figures = measure_sequence(["3"] * 6, ["none"] * 6, ["none"] * 6)
    assert (figures.shown, figures.recognised, figures.delay_frames) == (1, 0, 0)
