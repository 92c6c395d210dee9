"""The virtual button's limits and values: its place, what a frame gives it, what is compared, and its state after it.

How a press begins and ends: `kgdfa/button.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from kgdfa.distance import DistanceSource
from kgdfa.gesture import Gesture

if TYPE_CHECKING:
    from kgdfa.hand import Box

HYSTERESIS = 0.20  # a press ends, and a new one may begin, beyond this share over the threshold: three sd of keypoints
APPROACH_M_S = 3.5  # a 0.3 s press from 36 cm peaks at 2.7 m/s, its safe distance at a tenth more; faster is a slip
# Press to release, two frames: keypoints that slip for a frame slip back in the next. Where that one is lost, or comes
# later than this, time alone does not tell: a second frame has to see the hand near (`measured_near`).
SHORTEST_PRESS_NS = 50_000_000
# `rleex evaluate` pushes and withdraws in 3 s at most; a slow hand gets three times as long. What one that stays longer
# still means, nobody knows: cut off by the image's edge it keeps its gesture unread.
LONGEST_PRESS_NS = 10_000_000_000
RADIUS_SHARE = 0.06  # the button's radius, of the picture's width: a coin held at arm's length
GAP_FRAMES = 2  # in a row without a hand or a distance that a press and an approach survive, as long as at 30 Hz
STALE_NS = 250_000_000  # frames further apart than this don't tell what happened between them
# A press begins with an approach: within five frames the distance fell by this share of the threshold. A hand that
# hovers about the threshold crosses it more slowly; a push of 0.8 s from 7 cm outside is three times as fast.
APPROACH_NS = 170_000_000
APPROACH_SHARE = 0.15


class PressCancel(Enum):
    """Why a press ended without a command."""

    HAND_LOST = "hand lost"
    DISTANCE_LOST = "distance lost"
    GESTURE_CHANGED = "gesture changed"
    LEFT_SIDEWAYS = "left sideways"
    TOO_SHORT = "too short"
    TOO_LONG = "too long"
    CAMERA_PAUSED = "camera paused"
    ENDED = "ended"  # no more frames: the session ended, or the camera was replaced


class PressHint(Enum):
    """Why a hand that is near, or just was, does not press: what to do."""

    WITHDRAW_FIRST = "withdraw first"
    PUSH_STEADILY = "push steadily"
    APPROACH_FIRST = "approach first"  # it hovers: the distance fell too slowly
    MORE_IMAGES = "more images"  # they are further apart than an approach lasts: none can be measured
    GESTURE_FIRST = "gesture first"
    KEEP_GESTURE = "keep gesture"
    OVER_BUTTON = "over button"
    PUSH_NEARER = "push nearer"  # it turned back before the threshold, or too few images saw it nearer


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

    @property
    def release_m(self) -> float:
        """Farther is released, and ready for a press."""
        return self.threshold_m * (1 + HYSTERESIS)

    def beside_px(self, box: Box) -> float:
        """How far the button's centre is from the box, along the farther axis; 0 inside."""
        aside_px = max(box.left_px - self.x_px, self.x_px - box.right_px)
        return max(aside_px, box.top_px - self.y_px, self.y_px - box.bottom_px, 0.0)


class ButtonInput(Struct, frozen=True, kw_only=True):
    """What one frame gives to the button."""

    captured_ns: int
    gesture: Gesture | None  # voted
    recognised_ns: int  # capture of the frame whose vote made `gesture`
    replaced: bool = False  # it took another gesture's place then
    contradicted: bool = False  # the newest frames show another gesture
    distance_m: float | None  # safe distance; None: no measurement
    beside_px: float | None  # from the box of the 22 points to the button's centre, see `ButtonPlace`; None: no hand
    source: DistanceSource = DistanceSource.MONOCULAR  # of distance_m
    bridge_m: float | None = None  # what the keypoints would have decided by, while depth decides
    repeated: bool = False  # by the depth map of a frame before

    @property
    def measured_m(self) -> float | None:
        """The distance where there is a hand and a real one; 0, negative and non-finite are no measurement."""
        if self.beside_px is None or self.distance_m is None:
            return None
        return self.distance_m if math.isfinite(self.distance_m) and self.distance_m > 0 else None


