"""Where a press can work before a camera: how near it still follows the hand, and the threshold that leaves room.

A hand that comes near outgrows the picture: first its fingertips leave it, then MediaPipe loses the palm. Both
limits follow from the focal length, the picture's size and the palm's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from kgdfa.button import HYSTERESIS
from kgdfa.distance import check_range_finder
from kgdfa.errors import KgdfaError
from kgdfa.hand import Hand
from kgdfa.preprocess import Image, as_bgr8
from kgdfa.robust_distance import UPRIGHT_FACTOR

PALM_OF_REFERENCE = 4 / 3  # the paper: the anchor is three quarters of the palm's width
HAND_OF_PALM = 2.4  # upright hand, wrist crease to middle fingertip, in palm widths (digital hand; ANSUR II: 2.2)
# A palm wider than this share of the picture's shorter side is not followed any more, whatever the gesture: in
# `rleex evaluate press-zone` the first gesture is lost there.
TRACKED_SHARE = 0.55
PUSH_ROOM_M = 0.03  # how far people overshoot the threshold when they push
LEAST_THRESHOLD_M = 0.20  # the paper's
MOST_THRESHOLD_M = 0.40  # beyond, a hand at rest would press
SMALLEST_REFERENCE_PX = 25.0  # MediaPipe's palm detector works on 192 px pictures: less than 4 px there


@dataclass(frozen=True, slots=True, kw_only=True)
class PressZone:
    """Where a press works for one camera and one palm.

    followed_from_m: nearer, the track is lost. whole_from_m: nearer, fingertips are out of the picture.
    seen_to_m: farther, the hand is too small. threshold_m: proposed; rest_beyond_m: where the hand rests with it.
    """

    followed_from_m: float
    whole_from_m: float
    seen_to_m: float
    threshold_m: float
    rest_beyond_m: float

    @property
    def possible(self) -> bool:
        """Whether a press can work at all."""
        return self.threshold_m <= MOST_THRESHOLD_M

    def fits(self, threshold_m: float) -> bool:
        """Whether a threshold leaves room to push without losing the hand, and lets it rest without pressing."""
        return _least_threshold(self.followed_from_m) <= threshold_m <= MOST_THRESHOLD_M

    @property
    def sentence(self) -> str:
        """For people."""
        if not self.possible:
            return (
                f"This camera loses the hand nearer than {_cm(self.followed_from_m)}: too far for a press; "
                "use a wider lens or a higher resolution."
            )
        return (
            f"This camera follows the hand from {_cm(self.followed_from_m)} and sees it whole from "
            f"{_cm(self.whole_from_m)}; proposed threshold {_cm(self.threshold_m)}, "
            f"with the hand resting beyond {_cm(self.rest_beyond_m)}."
        )


def press_zone(*, focal_px: float, width_px: int, height_px: int, reference_m: float) -> PressZone:
    """The zone for a camera and a palm anchor. Raises KgdfaError for what is no camera or no palm."""
    check_range_finder(focal_px, reference_m)
    if min(width_px, height_px) <= 0:
        raise KgdfaError(f"A picture of {width_px}×{height_px} px: both must be above 0; mend the camera's settings.")
    palm_m, side_px = PALM_OF_REFERENCE * reference_m, min(width_px, height_px)
    followed_m = focal_px * palm_m / (TRACKED_SHARE * side_px)
    threshold_m = math.ceil(max(LEAST_THRESHOLD_M, _least_threshold(followed_m)) * 100 - 1e-9) / 100
    return PressZone(
        followed_from_m=followed_m,
        whole_from_m=focal_px * HAND_OF_PALM * palm_m / height_px,
        seen_to_m=focal_px * reference_m / SMALLEST_REFERENCE_PX,
        threshold_m=threshold_m,
        rest_beyond_m=threshold_m * (1 + HYSTERESIS),
    )


def cut_off(hand: Hand, width_px: int, height_px: int) -> bool:
    """Whether part of the hand is out of the picture, so that its gesture can't be judged (its palm may be)."""
    inside = (hand.image_px >= 0) & (hand.image_px < (width_px, height_px))
    return not bool(inside.all())


class _Detector(Protocol):
    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]: ...


class SquaredDetector:
    """A detector that is shown the picture with bars that make it square, so that a hand outgrowing it keeps its place.

    MediaPipe's palm detector works on a square all the same, so the bars take nothing from its resolution.
    The keypoints come back in the picture's own coordinates and may lie outside of it.
    """

    def __init__(self, detector: _Detector) -> None:
        self._detector = detector

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        """The hands in one picture, the tracked one first; () when there is none."""
        image = as_bgr8(image_bgr)
        height, width = image.shape[:2]
        side = max(height, width)
        down, across = (side - height) // 2, (side - width) // 2
        squared = cv2.copyMakeBorder(
            image, down, side - height - down, across, side - width - across, cv2.BORDER_CONSTANT
        )
        hands = self._detector.detect(np.asarray(squared, np.uint8), captured_ns)
        return tuple(replace(hand, image_px=hand.image_px - (across, down)) for hand in hands)


def _least_threshold(followed_from_m: float) -> float:
    """The button's distance reads far by up to UPRIGHT_FACTOR: a push must reach that much nearer."""
    return UPRIGHT_FACTOR * (followed_from_m + PUSH_ROOM_M)


def _cm(length_m: float) -> str:
    return f"{length_m * 100:.0f} cm"
