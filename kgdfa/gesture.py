"""The twelve gestures by name and by finger. Apart from the hand: naming a gesture needs no arrays.

The one home of what each finger does (Tables 1 and 2). Derived from it: Table 2 as rules, the drawings of the console,
the labels of synthetic hands. The digital hand may not import this package; a test compares its poses.
"""

from __future__ import annotations

from enum import Enum, IntEnum


class Gesture(Enum):
    """The paper's twelve gestures (Table 1). "None of them" is Python's None."""

    ZERO = "0"
    ONE = "1"
    TWO = "2"
    THREE = "3"
    FOUR = "4"
    FIVE = "5"
    SIX = "6"
    SEVEN = "7"
    EIGHT = "8"
    NINE = "9"
    LOVE = "love"
    ROCK = "rock"


class Finger(IntEnum):
    """In the order of every (5,) array of this package; the names are the paper's."""

    THUMB = 0
    FORE = 1
    MIDDLE = 2
    RING = 3
    PINKY = 4


class FingerState(Enum):
    """Of one finger, as Table 2 tells them apart."""

    FOLDED = "folded"
    OPEN = "open"
    HOOKED = "hooked"  # stretched at the knuckle, bent at the middle joint: gesture 9
    PINCHED = "pinched"  # tips together: gesture 7


_F, _O, _H, _P = FingerState
FINGER_STATES: dict[Gesture, tuple[FingerState, FingerState, FingerState, FingerState, FingerState]] = {
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


def fingers_in(gesture: Gesture, *states: FingerState) -> tuple[Finger, ...]:
    """The fingers of a gesture that are in one of these states."""
    return tuple(finger for finger in Finger if FINGER_STATES[gesture][finger] in states)
