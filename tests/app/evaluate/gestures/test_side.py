from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.evaluate.gestures.side import HELD_FRAMES, SideFigures, SideMeasure, arms_summary, measure_looks
from app.evaluate.readings import DetectedImage, LabelledImage
from kgdfa.augmentation import AUGMENTATIONS
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand, Side
from kgdfa.published import PublishedRules
from tests.kgdfa.hands import STATES, drawn_hand

FIVE = drawn_hand(STATES[Gesture.FIVE])


class Always:
    """Finds this hand in every image."""

    def __init__(self, hand: Hand) -> None:
        self._hand = hand

    def detect(self, _image: Any, _captured_ns: int = 0) -> tuple[Hand, ...]:
        return (self._hand,)

    def reset(self, _captured_ns: int) -> None:
        """It remembers nothing."""


@pytest.mark.parametrize("side", [*Side])
def test_frames_count_from_the_vote_on(side: Side) -> None:
    detector: Any = Always(replace(FIVE, side=side))
    sides = SideMeasure(detector, PublishedRules()).sides(np.zeros((72, 128, 3), np.uint8))
    assert sides == [side] * (HELD_FRAMES - 2)


def test_of_looks_that_contradict_each_other_one_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.evaluate.gestures.side.RobustRules", PublishedRules)
    image = LabelledImage(path="a", label="5", source="daocunyang", group="p1")
    right, left = replace(FIVE, side=Side.RIGHT), replace(FIVE, side=Side.LEFT)
    agreeing = (right,) * len(AUGMENTATIONS)
    contrary = tuple(left if look.mirrored else right for look in AUGMENTATIONS)
    figures = measure_looks([DetectedImage(image=image, hands=hands) for hands in (agreeing, contrary)])
    assert (figures.frames["5"], figures.wrong["5"], figures.right) == (4, 1, 0.75)
    assert figures.sources == {"daocunyang p1": {"right": 2}}


def test_arms_count_as_within_the_limit_or_beyond(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.evaluate.gestures.side.RobustRules", PublishedRules)
    image = LabelledImage(path="a", label="5", source="daocunyang", group="p1")
    lying = replace(FIVE, image_px=FIVE.image_px[:, ::-1].copy())
    detected = [DetectedImage(image=image, hands=(hand,)) for hand in (FIVE, FIVE, FIVE, lying)]
    (line,) = arms_summary(measure_looks(detected))
    assert line == "75.0% of 4 arms point up within the limit of 65°"
    assert list(arms_summary(SideFigures())) == []
