"""A hand drawn in braille from a row of finger states: what the learner is to copy. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from app.console.widgets.step_drawing import Braille
from kgdfa.gesture import FINGER_STATES, Finger, FingerState, Gesture


@dataclass(frozen=True, slots=True)
class _Drawn:
    """Knuckle and open tip on a drawing of 60 by 72 units, y down; the wearer's right hand, palm to the camera."""

    knuckle: tuple[float, float]
    tip: tuple[float, float]


_FINGERS = (
    _Drawn((17, 52), (2, 34)),
    _Drawn((20, 38), (14, 6)),
    _Drawn((29, 36), (28, 2)),
    _Drawn((38, 38), (42, 6)),
    _Drawn((46, 42), (56, 16)),
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
    for index, state in enumerate(FINGER_STATES[gesture]):
        points = _points(_FINGERS[index], state, thumb=index == 0)
        for shift in (-1.2, 1.2):  # two strokes make a finger
            moved = [(x + shift, y) for x, y in points]
            for a, b in pairwise(moved):
                line(a, b)
    return canvas.text()


def _points(finger: _Drawn, state: FingerState, *, thumb: bool) -> list[tuple[float, float]]:
    (x, y), (tip_x, tip_y) = finger.knuckle, finger.tip
    middle = (x + (tip_x - x) * 0.5, y + (tip_y - y) * 0.5)
    if state is FingerState.OPEN:
        return [(x, y), (tip_x, tip_y)]
    if state is FingerState.PINCHED:
        return [(x, y), middle, _PINCH]
    if state is FingerState.HOOKED:
        return [(x, y), middle, (middle[0] - 7, middle[1] + 1), (middle[0] - 8, middle[1] + 7)]
    if thumb:
        return [(x, y), (x + 16, y - 4)]
    return [(x, y), (x + (tip_x - x) * 0.2, y + (tip_y - y) * 0.2), (x + 1, y + 12)]


def differences(target: Gesture, detected: Gesture) -> tuple[tuple[Finger, FingerState], ...]:
    """The fingers that differ from the wanted gesture, and what each should do."""
    pairs = zip(Finger, FINGER_STATES[target], FINGER_STATES[detected], strict=True)
    return tuple((finger, wanted) for finger, wanted, got in pairs if wanted is not got)
