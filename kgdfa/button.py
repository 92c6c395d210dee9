"""The virtual button: pressed by a hand that comes near, released by one that withdraws, cancelled by all else.

`published` is the paper's rule, literally: pressed while the hand is nearer than the threshold and its bounding
box covers the button, else released, and every release commands. `robust` presses only a hand that was seen
outside the threshold and crossed it with a voted gesture over the button, and commands only when that hand
withdraws; any other end of a press is a cancel with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

from kgdfa.gesture import Gesture
from kgdfa.hand import Box

HYSTERESIS = 0.20  # a press ends, and a new one may begin, beyond this share over the threshold: three sd of keypoints
APPROACH_M_S = 3.5  # a 0.3 s press from 36 cm peaks at 2.7 m/s, its safe distance at a tenth more; faster is a slip
SHORTEST_PRESS_NS = 50_000_000  # press to release, two frames: keypoints that slip for a frame slip back in the next
RADIUS_SHARE = 0.06  # the button's radius, of the picture's width: a coin held at arm's length
GAP_FRAMES = 2  # frames in a row without a hand or a distance that a press survives
STALE_NS = 250_000_000  # pictures further apart than this say nothing about the time between


class ButtonMode(Enum):
    """Which rule the button follows."""

    PUBLISHED = "published"
    ROBUST = "robust"


@dataclass(frozen=True, slots=True, kw_only=True)
class ButtonPlace:
    """Where the button is on the picture and how near is pressed."""

    x_px: float
    y_px: float
    radius_px: float
    threshold_m: float

    @classmethod
    def in_the_middle(cls, width_px: float, height_px: float, threshold_m: float) -> ButtonPlace:
        """Of a picture of that size."""
        return cls(x_px=width_px / 2, y_px=height_px / 2, radius_px=RADIUS_SHARE * width_px, threshold_m=threshold_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class ButtonInput:
    """What one frame says to the button."""

    captured_ns: int
    gesture: Gesture | None  # voted
    recognised_ns: int  # capture of the frame whose vote made `gesture`
    distance_m: float | None  # safe distance; None: no measurement
    box: Box | None  # bounding box of the 22 points; None: no hand


@dataclass(frozen=True, slots=True, kw_only=True)
class ButtonState:
    """The button after a frame. Counts only grow, so a lost report loses no release."""

    pressed: bool = False
    pressed_gesture: Gesture | None = None
    pressed_captured_ns: int = 0
    release_count: int = 0
    released_gesture: Gesture | None = None
    released_recognised_ns: int = 0
    released_ns: int = 0
    cancel_count: int = 0
    cancel_reason: str = ""
    ready: bool = False  # the hand has been seen outside the threshold since the last release or cancel
    last_captured_ns: int = 0
    pressed_recognised_ns: int = 0
    far_gesture: Gesture | None = None  # voted while the hand was last outside: what a press may mean
    last_distance_m: float | None = None  # of the frame before; None: it gave no measurement
    gap_frames: int = 0  # frames in a row without a measurement
    hint: str = ""  # why a hand that is near does not press, for people


def advance(state: ButtonState, seen: ButtonInput, place: ButtonPlace, mode: ButtonMode) -> ButtonState:
    """The button after one more frame. A frame given twice changes nothing."""
    if seen.captured_ns == state.last_captured_ns:
        return state
    after = _RULES[mode](state, seen, place)
    return replace(after, last_captured_ns=seen.captured_ns)


def _published(state: ButtonState, seen: ButtonInput, place: ButtonPlace) -> ButtonState:
    near = seen.distance_m is not None and seen.distance_m < place.threshold_m
    pressed = near and _covers(seen.box, place, 0.0)
    if pressed == state.pressed:
        return replace(state, ready=True)
    return _press(state, seen) if pressed else _release(state, seen, seen.gesture or state.pressed_gesture)


def _robust(state: ButtonState, seen: ButtonInput, place: ButtonPlace) -> ButtonState:
    if state.last_captured_ns and not 0 < seen.captured_ns - state.last_captured_ns <= STALE_NS:
        state = _end(state, "the camera paused, so the press does not count")
    distance_m = _measured(seen)
    if distance_m is None:
        return replace(_gap(state, seen), last_distance_m=None)
    state = replace(state, gap_frames=0)
    judge = _while_pressed if state.pressed else _while_up
    return replace(judge(state, seen, place, distance_m), last_distance_m=distance_m)


def _while_pressed(state: ButtonState, seen: ButtonInput, place: ButtonPlace, distance_m: float) -> ButtonState:
    if seen.gesture is not state.pressed_gesture:
        return _end(state, "the gesture changed during the press")
    if not _covers(seen.box, place, place.radius_px):
        return _end(state, "the hand left the button sideways")
    if distance_m <= _outside_m(place):
        return state
    wrong = _what_is_wrong_with_the_withdrawal(state, seen)
    return _end(state, wrong) if wrong else _release(state, seen, state.pressed_gesture)


def _what_is_wrong_with_the_withdrawal(state: ButtonState, seen: ButtonInput) -> str:
    """Why a hand that is outside again has not withdrawn; empty when it has. Keypoints that slip near slip back."""
    if state.last_distance_m is None:
        return "the hand was not seen withdrawing"
    if seen.captured_ns - state.pressed_captured_ns < SHORTEST_PRESS_NS:
        return "the press was shorter than a hand can make it"
    return ""


def _while_up(state: ButtonState, seen: ButtonInput, place: ButtonPlace, distance_m: float) -> ButtonState:
    if distance_m >= place.threshold_m:
        if distance_m <= _outside_m(place):
            return state
        return replace(state, ready=True, far_gesture=seen.gesture, hint="")
    if not state.ready:
        return replace(state, hint=state.hint or "draw the hand back, then push again")
    wrong = _what_is_wrong(state, seen, place, distance_m)
    if wrong:
        return replace(state, ready=False, hint=wrong)
    return _press(state, seen)


def _what_is_wrong(state: ButtonState, seen: ButtonInput, place: ButtonPlace, distance_m: float) -> str:
    """Why a hand that is near and was outside does not press; empty when it does."""
    if not _approached(state, seen, distance_m):
        return "push steadily, so that the camera can follow"
    if seen.gesture is None:
        return "show a gesture first, then push"
    if seen.gesture is not state.far_gesture:
        return "keep the gesture while you push"
    return "" if _covers(seen.box, place, 0.0) else "bring the hand over the button, then push"


def _approached(state: ButtonState, seen: ButtonInput, distance_m: float) -> bool:
    """Whether the hand was seen coming: measured in the frame before, and no farther off than a hand can reach."""
    if state.last_distance_m is None:
        return False
    elapsed_s = (seen.captured_ns - state.last_captured_ns) / 1e9
    return state.last_distance_m - distance_m <= APPROACH_M_S * elapsed_s


def _gap(state: ButtonState, seen: ButtonInput) -> ButtonState:
    """A frame without a measurement: short gaps are blur, longer ones end the press and the readiness."""
    if state.gap_frames < GAP_FRAMES:
        return replace(state, gap_frames=state.gap_frames + 1)
    what = "hand was lost" if seen.box is None else "distance was lost"
    return _end(state, f"the {what} during the press")


def _press(state: ButtonState, seen: ButtonInput) -> ButtonState:
    return replace(
        state,
        pressed=True,
        pressed_gesture=seen.gesture,
        pressed_captured_ns=seen.captured_ns,
        pressed_recognised_ns=seen.recognised_ns,
        ready=False,
        hint="",
    )


def _release(state: ButtonState, seen: ButtonInput, gesture: Gesture | None) -> ButtonState:
    """Up again, by withdrawal: the command goes out, once. Without a gesture there is no command to give."""
    up = replace(state, pressed=False, pressed_gesture=None, ready=True, hint="")
    if gesture is None:
        return up
    return replace(
        up,
        release_count=state.release_count + 1,
        released_gesture=gesture,
        released_recognised_ns=state.pressed_recognised_ns or seen.recognised_ns,
        released_ns=seen.captured_ns,
    )


def _end(state: ButtonState, reason: str) -> ButtonState:
    """No longer ready; a press under way is cancelled: no command, and the reason kept."""
    if not state.pressed:
        return replace(state, ready=False)
    return replace(
        state,
        pressed=False,
        pressed_gesture=None,
        ready=False,
        cancel_count=state.cancel_count + 1,
        cancel_reason=reason,
    )


def _measured(seen: ButtonInput) -> float | None:
    """The distance where there is a hand and a real one; 0, negative and non-finite are no measurement."""
    if seen.box is None or seen.distance_m is None:
        return None
    return seen.distance_m if math.isfinite(seen.distance_m) and seen.distance_m > 0 else None


def is_near(state: ButtonState, place: ButtonPlace) -> bool:
    """Whether the hand is pressing or about to: there a gesture is held by more than three frames."""
    return state.pressed or (state.last_distance_m is not None and state.last_distance_m <= _outside_m(place))


def _outside_m(place: ButtonPlace) -> float:
    return place.threshold_m * (1 + HYSTERESIS)


def _covers(box: Box | None, place: ButtonPlace, slack_px: float) -> bool:
    """Whether the box, grown by the slack, contains the button's centre."""
    if box is None:
        return False
    inside_x = box.left_px - slack_px <= place.x_px <= box.right_px + slack_px
    return inside_x and box.top_px - slack_px <= place.y_px <= box.bottom_px + slack_px


_RULES: dict[ButtonMode, Callable[[ButtonState, ButtonInput, ButtonPlace], ButtonState]] = {
    ButtonMode.PUBLISHED: _published,
    ButtonMode.ROBUST: _robust,
}
