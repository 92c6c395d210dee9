"""Hand to camera: from the palm anchor's length in pixels (Eq. 4), and, if there, from the depth map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from kgdfa.errors import KgdfaError
from kgdfa.hand import FloatArray, Hand, Keypoint

ANCHOR_RANGE_M = (0.03, 0.12)  # 5 to 17 of any hand, from a child's to the largest adult's, with room
MIN_ANCHOR_PX = 2.0  # a shorter segment is no measurement


class DistanceSource(Enum):
    """What a distance was measured with."""

    KEYPOINTS = "keypoints"
    DEPTH = "depth"
    KEYPOINTS_FOR_DEPTH = "keypoints, the depth camera having no measurement"


@dataclass(frozen=True, slots=True, kw_only=True)
class Distance:
    """One measurement, metres. `safe_m` may read far, never near: the button uses it; `shown_m` is the best guess."""

    shown_m: float
    safe_m: float
    sd_m: float
    tilt_rad: float = 0.0
    source: DistanceSource = DistanceSource.KEYPOINTS


class RangeFinder(Protocol):
    """A named way to measure distance from a hand's keypoints: `published` or `robust`."""

    name: str

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:
        """The distance now, or None when this hand gives no measurement."""
        ...

    def reset(self) -> None:
        """Forget the past: another hand, or a gap."""
        ...


def check_range_finder(focal_px: float, anchor_m: float) -> None:
    """Refuse what cannot be a camera or a palm. Raises KgdfaError naming the value and its range."""
    if not (math.isfinite(focal_px) and focal_px > 0):
        raise KgdfaError(f"Focal length {focal_px:g} px: it must be above 0; calibrate the camera or give its own.")
    low, high = ANCHOR_RANGE_M
    if not low <= anchor_m <= high:
        raise KgdfaError(
            f"Palm anchor {anchor_m * 100:.3g} cm: it must lie in {low * 100:g} to {high * 100:g} cm "
            "(three quarters of the palm's width); measure the palm again."
        )


class PublishedRange:
    """The paper's Eq. 4 on the segment 5-17, frame by frame: D = f·H/h."""

    name = "published"

    def __init__(self, *, focal_px: float, anchor_m: float) -> None:
        """focal_px: focal length for the picture's size; anchor_m: length of 5-17. Raises KgdfaError."""
        check_range_finder(focal_px, anchor_m)
        self._focal_anchor = focal_px * anchor_m

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:  # noqa: ARG002 - no memory, no time
        """D = f·H/h. The paper knows no safe distance and no uncertainty: both repeat D and 0."""
        if not hand.anchor_px >= MIN_ANCHOR_PX:
            return None
        distance_m = self._focal_anchor / hand.anchor_px
        return Distance(shown_m=distance_m, safe_m=distance_m, sd_m=0.0)

    def reset(self) -> None:
        """Nothing to forget."""


class RobustRange:
    """Eq. 4 corrected for the palm's tilt by the 3-D world landmarks, steadied over three frames."""

    name = "robust"

    def __init__(self, *, focal_px: float, anchor_m: float) -> None:
        """focal_px: focal length for the picture's size; anchor_m: length of 5-17. Raises KgdfaError."""
        check_range_finder(focal_px, anchor_m)
        self._focal_anchor = focal_px * anchor_m
        self._recent_m: list[float] = []

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:  # noqa: ARG002
        """Tilt-corrected and steadied; None where the segment is too short to measure."""
        cosine = _foreshortening(hand.world_m)
        if not (hand.anchor_px >= MIN_ANCHOR_PX and cosine > 0.2):
            return None
        self._recent_m = [*self._recent_m[-2:], self._focal_anchor * cosine / hand.anchor_px]
        steady_m = float(np.median(self._recent_m))
        spread_m = max(self._recent_m) - min(self._recent_m)
        return Distance(
            shown_m=steady_m,
            safe_m=steady_m * 1.03,
            sd_m=max(0.02 * steady_m, spread_m / 2),
            tilt_rad=math.acos(min(1.0, cosine)),
        )

    def reset(self) -> None:
        """Forget the last frames."""
        self._recent_m = []


def _foreshortening(world_m: FloatArray) -> float:
    """How much of 5-17 lies across the view, 0-1."""
    across = world_m[Keypoint.INDEX_MCP] - world_m[Keypoint.PINKY_MCP]
    length = float(np.linalg.norm(across))
    return float(np.hypot(across[0], across[1])) / length if length > 0 else 0.0
