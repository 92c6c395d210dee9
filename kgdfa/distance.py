"""Hand to camera: from the palm anchor's length in pixels (Eq. 4), and, if there, from the depth map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from kgdfa.errors import KgdfaError
from kgdfa.hand import FloatArray, Hand, Keypoint
from kgdfa.jumps import JumpGuard, accept
from kgdfa.palm_shape import PalmView, centre_offset, view_palm

ANCHOR_RANGE_M = (0.03, 0.12)  # 5 to 17 of any hand, from a child's to the largest adult's, with room
MIN_ANCHOR_PX = 2.0  # a shorter segment is no measurement
HOLD = 1.2  # the other readings may differ from the palm shape's by this factor
HOLD_FAR = 1.1  # and those that are shown may be farther by this one: there the landmarks missed a tilt
MAX_MISFIT = 0.16  # keypoints further from any flat palm are none: 99.9 % of well-seen hands are below 0.15
KEYPOINT_SD = 0.03  # scatter that the keypoints' own places leave, digital hand facing the camera
HALF_PALM_M = 0.012  # an adult's palm is about 25 mm thick at the knuckles
ANCHOR_HOLDS_M = 0.40  # where hands are held when anchors are measured or calibrated
FORGET_NS = 200_000_000
# The far side: so large that in random walks of 80 digital hands before a 650 px lens half a per cent of frames read
# nearer than 97 % of the truth; 60 other hands before a 950 px lens gave 0.4 %. `rleex evaluate distance` measures it
# on hands that served neither.
SAFE_FACTOR = 1.15


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

    def __init__(self, *, focal_px: float, anchor_m: float, centre_px: tuple[float, float] | None = None) -> None:
        """focal_px: focal length for the picture's size; anchor_m: length of 5-17. Raises KgdfaError.

        centre_px: the optical axis on the picture; Eq. 4 does not use it.
        """
        del centre_px
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


@dataclass(frozen=True, slots=True)
class _Fused:
    """One frame's readings made one: the best guess, and one that leans to the far side."""

    shown_m: float
    far_m: float

    @classmethod
    def of(cls, readings_m: tuple[float, ...]) -> _Fused:
        """Readings by shape, by perspective, by Eq. 4."""
        shape_m, perspective_m, _ = readings_m
        held_m = min(max(perspective_m, shape_m / HOLD), shape_m * HOLD_FAR)
        middle_m = sorted(readings_m)[1]
        return cls(math.sqrt(shape_m * held_m), min(max(middle_m, shape_m / HOLD), shape_m * HOLD))


def _under_the_skin(seen_m: float) -> float:
    """The joints' distance from that of the skin, on which MediaPipe sees them.

    The skin is nearer by half the palm's thickness, which magnifies near hands more than far ones. The anchor takes
    up the share of it at ANCHOR_HOLDS_M; what is left is added nearer than that, and taken off farther away.
    """
    return seen_m + HALF_PALM_M * (1 - seen_m / ANCHOR_HOLDS_M)


