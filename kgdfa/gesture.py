"""The twelve gestures by name: apart from the hand, because who only names them has no use for its arrays."""

from __future__ import annotations

from enum import Enum


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
