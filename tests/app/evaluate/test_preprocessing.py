from __future__ import annotations

import numpy as np
import pytest

from app.evaluate.gesture_photos import Photo
from app.evaluate.preprocessing import SPOILS, cost_ms, measure_worth
from kgdfa.augmentation import Augmentation
from kgdfa.hand import Hand
from kgdfa.preprocess import PREPARATIONS, Image, denoise
from tests.kgdfa.hands import drawn_hand

GREY = np.full((60, 80, 3), 120, np.uint8)
GREY[20:40, 30:50] = 220


class NotInTheDark:
    """Finds a drawn hand wherever the picture is bright enough."""

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        return (drawn_hand("ooooo"),) if image_bgr.mean() > 60 else ()


@pytest.mark.parametrize("name", list(SPOILS))
def test_spoiling_is_the_same_every_time_and_leaves_the_picture_alone(name: str) -> None:
    before = GREY.copy()
    spoilt = SPOILS[name](GREY, 7)
    assert spoilt.shape == GREY.shape
    assert spoilt.dtype == np.uint8
    np.testing.assert_array_equal(spoilt, SPOILS[name](GREY, 7))
    np.testing.assert_array_equal(GREY, before)


def test_spoiling_does_what_it_says() -> None:
    assert SPOILS["dark"](GREY, 1).mean() < 0.2 * GREY.mean()
    assert SPOILS["noise"](GREY, 1)[:10].std() > 20
    assert SPOILS["blur"](GREY, 1).std() < 0.97 * GREY.std()
    np.testing.assert_array_equal(SPOILS["as it is"](GREY, 1), GREY)


def test_every_way_to_spoil_is_judged_with_every_preparation() -> None:
    pictures = iter(
        [
            (Photo(path="a", label="5"), GREY, Augmentation()),
            (Photo(path="b", label="none:nohand"), GREY * 0, Augmentation()),
        ]
    )
    told: list[int] = []
    found = measure_worth(pictures, NotInTheDark(), lambda: told.append(1))
    assert {(one.spoilt, one.prepared) for one in found} == {(bad, good) for bad in SPOILS for good in PREPARATIONS}
    assert len(told) == 2
    plain = {one.spoilt: one for one in found if one.prepared == "none"}
    assert (plain["as it is"].found, plain["dark"].found) == (1.0, 0.0)
    assert all(one.pictures == 2 and one.accepted_undefined == 0 for one in found)


def test_a_preparation_costs_something() -> None:
    assert cost_ms(denoise) > 0
