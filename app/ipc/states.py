"""The words control speaks: gait states, actions, effects, sources. Tables that use them live beside them."""

from __future__ import annotations

from enum import Enum, IntEnum

from kgdfa.gesture import Gesture


class GaitState(Enum):
    """The paper's eight gait states, and the one that a stop leads to."""

    UNPOWERED = "unpowered"
    STANDING = "standing"
    SITTING = "sitting"
    RIGHT_FORWARD = "right leg forward"
    LEFT_FORWARD = "left leg forward"
    RIGHT_HIGH_STEP = "right leg high step"
    RIGHT_LOW_STEP = "right leg low step"
    RIGHT_OBSTACLE = "right leg obstacle crossing"
    BETWEEN = "between states"  # after a stop in mid-action: only gesture 0 leads out, slowly


class Action(Enum):
    """What the legs can be asked to do, one a gesture (Table 1)."""

    INITIALISE = "initialise"
    STEP_RIGHT_FIRST = "step: right leg starts"
    STEP_LEFT = "step: left leg"
    STEP_RIGHT = "step: right leg"
    STEP_END = "step: close and stand"
    WALK = "walk"
    WALK_END = "end the walk"
    STAIR_UP = "climb a stair"
    STAIR_DOWN = "descend a stair"
    OBSTACLE = "cross an obstacle"
    SIT_DOWN = "sit down"
    STAND_UP = "stand up"


ACTION_OF: dict[Gesture, Action] = {
    Gesture.ZERO: Action.INITIALISE,
    Gesture.ONE: Action.STEP_RIGHT_FIRST,
    Gesture.TWO: Action.STEP_LEFT,
    Gesture.THREE: Action.STEP_RIGHT,
    Gesture.FOUR: Action.STEP_END,
    Gesture.FIVE: Action.WALK,
    Gesture.SIX: Action.WALK_END,
    Gesture.SEVEN: Action.STAIR_UP,
    Gesture.EIGHT: Action.STAIR_DOWN,
    Gesture.NINE: Action.OBSTACLE,
    Gesture.LOVE: Action.SIT_DOWN,
    Gesture.ROCK: Action.STAND_UP,
}
GESTURE_OF: dict[Action, Gesture] = {action: gesture for gesture, action in ACTION_OF.items()}


class Effect(IntEnum):
    """What an event does to the legs; the strongest of those active wins."""

    NOTE = 0
    REFUSE = 1  # no new action, the running one ends
    HOLD = 2  # slow down along the path within 150 ms, stay there stiffly
    DAMP = 3  # pure damping, ramped from the last command


class Source(Enum):
    """Whose wish an action was."""

    GESTURE = "gesture"
    THERAPIST = "therapist"
