"""Hand to camera from keypoints: what a distance is, Eq. 4, and the rejection of outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Protocol

from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.frame_time import have_lasted

if TYPE_CHECKING:
    from kgdfa.hand import Hand

REFERENCE_RANGE_M = (0.03, 0.12)  # 5 to 17 of any hand, from a child's to the largest adult's, with room
MIN_REFERENCE_PX = 2.0  # a shorter segment is no measurement
CEILING_OF_EQUATION = 1.10  # the button reads at most so far beyond Eq. 4
HALF_PALM_M = 0.012  # an adult's palm is about 25 mm thick at the knuckles

# Distances that jump further than a hand can move are no measurements until they have stayed.
MAX_SPEED_M_S = 2.0  # of a hand along the view: the fastest reaching is about that
SLACK_M = 0.04
SLACK_SHARE = 0.10  # of the distance: keypoints scatter in proportion to it
# A push slows down before the lens: from one frame to the next the fastest, 0.3 s there and back from 36 cm, comes
# nearer by less than a third.
MOST_NEARER = 0.40
FORGET_JUMP_NS = 300_000_000
# One more than the gap that a press survives (button_state.GAP_FRAMES): a jump that stays ends the press before it is
# believed, and a hand that jumps near has not come from outside.
CONFIRM_FRAMES = 4


class DistanceSource(Enum):
    """What a distance was measured with."""

    MONOCULAR = "monocular"  # the keypoints
    DEPTH = "depth"  # a depth camera's map


class DistanceChoice(Enum):
    """Which distance commands in a session."""

    MONOCULAR = "monocular"
    DEPTH = "depth"
    BOTH = "both"  # depth where it measures; the keypoints bridge its holes


@dataclass(frozen=True, slots=True, kw_only=True)
class Distance:
    """One measurement, metres. `safe_m` may read far, never near: the button uses it; `shown_m` is the best guess."""

    shown_m: float
    safe_m: float
    sd_m: float
    tilt_rad: float = 0.0
    source: DistanceSource = DistanceSource.MONOCULAR


class RangeFinder(Protocol):
    """A named way to measure distance from a hand's keypoints: `published` or `robust`."""

    name: str

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:
        """The distance now, or None when this hand gives no measurement."""

    def reset(self) -> None:
        """Forget the past: another hand, or a gap."""


def check_range_finder(focal_px: float, reference_m: float) -> None:
    """Refuse what cannot be a camera or a palm. Raises KgdfaError naming the value and its range."""
    if not (math.isfinite(focal_px) and focal_px > 0):
        raise KgdfaError(KgdfaFault.FOCAL_LENGTH, focal_px=focal_px)
    low, high = REFERENCE_RANGE_M
    if not low <= reference_m <= high:
        raise KgdfaError(KgdfaFault.REFERENCE_LENGTH, reference_m=reference_m, low_m=low, high_m=high)


class PublishedRange:
    """The paper's Eq. 4 on the segment 5-17, frame by frame: D = f·H/h."""

    name = "published"

    def __init__(
        self,
        *,
        focal_px: float,
        reference_m: float,
        centre_px: tuple[float, float] | None = None,
        distortion: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """focal_px: focal length for the image's size; reference_m: length of 5-17. Raises KgdfaError.

        centre_px: the optical axis on the image, distortion: the lens's; Eq. 4 uses neither.
        """
        del centre_px, distortion
        check_range_finder(focal_px, reference_m)
        self._focal_reference = focal_px * reference_m

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:  # noqa: ARG002 - no memory, no time
        """D = f·H/h. The paper knows no safe distance and no uncertainty: both repeat D and 0."""
        if not hand.reference_px >= MIN_REFERENCE_PX:
            return None
        distance_m = self._focal_reference / hand.reference_px
        return Distance(shown_m=distance_m, safe_m=distance_m, sd_m=0.0)

    def reset(self) -> None:
        """Nothing to forget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlierState:
    """What was accepted last, and a candidate that differs too much to be believed at once."""

    last_m: float | None = None
    last_ns: int = 0
    candidate_m: float = 0.0
    candidate_ns: int = 0  # of its first frame
    count: int = 0


def accept_distance(state: OutlierState, distance_m: float, captured_ns: int) -> tuple[OutlierState, bool]:
    """Whether a moving hand can explain this distance, or it has stayed for CONFIRM_FRAMES."""
    accepted = OutlierState(last_m=distance_m, last_ns=captured_ns)
    elapsed_ns = captured_ns - state.last_ns
    if state.last_m is None or not 0 <= elapsed_ns <= FORGET_JUMP_NS:
        return accepted, True
    slack_m = max(SLACK_M, SLACK_SHARE * state.last_m)
    reach_m = slack_m + MAX_SPEED_M_S * elapsed_ns * 1e-9
    if max(-reach_m, -MOST_NEARER * state.last_m) <= distance_m - state.last_m <= reach_m:
        return accepted, True
    stays = state.count > 0 and abs(distance_m - state.candidate_m) <= slack_m
    count, since_ns = (state.count + 1, state.candidate_ns) if stays else (1, captured_ns)
    # Counted from what was believed, too: a press has then ended before the jump could release it.
    stayed = have_lasted(count - 1, CONFIRM_FRAMES - 1, captured_ns - since_ns)
    if stayed and have_lasted(count, CONFIRM_FRAMES, elapsed_ns):
        return accepted, True
    return replace(state, candidate_m=distance_m, candidate_ns=since_ns, count=count), False
