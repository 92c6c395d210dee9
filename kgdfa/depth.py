"""Hand to camera by a depth map: the depth of keypoint 21, and what is done where the map has no measurement.

A stereo camera gives 0 where it could not match: nearer than its minimum range, at the image's edge, at depth
jumps and while the hand flips. `published` takes that 0 as a distance, as the paper did; `robust` takes it as no
measurement. Which distance commands, the map's or the keypoints', is chosen in `choose_distance`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from kgdfa.distance import HALF_PALM_M, Distance, DistanceChoice, DistanceSource, OutlierState, accept_distance
from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.hand import Hand, Keypoint

DepthMap = NDArray[np.float32]

MAX_DEPTH_M = 10.0  # D435i data sheet: use range to about 10 m; 65.535 is its 16-bit saturation in millimetres
# Where the palm is read: points of the triangle 0-5-17, as shares of its corners, half a step inside it. Keypoint 21
# alone is under folded fingers in most gestures: there the map reads 5 cm near, or has their shadow.
_STEPS = 9
PALM_POINTS = np.array(
    [
        ((a + 0.5) / _STEPS, (b + 0.5) / _STEPS, 1 - (a + b + 1) / _STEPS)
        for a in range(_STEPS)
        for b in range(_STEPS - a)
    ]
)
MIN_VALID = 0.25  # share of them that must have measured
QUANTILE = 85  # of what they say: a thumb or folded fingers before the palm read near
MAX_SPREAD_M = 0.10  # between 5 and 95 % of them: a fist is half as thick, more is an edge
LEAST_M = 0.25  # the paper: nearer, a D435i gives 0
# Where the keypoints see a hand this much farther than the map, the map has not seen the palm: an error of theirs of
# 25 % (a tilt that they miss) and a palm width wrong by 15 % are less than that together.
AGREEMENT = 0.6
MOST_RATIO = 1.25  # how much farther than the keypoints' own a bridged hole may read
SENSOR_SD = 0.01  # D435i: about 1 % of distance in the near field, well inside its 2 % specification


_CORNERS = [Keypoint.WRIST, Keypoint.INDEX_MCP, Keypoint.PINKY_MCP]


class DepthFault(Enum):
    """Why a neighbourhood of the depth map gives no distance."""

    OUTSIDE = "outside"
    ZERO = "zero"  # too near, an edge, or a turning hand
    NOT_FINITE = "not finite"
    NEGATIVE = "negative"
    SATURATED = "saturated"
    EDGE = "edge"
    JUMP = "jump"  # further than a hand can move
    DISAGREEMENT = "disagreement"  # much nearer than the keypoints see the hand


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSample:
    """Depth of the palm in one frame, metres, or the fault that prevents it."""

    depth_m: float | None
    fault: DepthFault | None = None


# In the order in which a neighbourhood without enough measurements is named: what holds there most.
_INVALID: tuple[tuple[DepthFault, Callable[[DepthMap], NDArray[np.bool_]]], ...] = (
    (DepthFault.ZERO, lambda patch: patch == 0),
    (DepthFault.NOT_FINITE, lambda patch: ~np.isfinite(patch)),
    (DepthFault.NEGATIVE, lambda patch: patch < 0),
    (DepthFault.SATURATED, lambda patch: np.isfinite(patch) & (patch > MAX_DEPTH_M)),
)


def sample_palm(hand: Hand, depth_m: DepthMap) -> DepthSample:
    """The depth of keypoint 21 by all of the palm, (h, w) float32 map, metres: each point by the landmarks' tilt."""
    x, y = hand.palm_centre_px
    height, width = depth_m.shape
    if not (0 <= x < width and 0 <= y < height):
        return DepthSample(depth_m=None, fault=DepthFault.OUTSIDE)
    columns, rows = np.clip(np.round(PALM_POINTS @ hand.image_px[_CORNERS]), -1, max(width, height)).astype(int).T
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found = depth_m[rows[inside], columns[inside]]
    corners_m = hand.world_m[_CORNERS, 2]
    beyond_m = (PALM_POINTS @ corners_m - corners_m[1:].mean())[inside]
    measured = np.isfinite(found) & (found > 0) & (found <= MAX_DEPTH_M)
    if np.count_nonzero(measured) < MIN_VALID * len(PALM_POINTS):
        fault = max(_INVALID, key=lambda row: int(np.count_nonzero(row[1](found))))[0]
        return DepthSample(depth_m=None, fault=fault)
    low, palm, high = np.percentile((found - beyond_m)[measured], (5, QUANTILE, 95))
    if not high - low <= MAX_SPREAD_M:
        return DepthSample(depth_m=None, fault=DepthFault.EDGE)
    return DepthSample(depth_m=float(palm))


