"""How near a hand is tracked: the worst of several, and none where one was never found."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import pytest

from app.evaluate.detector_pool import PoolDetector
from app.evaluate.readings import GESTURE_NAMES
from app.evaluate.trigger.press_zone import (
    FIRST_HAND,
    LENSES_PX,
    Approach,
    Approached,
    approach,
    evaluate_press_zone,
    zone_table,
)
from kgdfa.hand import Hand


class Blind:
    """A detector that finds nothing."""

    def detect(self, _image: Any, _captured_ns: int = 0) -> tuple[Hand, ...]:
        return ()

    def reset(self, _captured_ns: int) -> None:
        """It remembers nothing."""


def test_a_hand_that_is_never_found_is_tracked_from_nowhere() -> None:
    blind: Any = Blind()
    wanted = Approach(focal_px=LENSES_PX[0], gesture="5", seed=FIRST_HAND, view="plain")
    assert approach(PoolDetector(blind), wanted) == Approached(followed_cm=None, commands=False)


class Measured:
    """Does no work: of every gesture the second hand has a distance of its own."""

    def __init__(self, second_cm: float | None) -> None:
        self._of = {FIRST_HAND: 9.0, FIRST_HAND + 1: second_cm}

    def submit(self, _work: Callable[..., Any], *pieces: Any) -> Future[Any]:
        done = Future[Any]()
        (piece,) = (one for one in pieces if isinstance(one, Approach))
        done.set_result(Approached(followed_cm=self._of[piece.seed], commands=piece.seed == FIRST_HAND))
        return done


@pytest.mark.parametrize(("second_cm", "worst_cm", "shown"), [(12.0, 12.0, "12 cm"), (None, None, "–")])
def test_the_worst_of_the_hands_counts_and_one_that_is_never_found_is_worse_than_any(
    second_cm: float | None, worst_cm: float | None, shown: str
) -> None:
    pool: Any = Measured(second_cm)
    rows = evaluate_press_zone(pool, hands=2, step=lambda: None)
    assert len(rows) == len(LENSES_PX) * len(GESTURE_NAMES)
    assert {row.followed_from_cm["plain"] for row in rows} == {worst_cm}
    columns = [[str(cell) for cell in column.cells] for column in zone_table(rows).columns]
    assert [column[0] for column in columns[1:]] == ["0", shown, "50%", shown, "50%"]
