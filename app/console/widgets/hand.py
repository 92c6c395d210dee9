"""The hand that a learner copies, in braille, with what is wrong marked on it. Pure."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

from app.console.lessons import WrongFinger
from app.console.widgets.canvas import Canvas
from app.console.widgets.panel import Lines
from kgdfa.gesture import FINGER_STATES, Finger, FingerState, Gesture

Point = tuple[float, float]


# A hand of 60 by 72 units and four above it, y down; the wearer's right hand, palm to the camera.
_FINGERS: tuple[tuple[Point, Point], ...] = (  # knuckle and open tip
    ((17, 52), (2, 34)),
    ((20, 38), (14, 6)),
    ((29, 36), (28, 2)),
    ((38, 38), (42, 6)),
    ((46, 42), (56, 16)),
)
_PALM: tuple[Point, ...] = ((22, 70), (14, 56), (20, 38), (29, 36), (38, 38), (46, 42), (42, 70), (22, 70))
_PINCH = (12.0, 20.0)
_WIDE, _HIGH, _ABOVE = 60, 76, 4
_PALM_MIDDLE = (31, 56)
# Pens: a hand to copy, one that is right, a finger that is wrong, and what it does instead.
_COPY, _RIGHT, _WRONG, _INSTEAD = "$primary", "bold $success", "bold $warning", "$error"
_WRONG_SIGN, _RIGHT_SIGN = "✗", "✓"  # beside the pen: no state by colour alone
_DOTTED = 3  # one dot in so many


class _Sheet:
    """A canvas in the drawing's units."""

    def __init__(self, columns: int, rows: int, *, left_hand: bool) -> None:
        self.canvas = Canvas(columns, rows)
        self._left_hand = left_hand
        self._scale = min(self.canvas.width / _WIDE, self.canvas.height / _HIGH)
        self._aside = (self.canvas.width - _WIDE * self._scale) / 2

    def stroke(self, points: list[Point], *, bold: bool = False, every: int = 1) -> None:
        """Lines from point to point."""
        for a, b in pairwise(map(self._at, points)):
            if bold:
                self.canvas.bold_line(*a, *b)
            else:
                self.canvas.line(*a, *b, every=every)

    def finger(self, which: Finger, state: FingerState, *, bold: bool = False, every: int = 1) -> Point:
        """Two strokes; where its highest point is."""
        points = _points(_FINGERS[which], state, thumb=which is Finger.THUMB)
        for shift in (-1.2, 1.2):
            self.stroke([(x + shift, y) for x, y in points], bold=bold, every=every)
        return min(points, key=lambda point: point[1])

    def sign(self, point: Point, text: str, style: str) -> None:
        """A letter at a point, or at the edge next to it."""
        x, y = self._at(point)
        column = min(self.canvas.columns - 1, max(0, round(x) // 2))
        self.canvas.text(column, min(self.canvas.rows - 1, max(0, round(y) // 4)), text, style)

    def _at(self, point: Point) -> Point:
        x = _WIDE - point[0] if self._left_hand else point[0]
        return self._aside + x * self._scale, (_ABOVE + point[1]) * self._scale


@lru_cache(maxsize=16)  # the same hand is asked for twenty times a second
def draw_hand(
    gesture: Gesture,
    columns: int,
    rows: int,
    wrong: tuple[WrongFinger, ...] = (),
    *,
    right: bool = False,
    left_hand: bool = False,
) -> Lines:
    """The gesture as lines of braille: a wrong finger thick and marked, dotted what it does instead.

    right: it is being shown. left_hand: mirrored.
    """
    sheet = _Sheet(columns, rows, left_hand=left_hand)
    sheet.canvas.pen = _RIGHT if right else _COPY
    sheet.stroke(list(_PALM))
    marked = dict(wrong)
    for finger, state in zip(Finger, FINGER_STATES[gesture], strict=True):
        if finger not in marked:
            sheet.finger(finger, state)
    tops = [_wrong_finger(sheet, finger, FINGER_STATES[gesture][finger], does) for finger, does in wrong]
    for x, y in tops:
        sheet.sign((x, y - _ABOVE), _WRONG_SIGN, _WRONG)
    if right:
        sheet.sign(_PALM_MIDDLE, _RIGHT_SIGN, _RIGHT)
    return sheet.canvas.lines()


def _wrong_finger(sheet: _Sheet, finger: Finger, wanted: FingerState, does: FingerState | None) -> Point:
    """Where its highest point is."""
    sheet.canvas.pen = _INSTEAD
    tops = [sheet.finger(finger, does, every=_DOTTED)] if does else []
    sheet.canvas.pen = _WRONG
    tops.append(sheet.finger(finger, wanted, bold=True))
    return min(tops, key=lambda point: point[1])


def _points(finger: tuple[Point, Point], state: FingerState, *, thumb: bool) -> list[Point]:
    (x, y), (tip_x, tip_y) = finger
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