class ButtonComparison(Struct, frozen=True, kw_only=True):
    """What one frame's decision compared: each value beside its limit. None: not measured."""

    captured_ns: int
    elapsed_ns: int  # since the frame before; 0: it is the first
    distance_m: float | None  # safe distance
    previous_m: float | None  # the newest before it, over a gap as well
    threshold_m: float  # nearer is pressed
    release_m: float  # farther is released, and ready for a press
    nearer_m: float | None  # how much nearer the hand came since the measurement before
    nearer_limit_m: float
    beside_px: float | None  # from the box to the button's centre; 0: the box covers it
    beside_limit_px: float  # 0 for a press, the radius while pressed
    held_ns: int  # since the press; 0: not pressed
    gap_frames: int  # in a row without a measurement, before this frame
    approached_m: float | None  # how far the distance fell from its farthest in the last APPROACH_NS
    approach_limit_m: float  # a press needs at least this much
    elapsed_limit_ns: int = STALE_NS  # later, the camera paused
    held_limit_ns: int = SHORTEST_PRESS_NS  # shorter is no press; of one that was too long the longest
    gap_limit_frames: int = GAP_FRAMES  # more lose the hand; above 30 Hz, and after STALE_NS, as many as there were
    source: DistanceSource = DistanceSource.MONOCULAR  # of distance_m
    source_changed: bool = False  # since the measurement before: nothing is pressed or released


class ButtonState(Struct, frozen=True, kw_only=True):
    """The button after a frame. Counts only grow, so a lost report loses no release."""

    pressed: bool = False
    pressed_gesture: Gesture | None = None
    pressed_captured_ns: int = 0
    measured_near: bool = False  # since the frame that pressed, another one measured the hand within release_m
    release_count: int = 0
    released_gesture: Gesture | None = None
    released_recognised_ns: int = 0
    released_pressed_ns: int = 0
    released_ns: int = 0
    cancel_count: int = 0
    cancel_reason: PressCancel | None = None
    ready: bool = False  # the hand has been seen outside the threshold since the last release or cancel
    last_captured_ns: int = 0
    pressed_recognised_ns: int = 0
    far_gesture: Gesture | None = None  # voted while the hand was last outside: what a press may mean
    last_distance_m: float | None = None  # the newest measurement; None: none since the hand was lost
    gap_frames: int = 0  # frames in a row without a measurement
    approach: tuple[tuple[int, float], ...] = ()  # (captured_ns, distance_m) of the last APPROACH_NS, oldest first
    hint: PressHint | None = None  # why a hand that is near, or just was, does not press
    source: DistanceSource | None = None  # of the newest measurement
    bridge_ratio: float | None = None  # newest depth over what the keypoints then measured; None: not both
    compared: ButtonComparison | None = None  # in the newest frame; None before the first


def of_another_hand(state: ButtonState) -> ButtonState:
    """Without what only the hand before was seen doing; its press, if any, ends by the other one's empty vote."""
    return replace(
        state,
        ready=False,
        far_gesture=None,
        last_distance_m=None,
        approach=(),
        hint=None,
        source=None,
        bridge_ratio=None,
    )


def is_near(state: ButtonState, place: ButtonPlace) -> bool:
    """Whether the hand is pressing or about to: there a gesture is held by more than three frames."""
    return state.pressed or (state.last_distance_m is not None and state.last_distance_m <= place.release_m)


def is_approaching(state: ButtonState, place: ButtonPlace) -> bool:
    """Whether the hand has come nearer, in the last APPROACH_NS, by half of what a press needs."""
    last_m = state.last_distance_m
    if last_m is None:
        return False
    nearer_m = max((distance_m for _, distance_m in state.approach), default=last_m) - last_m
    return nearer_m >= APPROACH_SHARE / 2 * place.threshold_m
