"""Where a press can work before a camera: how near it still tracks the hand, and the threshold that leaves room.

A hand that comes near outgrows the image: first its fingertips leave it, then MediaPipe loses the palm. Both
limits follow from the focal length, the image's size and the palm's. Imports no arrays: the zone crosses processes.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from enum import Enum

from kgdfa.button_state import HYSTERESIS
from kgdfa.distance import CEILING_OF_EQUATION, check_range_finder
from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.gesture import Explanation

HAND_OF_PALM = 2.4  # upright hand, wrist crease to middle fingertip, in palm widths (digital hand; ANSUR II: 2.2)
# A palm wider than this share of the image's shorter side is not tracked any more, whatever the gesture: in
# `rleex evaluate press-zone` the first gesture is lost there.
TRACKED_SHARE = 0.55
PUSH_ROOM_M = 0.03  # how far people overshoot the threshold when they push
LEAST_THRESHOLD_M = 0.20  # the paper's
MOST_THRESHOLD_M = 0.40  # beyond, a hand at rest would press
SMALLEST_REFERENCE_PX = 25.0  # MediaPipe's palm detector works on 192 px images: less than 4 px there


class ZoneAssessment(Enum):
    """What a press zone means for the therapist. Values: the zone's fields."""

    USABLE = "usable"
    TOO_FAR = "too far"  # the hand is lost so far off that no press can work


@dataclass(frozen=True, slots=True, kw_only=True)
class PressZone:
    """Where a press works for one camera and one palm, metres from the camera.

    followed_from_m: nearer, the track is lost. whole_from_m: nearer, fingertips are out of the image.
    visible_to_m: farther, the hand is too small. threshold_m: proposed; rest_beyond_m: where the hand rests with it.
    """

    followed_from_m: float
    whole_from_m: float
    visible_to_m: float
    threshold_m: float
    rest_beyond_m: float

    @property
    def possible(self) -> bool:
        """Whether a press can work at all."""
        return self.threshold_m <= MOST_THRESHOLD_M

    def fits(self, threshold_m: float) -> bool:
        """Whether a threshold leaves room to push without losing the hand, and lets it rest without pressing."""
        return _least_threshold(self.followed_from_m) <= threshold_m <= MOST_THRESHOLD_M

    def explain(self) -> Explanation:
        """The zone with its assessment."""
        return Explanation(ZoneAssessment.USABLE if self.possible else ZoneAssessment.TOO_FAR, asdict(self))


def press_zone(
    *,
    focal_px: float,
    width_px: int,
    height_px: int,
    reference_m: float,
    palm_width_m: float,
    least_m: float = 0.0,
    arm_rad: float | None = 0.0,
) -> PressZone:
    """The zone for a camera and a palm. least_m: nearer, the distance can't be measured.

    arm_rad: where on the image the arm comes from, 0 from below, pi/2 from a side; None: anywhere.

    Raises KgdfaError for what is no camera or no palm.
    """
    check_range_finder(focal_px, reference_m)
    if min(width_px, height_px) <= 0:
        raise KgdfaError(KgdfaFault.IMAGE_SIZE, width_px=width_px, height_px=height_px)
    shorter_px = min(width_px, height_px)
    along_px = shorter_px if arm_rad is None else width_px if abs(math.sin(arm_rad)) > 0.5 else height_px
    followed_m = max(least_m, focal_px * palm_width_m / (TRACKED_SHARE * shorter_px))
    threshold_m = math.ceil(max(LEAST_THRESHOLD_M, _least_threshold(followed_m)) * 100 - 1e-9) / 100
    return PressZone(
        followed_from_m=followed_m,
        whole_from_m=max(followed_m, focal_px * HAND_OF_PALM * palm_width_m / along_px),
        visible_to_m=focal_px * reference_m / SMALLEST_REFERENCE_PX,
        threshold_m=threshold_m,
        rest_beyond_m=threshold_m * (1 + HYSTERESIS),
    )


def _least_threshold(followed_from_m: float) -> float:
    """The button's distance reads far by up to CEILING_OF_EQUATION: a push must reach that much nearer."""
    return CEILING_OF_EQUATION * (followed_from_m + PUSH_ROOM_M)
