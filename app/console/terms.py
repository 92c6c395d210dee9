"""Words of the domain in the therapist's language: states, actions, gestures, effects, events."""

from __future__ import annotations

from app.console.sentences import event_words
from app.ipc.messages import ActiveEvent
from app.ipc.states import ACTION_OF, GESTURE_OF, Action, Effect, GaitState
from app.text.catalogue import tr
from kgdfa.gesture import FINGER_STATES, Finger, FingerState, Gesture

# Fingers as strokes, thumb first: hand emoji are wide characters, which terminals measure differently.
_STROKES = {
    FingerState.FOLDED: "··",
    FingerState.OPEN: "\\|",
    FingerState.HOOKED: "??",
    FingerState.PINCHED: ">|",
}
FINGERS = {
    gesture: "".join(_STROKES[state][finger != Finger.THUMB] for finger, state in zip(Finger, states, strict=True))
    for gesture, states in FINGER_STATES.items()
}
EFFECT_MARKS = {Effect.NOTE: "i", Effect.REFUSE: "-", Effect.HOLD: "!", Effect.DAMP: "‼"}
EFFECT_STYLES = {
    Effect.NOTE: "$text-muted",
    Effect.REFUSE: "$warning",
    Effect.HOLD: "bold $error",
    Effect.DAMP: "bold reverse $error",
}


def state_name(state: GaitState) -> str:
    """The state as the therapist calls it."""
    return tr(state)


def action_name(action: Action) -> str:
    """The action as the therapist calls it."""
    return tr(action)


def gesture_name(gesture: Gesture) -> str:
    """The gesture's short name."""
    return tr(gesture)


def gesture_of(action: Action) -> str:
    """The name of the gesture that asks for the action."""
    return gesture_name(GESTURE_OF[action])


def action_of(gesture: Gesture) -> str:
    """What the gesture asks for."""
    return action_name(ACTION_OF[gesture])


def effect_name(effect: Effect) -> str:
    """What the effect does, in a word."""
    return tr(effect)


def event_text(event: ActiveEvent) -> str:
    """The event in the therapist's language, with its numbers."""
    return event_words(event.name, event.text)
