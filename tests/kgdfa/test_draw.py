"""What is drawn on the picture, at a camera's size and for a terminal's cells."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from kgdfa.button_state import ButtonPlace, ButtonState
from kgdfa.draw import BONE, PRESSED, RELEASED, Colour, depth_share, draw, draw_button
from kgdfa.gesture import Gesture
from kgdfa.hand import Keypoint
from kgdfa.pipeline import Report
from kgdfa.preprocess import Image
from tests.kgdfa.hands import STATES, drawn_hand

PLACE = ButtonPlace(x_px=100, y_px=60, radius_px=40, threshold_m=0.20)


def ring(image: Image, share: float, *, pressed: bool = False) -> Image:
    draw_button(image, ButtonState(pressed=pressed), PLACE, 1.0, share)
    return image


def cells_of(image: Image, columns: int) -> Image:
    """As a terminal of so many columns shows it."""
    size = (columns, round(image.shape[0] * columns / image.shape[1]))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def count(image: Image, colour: Colour) -> int:
    return int((image == colour).all(axis=2).sum())


@pytest.mark.parametrize(
    ("safe_m", "share"), [(None, 0.0), (0.60, 0.0), (0.40, 0.0), (0.30, 0.5), (0.20, 1.0), (0.05, 1.0)]
)
def test_the_share_is_of_the_way_to_the_threshold(safe_m: float | None, share: float) -> None:
    assert depth_share(safe_m, 0.20) == pytest.approx(share)


def test_the_ring_fills_as_the_hand_comes_nearer_and_is_whole_only_when_pressed() -> None:
    filled = [count(ring(np.zeros((120, 200, 3), np.uint8), share / 10), RELEASED) for share in range(11)]
    assert filled == sorted(filled)
    assert len(set(filled)) == len(filled)
    nearest = ring(np.zeros((120, 200, 3), np.uint8), 1.0)
    pressed = ring(np.zeros((120, 200, 3), np.uint8), 1.0, pressed=True)
    inside = (60, 100 + 31)  # between the disc and the ring
    assert not nearest[inside].any()
    assert tuple(pressed[inside]) == PRESSED
    assert count(pressed, RELEASED) == 0


def test_every_bone_is_whole_in_a_terminal_of_eighty_columns() -> None:
    hand = drawn_hand(STATES[Gesture.FIVE])
    report = Report(
        captured_ns=0,
        hand=hand,
        verdict=None,
        gesture=None,
        recognised_ns=0,
        votes=0,
        distance=None,
        depth_distance=None,
        button=ButtonState(),
    )
    columns = 60
    image = np.zeros((2 * columns * 720 // 1280, 2 * columns, 3), np.uint8)
    scale = 2 * columns / 1280
    far = ButtonPlace(x_px=-500, y_px=-500, radius_px=10, threshold_m=0.2)
    draw(image, report, far, scale)
    shown = cells_of(image, columns)
    for first, second in ((Keypoint.INDEX_MCP, Keypoint.INDEX_TIP), (Keypoint.WRIST, Keypoint.PINKY_MCP)):
        ends = hand.image_px[[first, second]] * scale / 2
        for share in np.linspace(0.1, 0.5, 9):
            x, y = ends[0] + (ends[1] - ends[0]) * share
            assert shown[int(y), int(x)].min() > 0.6 * min(BONE), f"the bone is broken at {share:.2f}"