def reject_outlier(state: OutlierState, sample: DepthSample, captured_ns: int) -> tuple[OutlierState, DepthSample]:
    """Pass a sample that a moving hand can explain; hold back one that it can't until it has stayed."""
    if sample.depth_m is None:
        return state, sample
    after, accepted = accept_distance(state, sample.depth_m, captured_ns)
    return after, sample if accepted else DepthSample(depth_m=None, fault=DepthFault.JUMP)


def read_published(depth_m: DepthMap, hand: Hand) -> Distance:
    """The paper's reading: the map at keypoint 21, whatever stands there; outside 0, as librealsense gives."""
    column, row = (int(value) for value in np.round(np.nan_to_num(hand.palm_centre_px, nan=-1.0)))
    inside = 0 <= row < depth_m.shape[0] and 0 <= column < depth_m.shape[1]
    value = float(depth_m[row, column]) if inside else 0.0
    return Distance(shown_m=value, safe_m=value, sd_m=0.0, source=DistanceSource.DEPTH)


class DepthRange:
    """A distance from each depth map: `published` or `robust`, by name. `fault`: why the newest has none."""

    def __init__(self, *, mode: str) -> None:
        """Nothing seen yet. Raises KgdfaError for a mode that does not exist."""
        if mode not in {"published", "robust"}:
            raise KgdfaError(KgdfaFault.DEPTH_MODE, mode=mode)
        self.name = mode
        self.fault: DepthFault | None = None
        self._before = self._outliers = OutlierState()  # before the newest map, and after it
        self._map_ns: int | None = None  # of that map

    def measure(self, depth_m: DepthMap, hand: Hand, map_ns: int) -> Distance | None:
        """The palm's distance; None where the map has none. map_ns: of the map; one that comes again has the same.

        The map shows the skin; the joints, of which all distances speak, lie half a palm under it. A map that comes
        again is measured anew from what was known before it: it confirms no jump, and is believed no sooner.
        """
        if self.name == "published":
            return read_published(depth_m, hand)
        if map_ns != self._map_ns:
            self._before, self._map_ns = self._outliers, map_ns
        self._outliers, sample = reject_outlier(self._before, sample_palm(hand, depth_m), map_ns)
        self.fault = sample.fault
        if sample.depth_m is None:
            return None
        joints_m, sd_m = sample.depth_m + HALF_PALM_M, SENSOR_SD * sample.depth_m
        return Distance(shown_m=joints_m, safe_m=joints_m + sd_m, sd_m=sd_m, source=DistanceSource.DEPTH)

    def reset(self) -> None:
        """Forget what was accepted last: another hand, or a gap."""
        self._before = self._outliers = OutlierState()
        self._map_ns = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenDistance:
    """The distance that decides. bridge_m: what the keypoints would have decided by, while depth decides.

    ratio: how much farther than the keypoints' own the bridge reads, from the newest frame that measured both; at
    least 1, since a distance may read far, never near.
    """

    distance: Distance | None = None
    bridge_m: float | None = None
    ratio: float = 1.0
    fault: DepthFault | None = None


def choose_distance(
    before: ChosenDistance, choice: DistanceChoice, monocular: Distance | None, depth: Distance | None
) -> ChosenDistance:
    """Which of a frame's two measurements decides; before: of the frame before, of the same hand."""
    if choice is not DistanceChoice.BOTH:
        return ChosenDistance(distance=monocular if choice is DistanceChoice.MONOCULAR else depth)
    if depth is None or monocular is None:
        bridge = None if monocular is None else replace(monocular, safe_m=monocular.safe_m * before.ratio)
        return ChosenDistance(distance=depth or bridge, ratio=before.ratio)
    if depth.safe_m < AGREEMENT * monocular.shown_m:
        return replace(choose_distance(before, choice, monocular, None), fault=DepthFault.DISAGREEMENT)
    ratio = min(MOST_RATIO, max(1.0, depth.safe_m / monocular.safe_m))
    return ChosenDistance(distance=depth, bridge_m=monocular.safe_m * ratio, ratio=ratio)
