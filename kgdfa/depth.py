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
from kgdfa.hand import Hand

DepthMap = NDArray[np.float32]

MAX_DEPTH_M = 10.0  # D435i data sheet: use range to about 10 m; 65.535 is its 16-bit saturation in millimetres
WINDOW_REFERENCES = 0.25  # side of the neighbourhood, in reference segments: on the palm at any tilt that counts
MIN_VALID = 0.5  # share of the neighbourhood that must have measured
MAX_SPREAD_M = 0.04  # between its quartiles: more is an edge, not a palm
LEAST_M = 0.25  # the paper: nearer, a D435i gives 0
# Where the keypoints see a hand this much farther than the map, the map has not seen the palm: an error of theirs of
# 25 % (a tilt that they miss) and a palm width wrong by 15 % are less than that together.
AGREEMENT = 0.6
MOST_RATIO = 1.25  # how much farther than the keypoints' own a bridged hole may read
SENSOR_SD = 0.01  # D435i: about 1 % of distance in the near field, well inside its 2 % specification


class DepthFault(Enum):
    """Why a neighbourhood of the depth map gives no distance."""

    NONE = "none"
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
    fault: DepthFault = DepthFault.NONE


# In the order in which a neighbourhood without enough measurements is named: what holds there most.
_INVALID: tuple[tuple[DepthFault, Callable[[DepthMap], NDArray[np.bool_]]], ...] = (
    (DepthFault.ZERO, lambda patch: patch == 0),
    (DepthFault.NOT_FINITE, lambda patch: ~np.isfinite(patch)),
    (DepthFault.NEGATIVE, lambda patch: patch < 0),
    (DepthFault.SATURATED, lambda patch: np.isfinite(patch) & (patch > MAX_DEPTH_M)),
)


def sample_palm(hand: Hand, depth_m: DepthMap) -> DepthSample:
    """The palm's depth: median of a small neighbourhood of keypoint 21, (h, w) float32 map, metres."""
    patch = _neighbourhood(hand, depth_m)
    if patch.size == 0:
        return DepthSample(depth_m=None, fault=DepthFault.OUTSIDE)
    valid = patch[np.isfinite(patch) & (patch > 0) & (patch <= MAX_DEPTH_M)]
    if len(valid) < MIN_VALID * patch.size:
        fault = max(_INVALID, key=lambda row: int(np.count_nonzero(row[1](patch))))[0]
        return DepthSample(depth_m=None, fault=fault)
    low, middle, high = np.percentile(valid, (25, 50, 75))
    if high - low > MAX_SPREAD_M:
        return DepthSample(depth_m=None, fault=DepthFault.EDGE)
    return DepthSample(depth_m=float(middle))


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
        self.fault = DepthFault.NONE
        self._outliers = OutlierState()

    def measure(self, depth_m: DepthMap, hand: Hand, captured_ns: int) -> Distance | None:
        """The palm's distance; None where the map has none.

        The map shows the skin; the joints, of which all distances speak, lie half a palm under it.
        """
        if self.name == "published":
            return read_published(depth_m, hand)
        self._outliers, sample = reject_outlier(self._outliers, sample_palm(hand, depth_m), captured_ns)
        self.fault = sample.fault
        if sample.depth_m is None:
            return None
        joints_m, sd_m = sample.depth_m + HALF_PALM_M, SENSOR_SD * sample.depth_m
        return Distance(shown_m=joints_m, safe_m=joints_m + sd_m, sd_m=sd_m, source=DistanceSource.DEPTH)

    def reset(self) -> None:
        """Forget what was accepted last: another hand, or a gap."""
        self._outliers = OutlierState()


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenDistance:
    """The distance that decides. bridge_m: what the keypoints would have decided by, while depth decides.

    ratio: how much farther than the keypoints' own the bridge reads, from the newest frame that measured both; at
    least 1, since a distance may read far, never near.
    """

    distance: Distance | None = None
    bridge_m: float | None = None
    ratio: float = 1.0
    fault: DepthFault = DepthFault.NONE


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


def _neighbourhood(hand: Hand, depth_m: DepthMap) -> DepthMap:
    """The square about keypoint 21 that lies on the map, flat; empty when the keypoint is off the map."""
    x, y = hand.palm_centre_px
    height, width = depth_m.shape
    if not (0 <= x < width and 0 <= y < height):
        return np.empty(0, np.float32)
    half = max(1, round(WINDOW_REFERENCES * hand.reference_px / 2))
    top, left = max(0, round(y) - half), max(0, round(x) - half)
    return depth_m[top : round(y) + half + 1, left : round(x) + half + 1].ravel()
