from __future__ import annotations

import numpy as np
import pytest

from app.evaluate.gestures.ablation import DEGRADATIONS, measure_preparations, preparation_costs
from app.evaluate.readings import LabelledImage
from kgdfa.augmentation import Augmentation
from kgdfa.hand import Hand
from kgdfa.preprocess import PREPARATIONS, Image
from tests.kgdfa.hands import drawn_hand

GREY = np.full((60, 80, 3), 120, np.uint8)
GREY[20:40, 30:50] = 220


class NotInTheDark:
    """Finds a drawn hand wherever the image is bright enough."""

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        return (drawn_hand("ooooo"),) if image_bgr.mean() > 60 else ()


@pytest.mark.parametrize("name", list(DEGRADATIONS))
def test_degrading_is_the_same_every_time_and_leaves_the_image_alone(name: str) -> None:
    before = GREY.copy()
    degraded = DEGRADATIONS[name](GREY, 7)
    assert degraded.shape == GREY.shape
    assert degraded.dtype == np.uint8
    np.testing.assert_array_equal(degraded, DEGRADATIONS[name](GREY, 7))
    np.testing.assert_array_equal(GREY, before)


def test_degrading_does_what_is_configured() -> None:
    assert DEGRADATIONS["dark"](GREY, 1).mean() < 0.2 * GREY.mean()
    assert DEGRADATIONS["noise"](GREY, 1)[:10].std() > 20
    assert DEGRADATIONS["blur"](GREY, 1).std() < 0.97 * GREY.std()
    np.testing.assert_array_equal(DEGRADATIONS["none"](GREY, 1), GREY)


def test_every_degradation_is_classified_with_every_preparation() -> None:
    images = iter(
        [
            (LabelledImage(path="a", label="5"), GREY, Augmentation()),
            (LabelledImage(path="b", label="none:nohand"), GREY * 0, Augmentation()),
        ]
    )
    steps: list[int] = []
    found = measure_preparations(images, NotInTheDark(), lambda: steps.append(1))
    assert {(one.degraded, one.prepared) for one in found} == {
        (bad, good) for bad in DEGRADATIONS for good in PREPARATIONS
    }
    assert len(steps) == 2
    plain = {one.degraded: one for one in found if one.prepared == "none"}
    assert (plain["none"].found, plain["dark"].found) == (1.0, 0.0)
    assert all(one.images == 2 and one.accepted_undefined == 0 for one in found)


def test_every_preparation_has_its_cost() -> None:
    costs_ms = preparation_costs()
    assert list(costs_ms) == list(PREPARATIONS)
    assert costs_ms["denoise"] > costs_ms["none"]
