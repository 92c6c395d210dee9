from __future__ import annotations

from dataclasses import replace
from itertools import product
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kgdfa.gesture import Decision, Explanation, Finger, Gesture
from kgdfa.hand import FloatArray
from kgdfa.published import (
    BENT_DEG,
    PINCH_RATIO,
    SPREAD_PX,
    TABLE_2,
    Constraint,
    Extra,
    Measures,
    PublishedRules,
    Row,
    check,
)
from tests.kgdfa.hands import STATES, drawn_hand

RULES = PublishedRules()
ROW = {row.gesture: number for number, row in enumerate(TABLE_2)}


def satisfying(row: Row) -> Measures:
    """Measures well within every constraint of one line."""
    opened = np.array([finger in row.opened for finger in Finger])
    limits = np.array([BENT_DEG[0], row.fore_deg, *BENT_DEG[2:]])
    outside = np.array([row.outside is not None and finger in row.outside for finger in Finger])
    depths = np.where(outside, -20.0, 20.0)
    return Measures(
        depths_px=np.stack([depths if row.outside is None else np.full(5, -20.0), depths]),
        angles_deg=np.where(opened, limits + 5, limits - 5),
        reference_px=100.0,
        lengths=np.array([0.0, 150.0, 150.0, 1.5]),
    )


def changed(values: FloatArray, place: int | tuple[int, int], value: float) -> FloatArray:
    copy = values.copy()
    copy[place] = value
    return copy


def holds(measures: Measures, row: Row) -> bool:
    return bool(check(measures).holds[ROW[row.gesture]].all())


@pytest.mark.parametrize("gesture", list(Gesture))
def test_every_row_accepts_its_own_drawn_hand(gesture: Gesture) -> None:
    assert gesture in STATES, "its fingers: STATES in tests/kgdfa/hands.py"
    verdict = RULES.classify(drawn_hand(STATES[gesture]))
    assert verdict.gesture is gesture
    assert verdict.confidence >= 0.5
    assert (verdict.explanation.code, verdict.explanation.values["gesture"]) == (Decision.CLOSEST, gesture)


def test_every_other_combination_of_fingers_is_none() -> None:
    for fingers in map("".join, product("of", repeat=5)):
        verdict = RULES.classify(drawn_hand(fingers))
        named = {states: gesture for gesture, states in STATES.items()}
        assert verdict.gesture is named.get(fingers), fingers


@pytest.mark.parametrize("row", TABLE_2, ids=lambda row: row.gesture.value)
def test_angles_decide_exactly_at_their_threshold(row: Row) -> None:
    measures = satisfying(row)
    assert holds(measures, row)
    for finger in Finger:
        limit = row.fore_deg if finger is Finger.FORE else BENT_DEG[finger]
        above = float(np.nextafter(limit, 360))
        for angle, is_open in ((limit, False), (above, True)):
            moved = replace(measures, angles_deg=changed(measures.angles_deg, int(finger), angle))
            assert holds(moved, row) is (is_open == (finger in row.opened))


@pytest.mark.parametrize("row", TABLE_2, ids=lambda row: row.gesture.value)
def test_tips_decide_exactly_at_the_hull(row: Row) -> None:
    measures, hull = satisfying(row), 0 if row.outside is None else 1
    for finger in Finger:
        for depth, outside in ((0.0, False), (-1e-9, True)):
            moved = replace(measures, depths_px=changed(measures.depths_px, (hull, int(finger)), depth))
            wanted = row.outside is not None and finger in row.outside
            assert holds(moved, row) is (outside == wanted)


@pytest.mark.parametrize(
    ("gesture", "extra", "limit", "holding"),
    [
        (Gesture.SIX, Extra.SPREAD_PINKY, SPREAD_PX, np.inf),
        (Gesture.EIGHT, Extra.SPREAD_FORE, SPREAD_PX, np.inf),
        (Gesture.SEVEN, Extra.PINCH, PINCH_RATIO, -np.inf),
    ],
)
def test_lengths_decide_strictly(gesture: Gesture, extra: Extra, limit: float, holding: float) -> None:
    row = TABLE_2[ROW[gesture]]
    measures = satisfying(row)
    at = replace(measures, lengths=changed(measures.lengths, int(extra), limit))
    beyond = replace(measures, lengths=changed(measures.lengths, int(extra), float(np.nextafter(limit, holding))))
    assert not holds(at, row)
    assert holds(beyond, row)


def test_no_two_rows_hold_together() -> None:
    for row in TABLE_2:
        assert check(satisfying(row)).holds.all(axis=1).sum() == 1


def test_the_explanation_names_the_constraint_that_failed() -> None:
    for row in TABLE_2:
        measures = satisfying(row)
        for finger in Finger:
            wrong = 5.0 if finger in row.opened else 175.0
            broken = replace(measures, angles_deg=changed(measures.angles_deg, int(finger), wrong))
            held = check(broken).holds[ROW[row.gesture]]
            assert [int(column) for column in np.flatnonzero(~held)] == [5 + finger]
    thumb = RULES.classify(drawn_hand("fofff"))
    assert (thumb.explanation.code, thumb.explanation.values["gesture"]) == (Decision.CLOSEST, Gesture.ONE)


def test_pixels_are_literal_so_a_distant_hand_is_no_eight() -> None:
    assert RULES.classify(drawn_hand("oofff")).gesture is Gesture.EIGHT
    far = RULES.classify(drawn_hand("oofff", scale=0.4))
    assert far.gesture is None
    assert (far.explanation.code, far.explanation.values["gesture"]) == (Decision.NOT, Gesture.EIGHT)
    spread = far.explanation.values["measure"]
    assert isinstance(spread, Explanation)
    assert spread.code is Constraint.TIPS_NEAR
    assert (spread.values["first"], spread.values["second"], spread.values["limit_px"]) == (4, 8, SPREAD_PX)


@pytest.mark.parametrize("row", TABLE_2, ids=lambda row: row.gesture.value)
def test_a_very_clear_gesture_is_explained_by_a_constraint_that_its_line_has(
    row: Row, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = satisfying(row)
    beyond = np.where([finger in row.opened for finger in Finger], 500.0, -500.0)
    clear = replace(measured, depths_px=measured.depths_px * 100, angles_deg=beyond)
    checks = check(clear)
    assert checks.margins[ROW[row.gesture], :10].min() > 1.0
    monkeypatch.setattr("kgdfa.published.measure", lambda _: clear)
    verdict = RULES.classify(drawn_hand(STATES[row.gesture]))
    assert verdict.gesture is row.gesture
    assert isinstance(verdict.explanation.values["measure"], Explanation)


DEPTHS = st.floats(-1e6, 1e6)


@given(
    st.lists(st.lists(DEPTHS, min_size=5, max_size=5), min_size=2, max_size=2),
    st.lists(st.floats(0.0, 180.0), min_size=5, max_size=5),
    st.lists(st.floats(0.0, 1e6), min_size=3, max_size=3),
    st.floats(0.0, 1e4),
)
@settings(max_examples=300)
def test_no_measures_are_explained_by_an_extra_that_the_line_has_not(
    depths_px: list[list[float]], angles_deg: list[float], lengths: list[float], reference_px: float
) -> None:
    measures = Measures(
        depths_px=np.array(depths_px),
        angles_deg=np.array(angles_deg),
        reference_px=reference_px,
        lengths=np.array([0.0, *lengths]),
    )
    with patch("kgdfa.published.measure", return_value=measures):
        verdict = RULES.classify(drawn_hand(STATES[Gesture.ZERO]))
    assert isinstance(verdict.explanation.values["measure"], Explanation)
