"""Hands drawn by hand: a palm whose fingers are open, folded or hooked as asked."""

from __future__ import annotations

import numpy as np

from kgdfa.gesture import Gesture
from kgdfa.hand import FloatArray, Hand, Side

# A right hand's back, fingers up, about 100 px a palm; what no finger moves.
_PALM: dict[int, tuple[float, float]] = {
    **{0: (500, 600), 1: (440, 570), 2: (400, 520), 5: (440, 420), 9: (490, 410), 13: (540, 415), 17: (590, 440)},
    **{6: (435, 350), 10: (490, 335), 14: (545, 345), 18: (600, 385)},
}
# Tips (and the thumb's joint 3) of each finger by state.
_OPEN = ((330, 430), (425, 240), (490, 215), (550, 235), (610, 300))
_FOLDED = ((465, 475), (450, 440), (492, 440), (535, 445), (575, 455))
_HOOKED_FORE = (355, 345)
_THUMB_JOINT = {"o": (370, 470), "f": (425, 490)}
_PINCHED_MIDDLE = (640, 230)  # so far from tip 8 that the ratio of Eq. 3 falls under 2

STATES: dict[Gesture, str] = {
    Gesture.ZERO: "fffff",
    Gesture.ONE: "fofff",
    Gesture.TWO: "fooff",
    Gesture.THREE: "fooof",
    Gesture.FOUR: "foooo",
    Gesture.FIVE: "ooooo",
    Gesture.SIX: "offfo",
    Gesture.SEVEN: "oopff",
    Gesture.EIGHT: "oofff",
    Gesture.NINE: "fhfff",
    Gesture.LOVE: "ooffo",
    Gesture.ROCK: "foffo",
}


def drawn_points(states: str) -> FloatArray:
    """(21, 2) px. states: thumb to pinky, o open, f folded, h hooked, p pinched."""
    points = dict(_PALM)
    points[3] = _THUMB_JOINT[states[0]]
    for finger, state in enumerate(states):
        tip = {"o": _OPEN[finger], "f": _FOLDED[finger], "h": _HOOKED_FORE, "p": _PINCHED_MIDDLE}[state]
        points[4 * finger + 4] = tip
        if finger:
            points[4 * finger + 3] = tuple((np.add(points[4 * finger + 2], tip) / 2).tolist())
    return np.array([points[number] for number in range(21)], dtype=np.float64)


def drawn_hand(states: str, *, at_px: tuple[float, float] = (0.0, 0.0), scale: float = 1.0) -> Hand:
    """The drawn points as a flat hand, shifted and scaled."""
    points = drawn_points(states) * scale + at_px
    world = np.column_stack([(points - points.mean(axis=0)) / scale * 0.001, np.zeros(21)])
    return Hand(image_px=points, world_m=world, presence=0.9, side=Side.RIGHT)