class RobustRange:
    """Eq. 4 freed from the hand's tilt, steadied over three frames, with a distance that is safe to press by.

    Three readings: the palm's shape (`palm_shape`), 5-17 placed in perspective by the world landmarks, and Eq. 4.
    The landmarks miss some tilts altogether (40° of yaw to one side on the digital hand) and then read a quarter
    too far; the shape sees every tilt, but scatters more. So shown is the mean of both, the landmarks' held near
    the shape's; safe is the median of all three, held likewise, times a factor to the far side.
    """

    name = "robust"

    def __init__(self, *, focal_px: float, anchor_m: float, centre_px: tuple[float, float] | None = None) -> None:
        """focal_px: focal length for the picture's size; anchor_m: length of 5-17. Raises KgdfaError.

        centre_px: the optical axis on the picture; with it, a hand off the axis is measured along its own ray.
        """
        check_range_finder(focal_px, anchor_m)
        self._focal_px = focal_px
        self._anchor_m = anchor_m
        self._centre_px = None if centre_px is None else np.asarray(centre_px, dtype=np.float64)
        self._recent: tuple[_Fused, ...] = ()
        self._guard = JumpGuard()
        self._last_ns = 0

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:
        """Tilt-corrected and steadied; None for keypoints that are no palm, or that jump as no hand can."""
        if not (hand.anchor_px >= MIN_ANCHOR_PX and np.isfinite(hand.world_m).all()):
            return None
        view = view_palm(hand.image_px / self._focal_px)
        if view.misfit > MAX_MISFIT:
            return None
        readings_m = self._readings_m(hand, view)
        now = _Fused.of(tuple(map(_under_the_skin, readings_m)))
        self._guard, believed = accept(self._guard, now.far_m, captured_ns)
        if not believed:
            return None
        if not 0 <= captured_ns - self._last_ns <= FORGET_NS:
            self._recent = ()
        self._recent, self._last_ns = (*self._recent[-2:], now), captured_ns
        return self._distance(now, float(np.std(readings_m)), view.tilt_rad)

    def reset(self) -> None:
        """Forget the last frames."""
        self._recent = ()
        self._guard = JumpGuard()

    def _readings_m(self, hand: Hand, view: PalmView) -> tuple[float, float, float]:
        """By the palm's shape, by 5-17 in perspective, by Eq. 4."""
        world = hand.world_m if self._centre_px is None else hand.world_m @ self._ray_rotation(hand).T
        by_shape_m = self._anchor_m * (1 / view.stretch + centre_offset(world))
        by_equation_m = self._focal_px * self._anchor_m / hand.anchor_px
        return by_shape_m, self._by_perspective_m(hand, world), by_equation_m

    def _by_perspective_m(self, hand: Hand, world: FloatArray) -> float:
        """Depth of keypoint 21 when 5 and 17, placed about it as in the world landmarks, are seen where they are.

        Each is at (X + x, Y + y, Z + z) and seen at u = (X + x)/(Z + z): linear in X, Y, Z, solved for Z.
        """
        across = world[Keypoint.INDEX_MCP] - world[Keypoint.PINKY_MCP]
        half = across * (self._anchor_m / float(np.linalg.norm(across)) / 2)
        centre = 0.0 if self._centre_px is None else self._centre_px
        fore, little = (
            (hand.image_px[keypoint] - centre) / self._focal_px for keypoint in (Keypoint.INDEX_MCP, Keypoint.PINKY_MCP)
        )
        apart = fore - little
        wanted = 2 * half[:2] - (fore + little) * half[2]
        return float(apart @ wanted / (apart @ apart))

    def _ray_rotation(self, hand: Hand) -> FloatArray:
        """(3, 3): the world landmarks see the hand along its own ray; from there to the camera's axes."""
        assert self._centre_px is not None
        x, y = (hand.palm_centre_px - self._centre_px) / self._focal_px
        forward = np.array([x, y, 1.0]) / math.sqrt(x * x + y * y + 1)
        # Rodrigues' formula for the turn that brings the axis onto the ray.
        turn = np.array([[0.0, 0.0, forward[0]], [0.0, 0.0, forward[1]], [-forward[0], -forward[1], 0.0]])
        rotation: FloatArray = np.eye(3) + turn + turn @ turn / (1 + forward[2])
        return rotation

    def _distance(self, now: _Fused, disagreement_m: float, tilt_rad: float) -> Distance:
        shown_m = float(np.median([one.shown_m for one in self._recent]))
        far_m = float(np.median([one.far_m for one in self._recent]))
        spread_m = float(np.std([one.shown_m for one in self._recent]))
        return Distance(
            shown_m=shown_m,
            # An outlier that is near is outvoted by the frames before it; a withdrawing hand is followed at once.
            safe_m=SAFE_FACTOR * max(now.far_m, far_m),
            sd_m=math.hypot(KEYPOINT_SD * shown_m, disagreement_m, spread_m),
            tilt_rad=tilt_rad,
        )
