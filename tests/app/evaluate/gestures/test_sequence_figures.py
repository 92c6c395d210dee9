from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.evaluate.gestures.measures import SequenceFigures, measure_sequence, run_sequence
from app.evaluate.gestures.report import sequence_table
from app.evaluate.readings import Footage
from app.perception.pipeline import RULES


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


def test_the_chain_over_footage_guides_its_detector_as_a_sessions_does(monkeypatch: pytest.MonkeyPatch) -> None:
    followed: list[object] = []

    def follow(*what: object) -> None:
        followed.append(what)

    detector: Any = SimpleNamespace(detect=lambda *_: (), follow=follow)
    monkeypatch.setattr("kgdfa.keypoints.live_detector", lambda _: nullcontext(detector))
    images = [np.zeros((90, 160, 3), np.uint8)] * 3
    footage = Footage(
        labels=("skip",) * 3, focal_px=160.0, reference_m=0.08, period_ns=33_000_000, frames=lambda: iter(images)
    )
    assert len(run_sequence(footage, Path("model"), RULES["robust"]())) == 3
    assert len(followed) == 3


def test_counts_and_shares_of_footage_are_not_rounded_up() -> None:
    figures = SequenceFigures(
        frames=5412,
        frame_accuracy=0.9996,
        voted_accuracy=0.5,
        shown=1234,
        recognised=1234,
        broken=0,
        delay_frames=2.25,
        false_onsets=3,
    )
    (_, cells) = (list(column.cells) for column in sequence_table(Path("video"), {"robust": figures}).columns)
    assert cells == ["5412", "0.9996", "0.5000", "1234", "1234", "0", "2.2500", "3"]
