"""The course: which gesture is signed in which state, and where it must lead. Every transition of Table 1, once."""

from __future__ import annotations

from dataclasses import dataclass

from app.ipc.states import GaitState
from kgdfa.gesture import Gesture


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One leg of the course. `steps` is how many steps a walk takes before the next gesture is signed."""

    gesture: Gesture
    start: GaitState
    end: GaitState
    steps: int = 0


STANDING = GaitState.STANDING
ALL_TWELVE: tuple[Leg, ...] = (
    Leg(gesture=Gesture.ZERO, start=GaitState.UNPOWERED, end=STANDING),
    Leg(gesture=Gesture.LOVE, start=STANDING, end=GaitState.SITTING),
    Leg(gesture=Gesture.ROCK, start=GaitState.SITTING, end=STANDING),
    Leg(gesture=Gesture.ONE, start=STANDING, end=GaitState.RIGHT_FORWARD),
    Leg(gesture=Gesture.TWO, start=GaitState.RIGHT_FORWARD, end=GaitState.LEFT_FORWARD),
    Leg(gesture=Gesture.THREE, start=GaitState.LEFT_FORWARD, end=GaitState.RIGHT_FORWARD),
    Leg(gesture=Gesture.FOUR, start=GaitState.RIGHT_FORWARD, end=STANDING),
    Leg(gesture=Gesture.FIVE, start=STANDING, end=GaitState.LEFT_FORWARD, steps=3),
    Leg(gesture=Gesture.SIX, start=GaitState.LEFT_FORWARD, end=STANDING),
    Leg(gesture=Gesture.SEVEN, start=STANDING, end=STANDING),
    Leg(gesture=Gesture.EIGHT, start=STANDING, end=STANDING),
    Leg(gesture=Gesture.NINE, start=STANDING, end=STANDING),
)
