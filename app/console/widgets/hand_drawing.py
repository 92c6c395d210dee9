"""A hand drawn in braille from a row of finger postures: what the learner is to copy. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

from app.console.widgets.step_drawing import Braille
from kgdfa.gesture import Gesture


class Posture(Enum):
    """Of one finger, as Table 2 tells them apart."""

    FOLDED = "folded"
    OPEN = "open"
    HOOKED = "hooked"
    PINCHED = "pinched"  # tips together, gesture 7


_F, _O, _H, _P = Posture.FOLDED, Posture.OPEN, Posture.HOOKED, Posture.PINCHED
FINGER_NAMES = ("thumb", "index", "middle", "ring", "pinky")
# Thumb, index, middle, ring, pinky; Tables 1 and 2.
POSTURES: dict[Gesture, tuple[Posture, Posture, Posture, Posture, Posture]] = {
    Gesture.ZERO: (_F, _F, _F, _F, _F),
    Gesture.ONE: (_F, _O, _F, _F, _F),
    Gesture.TWO: (_F, _O, _O, _F, _F),
    Gesture.THREE: (_F, _O, _O, _O, _F),
    Gesture.FOUR: (_F, _O, _O, _O, _O),
    Gesture.FIVE: (_O, _O, _O, _O, _O),
    Gesture.SIX: (_O, _F, _F, _F, _O),
    Gesture.SEVEN: (_P, _P, _P, _F, _F),
    Gesture.EIGHT: (_O, _O, _F, _F, _F),
    Gesture.NINE: (_F, _H, _F, _F, _F),
    Gesture.LOVE: (_O, _O, _F, _F, _O),
    Gesture.ROCK: (_F, _O, _F, _F, _O),
}


@dataclass(frozen=True, slots=True)
class _Finger:
    """Knuckle and open tip on a drawing of 60 by 72 units, y down; the wearer's right hand, palm to the camera."""

    knuckle: tuple[float, float]
    tip: tuple[float, float]


_FINGERS = (
    _Finger((17, 52), (2, 34)),
    _Finger((20, 38), (14, 6)),
    _Finger((29, 36), (28, 2)),
    _Finger((38, 38), (42, 6)),
    _Finger((46, 42), (56, 16)),
)
_PALM: tuple[tuple[float, float], ...] = (
    (22, 70),
    (14, 56),
    (20, 38),
    (29, 36),
    (38, 38),
    (46, 42),
    (42, 70),
    (22, 70),
)
_PINCH = (12.0, 20.0)


def draw_hand(gesture: Gesture, columns: int, rows: int) -> str:
    """The gesture as lines of braille."""
    canvas = Braille(columns, rows)
    scale = min(canvas.width / 60, canvas.height / 72)

    def line(a: tuple[float, float], b: tuple[float, float]) -> None:
        canvas.line(*(round(value * scale) for value in (*a, *b)))

    for a, b in pairwise(_PALM):
        line(a, b)
    for index, posture in enumerate(POSTURES[gesture]):
        points = _points(_FINGERS[index], posture, thumb=index == 0)
        for shift in (-1.2, 1.2):  # two strokes make a finger
            moved = [(x + shift, y) for x, y in points]
            for a, b in pairwise(moved):
                line(a, b)
    return canvas.text()


def _points(finger: _Finger, posture: Posture, *, thumb: bool) -> list[tuple[float, float]]:
    (x, y), (tip_x, tip_y) = finger.knuckle, finger.tip
    middle = (x + (tip_x - x) * 0.5, y + (tip_y - y) * 0.5)
    if posture is Posture.OPEN:
        return [(x, y), (tip_x, tip_y)]
    if posture is Posture.PINCHED:
        return [(x, y), middle, _PINCH]
    if posture is Posture.HOOKED:
        return [(x, y), middle, (middle[0] - 7, middle[1] + 1), (middle[0] - 8, middle[1] + 7)]
    if thumb:
        return [(x, y), (x + 16, y - 4)]
    return [(x, y), (x + (tip_x - x) * 0.2, y + (tip_y - y) * 0.2), (x + 1, y + 12)]


def differences(target: Gesture, seen: Gesture) -> tuple[tuple[str, Posture], ...]:
    """Finger names and what each should be, where the hand that is seen differs from the one that is wanted."""
    pairs = zip(FINGER_NAMES, POSTURES[target], POSTURES[seen], strict=True)
    return tuple((name, wanted) for name, wanted, got in pairs if wanted is not got)
