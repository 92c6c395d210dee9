"""What a gesture needs on top of the perceptrons' verdict (`robust`): measures that must lie within fixed limits."""

from __future__ import annotations

import math
import statistics
from enum import Enum
from typing import NamedTuple

from kgdfa.features import FEATURES, Measure
from kgdfa.gesture import Explanation, Finger, FingerState, Gesture, fingers_in
from kgdfa.hand import FloatArray


class Condition(Enum):
    """What a gesture needs besides the perceptrons' verdict: the code of an explanation. In palm lengths or degrees."""

    THUMB_NOT_FOLDED = "thumb not folded"  # finger, other; value, limit: its tip from the other's
    TIPS_NOT_CLOSED = "tips not closed"  # finger, other; value, limit
    FINGER_NOT_FOLDED = "finger not folded"  # finger; value, limit: off the palm's plane
    THUMB_NOT_OPEN = "thumb not open"  # finger, other; value, limit: its tip from the other's tip or joint
    FINGER_NOT_OPEN = "finger not open"  # finger; value, limit: its tip beyond the palm's hull
    FINGER_NOT_HOOKED = "finger not hooked"  # finger; value, limit: its tip from its knuckle, on the image
    FINGER_NOT_STRAIGHT = "finger not straight"  # finger; value, limit: degrees, on the image
    TIP_BEYOND_PALM = "tip beyond palm"  # finger; value, limit: along the palm, from the knuckles


def _columns(measure: Measure, *fingers: Finger, on_image: bool = False) -> list[int]:
    """Where a measure of these fingers stands among the features, in space and, if it is there, on the image."""
    columns = [k for k, feature in enumerate(FEATURES) if (feature.measure, feature.fingers) == (measure, fingers)]
    return [k for k in columns if FEATURES[k].on_image] if on_image else columns


class Need(NamedTuple):
    """A measure, the mean of these features, that an accepted gesture must have from `low` to `high`, in their unit.

    otherwise: another one that does as well.
    """

    condition: Condition
    fingers: tuple[Finger, ...]
    columns: list[int]
    low: float
    high: float
    otherwise: Need | None = None

    def measure(self, values: FloatArray) -> float:
        """The mean of the features' medians over all augmentations, (n, F)."""
        return statistics.fmean(statistics.median(values[:, column].tolist()) for column in self.columns)

    def holds(self, values: FloatArray) -> bool:
        """Whether it, or the other one, lies within its limits."""
        within = self.low <= self.measure(values) <= self.high
        return within or (self.otherwise is not None and self.otherwise.holds(values))


def _need(
    condition: Condition,
    measure: Measure,
    *fingers: Finger,
    low: float = -math.inf,
    high: float = math.inf,
    otherwise: Need | None = None,
    on_image: bool = False,
) -> Need:
    return Need(condition, fingers, _columns(measure, *fingers, on_image=on_image), low, high, otherwise)


def _open_fingers(gesture: Gesture) -> tuple[Need, ...]:
    """The tips of open fingers lie outside the palm's hull, as in Table 2."""
    opened = fingers_in(gesture, FingerState.OPEN)
    return tuple(_need(Condition.FINGER_NOT_OPEN, Measure.TIP_BEYOND_OUTER_HULL, finger, low=0.10) for finger in opened)


# What gestures need on top of the perceptrons; docs/explanation/gestures.md tells how the limits were chosen.
# 0: a folded thumb, near the ring finger's tip or bent at its end, mean of space and image, else it is a thumb up.
# 6: an open thumb, else it is the little finger alone.
# 7: closed tips as in Eq. 3, the thumb's from the forefinger's and the middle one's, mean of space and image, since
# MediaPipe's depth alone parts closed tips, and a view along the fingers closes open ones; ring and little finger
# folded, as in Table 2: their tips near the palm's plane, and the ring finger's on the palm, else all five may touch.
# 1: a straight forefinger, else it is a 9; 2: a folded thumb; 8: a thumb away from the folded middle finger, else a 1;
# 9: a hook, else a fist: by its length, for the tip of one that trembles is often within the hull.
_OWN_NEEDS: dict[Gesture, tuple[Need, ...]] = {
    Gesture.ZERO: (
        _need(
            *(Condition.THUMB_NOT_FOLDED, Measure.TIPS_APART, Finger.THUMB, Finger.RING),
            high=0.75,
            otherwise=_need(Condition.THUMB_NOT_FOLDED, Measure.END_JOINT, Finger.THUMB, high=153.0),
        ),
    ),
    Gesture.ONE: (_need(Condition.FINGER_NOT_STRAIGHT, Measure.ANGLE, Finger.FORE, low=155.0, on_image=True),),
    Gesture.TWO: (_need(Condition.THUMB_NOT_FOLDED, Measure.TIPS_APART, Finger.THUMB, Finger.PINKY, high=0.90),),
    Gesture.SIX: (_need(Condition.THUMB_NOT_OPEN, Measure.TIP_TO_JOINT, Finger.THUMB, Finger.MIDDLE, low=0.50),),
    Gesture.SEVEN: (
        _need(Condition.TIPS_NOT_CLOSED, Measure.TIPS_APART, Finger.THUMB, Finger.FORE, high=0.65),
        _need(Condition.TIPS_NOT_CLOSED, Measure.TIPS_APART, Finger.THUMB, Finger.MIDDLE, high=0.80),
        _need(Condition.FINGER_NOT_FOLDED, Measure.REACH_OFF, Finger.RING, high=0.55),
        _need(Condition.TIP_BEYOND_PALM, Measure.REACH_ALONG, Finger.RING, high=0.05),
        _need(Condition.FINGER_NOT_FOLDED, Measure.REACH_OFF, Finger.PINKY, high=0.55),
    ),
    Gesture.EIGHT: (_need(Condition.THUMB_NOT_OPEN, Measure.TIPS_APART, Finger.THUMB, Finger.MIDDLE, low=0.60),),
    Gesture.NINE: (_need(Condition.FINGER_NOT_HOOKED, Measure.LENGTH, Finger.FORE, low=0.26),),
}
NEEDS = {gesture: (*_OWN_NEEDS.get(gesture, ()), *_open_fingers(gesture)) for gesture in Gesture}


def missing_condition(gesture: Gesture, values: FloatArray) -> Explanation | None:
    """What an accepted gesture lacks, from the features of all augmentations, (n, F); None when it lacks nothing."""
    need = next((need for need in NEEDS[gesture] if not need.holds(values)), None)
    if need is None:
        return None
    limit = need.high if math.isfinite(need.high) else need.low
    fingers = dict[str, object](zip(("finger", "other"), need.fingers, strict=False))
    return Explanation(need.condition, fingers | {"value": need.measure(values), "limit": limit})
