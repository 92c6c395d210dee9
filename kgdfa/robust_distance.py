"""Eq. 4 freed from the hand's tilt: a distance fused from three readings, and one that leans to the far side."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from kgdfa.distance import (
    CEILING_OF_EQUATION,
    HALF_PALM_M,
    MIN_REFERENCE_PX,
    Distance,
    OutlierState,
    accept_distance,
    check_range_finder,
)
from kgdfa.hand import Hand
from kgdfa.palm_shape import FORE, LITTLE, RIGID, PalmView, Points, centre_offset, view_palm

_RIGID_ROWS = np.array(RIGID)

MAX_MISFIT = 0.16  # keypoints further from any flat palm are none: 99.9 % of well-seen hands are below 0.15
# Seen nearly edge on, a palm is a line whose length depends on the guess where its keypoints are: of idle hands turning
# over the button, one in some 400,000 frames pressed by it. Signs reach 60 degrees.
MOST_TILT_RAD = math.radians(75)
KEYPOINT_SD = 0.03  # scatter that the keypoints' own places leave, digital hand facing the camera
REFERENCE_HOLDS_M = 0.40  # where hands are held when the reference segment is measured or calibrated
FORGET_NS = 200_000_000

# How three readings become one (shares of a logarithm). `tools/fit_distance.py` prints what each of them does on
# digital hands that no evaluation uses; docs/explanation/distance.md tells how they were chosen.
LANDMARKS_SHARE = 0.4  # of the world landmarks' word against the palm shape's, where it is the nearer one
LANDMARKS_HOLD = 0.18  # and by how much it may be nearer
WRIST_HOLD = 0.1  # how far Eq. 4 may be from the shape where the wrist is out of the image
YAW_SHORTENS = 0.12  # MediaPipe draws the wrist of a palm turned about its length too near to the knuckles

# The far side: what the button's distance adds for a palm that may be tilted, and for readings that disagree.
MARGIN_TILT = 0.22  # a radian
MARGIN_NEARER = 0.30  # of what the world landmarks say nearer than the shape
MARGIN_FARTHER = 0.20  # of what they say farther
MOST_DISAGREEMENT = 0.30
# A tilt only shortens 5-17 on the image, so Eq. 4 reads far or right, but for the scatter of its two keypoints.
# The button's distance therefore stays above it, and needs no more than a scatter beyond it.
FLOOR_OF_EQUATION = 1.03


def _readings(observed: Points, world_m: Points, view: PalmView) -> tuple[float, float, float]:
    """Distance of keypoint 21 in reference segments: by the palm's shape, by 5-17 in perspective, by Eq. 4.

    observed: (5, 2) as a camera looking at keypoint 21 sees them, world_m: (5, 3) as MediaPipe gives them.
    """
    by_shape = 1 / view.stretch + centre_offset(world_m)
    by_equation = 1 / math.dist(observed[FORE], observed[LITTLE])
    return by_shape, _by_perspective(observed, world_m), by_equation


def _by_perspective(observed: Points, world_m: Points) -> float:
    """Where 5 and 17, placed about keypoint 21 as in the world landmarks, are seen where they are.

    Each is at (X + x, Y + y, Z + z) and seen at u = (X + x)/(Z + z): linear in X, Y, Z, solved for Z.
    """
    reference = math.dist(world_m[FORE], world_m[LITTLE])
    if not reference > 0:
        return math.nan
    x, y, z = ((fore - little) / reference for fore, little in zip(world_m[FORE], world_m[LITTLE], strict=True))
    (u, v), (r, s) = observed[FORE], observed[LITTLE]
    wanted = (x - (u + r) * z / 2, y - (v + s) * z / 2)
    return ((u - r) * wanted[0] + (v - s) * wanted[1]) / ((u - r) ** 2 + (v - s) ** 2)


def _turned_to(x: float, y: float, rays: Points) -> tuple[list[tuple[float, float]], float]:
    """(x, y), and the other rays, as seen with (x, y) straight ahead (Rodrigues' rotation); the cosine of the turn."""
    length = math.hypot(x, y, 1.0)
    a, b, cosine = x / length, y / length, 1 / length
    turned = []
    for u, v in rays:
        beside = u * a + v * b
        turn, ahead = 1 + beside / (1 + cosine), cosine + beside
        turned.append(((u - a * turn) / ahead, (v - b * turn) / ahead))
    return turned, cosine


def _scatter(values: Sequence[float]) -> float:
    """Their standard deviation; the standard library's own is exact, at twenty times the cost."""
    mean = sum(values) / len(values)
    return math.sqrt(sum((value - mean) * (value - mean) for value in values) / len(values))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One frame's readings made one, metres: the best guess, and one that leans to the far side.

    readings_m: by the palm's shape, by the world landmarks in perspective, by Eq. 4.
    """

    readings_m: tuple[float, float, float]
    tilt_rad: float
    shown_m: float
    far_m: float


def _fuse(view: PalmView, readings_m: tuple[float, float, float], observed_wrist: bool) -> Reading:
    """Readings by shape, by perspective, by Eq. 4.

    The landmarks miss tilts and then read far, so only their nearer word counts; the shape needs the wrist.
    """
    shape_m, perspective_m, equation_m = readings_m
    landmarks = math.log(perspective_m / shape_m) if perspective_m > 0 else 0.0
    moved = LANDMARKS_SHARE * min(0.0, max(-LANDMARKS_HOLD, landmarks))
    moved -= YAW_SHORTENS * view.along * (1 - math.cos(view.tilt_rad))
    if not observed_wrist:
        moved = min(WRIST_HOLD, max(-WRIST_HOLD, math.log(equation_m / shape_m))) / 2
    shown_m = shape_m * math.exp(moved)
    nearer, farther = (min(MOST_DISAGREEMENT, max(0.0, one)) for one in (-landmarks, landmarks))
    margin = MARGIN_TILT * view.tilt_rad + MARGIN_NEARER * nearer + MARGIN_FARTHER * farther
    far_m = max(FLOOR_OF_EQUATION * equation_m, min(CEILING_OF_EQUATION * equation_m, shown_m * math.exp(margin)))
    return Reading(readings_m=readings_m, tilt_rad=view.tilt_rad, shown_m=shown_m, far_m=far_m)


def _under_the_skin(observed_m: float) -> float:
    """The joints' distance from that of the skin, on which MediaPipe sees them.

    The skin is nearer by half the palm's thickness, which magnifies near hands more than far ones. The reference
    segment takes up the share of it at REFERENCE_HOLDS_M; the rest is added nearer than that, taken off farther away.
    """
    return observed_m + HALF_PALM_M * (1 - observed_m / REFERENCE_HOLDS_M)


def _accept_far(state: OutlierState, far_m: float, captured_ns: int) -> tuple[OutlierState, bool]:
    """Whether a hand can have withdrawn so far; nearer ones are the button's to doubt."""
    if state.last_m is not None and far_m <= state.last_m:
        return OutlierState(last_m=far_m, last_ns=captured_ns), True
    return accept_distance(state, far_m, captured_ns)


class RobustRange:
    """Eq. 4 freed from the hand's tilt, steadied over three frames, with a distance that is safe to press by.

    Three readings: the palm's shape (`palm_shape`), 5-17 placed in perspective by the world landmarks, and Eq. 4.
    The shape sees every tilt; the landmarks miss some (40° of yaw to one side on the digital hand) and then read a
    quarter too far. Shown is the shape's, drawn nearer by the landmarks; safe adds a margin that grows with the
    tilt and with what the readings disagree by, and is held between 3 and 10 % beyond Eq. 4.
    """

    name = "robust"

    def __init__(
        self,
        *,
        focal_px: float,
        reference_m: float,
        centre_px: tuple[float, float] | None = None,
        distortion: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """focal_px: focal length for the image's size; reference_m: length of 5-17. Raises KgdfaError.

        centre_px: the optical axis on the image; with it, a hand off the axis is measured along its own ray, and
        a lens's radial distortion (OpenCV's k1, k2) is taken out.
        """
        check_range_finder(focal_px, reference_m)
        self._focal_px = focal_px
        self._reference_m = reference_m
        self._centre_px = centre_px
        self._distortion = np.array([*distortion, 0.0, 0.0]) if any(distortion) else None
        self._recent: tuple[Reading, ...] = ()
        self._outliers = self._far = OutlierState()
        self._last_ns = 0

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:
        """Tilt-corrected and steadied; None for keypoints that are no palm, or that jump as no hand can."""
        now = self.explain(hand)
        if now is None:
            return None
        self._outliers, believed = accept_distance(self._outliers, now.shown_m, captured_ns)
        self._far, far_believed = _accept_far(self._far, now.far_m, captured_ns)
        if not (believed and far_believed):
            return None
        if not 0 <= captured_ns - self._last_ns <= FORGET_NS:
            self._recent = ()
        self._recent, self._last_ns = (*self._recent[-2:], now), captured_ns
        return self._distance(now)

    def explain(self, hand: Hand) -> Reading | None:
        """The reading of this frame alone, without the past; None for keypoints that are no palm."""
        if not (MIN_REFERENCE_PX <= hand.reference_px < math.inf and np.isfinite(hand.world_m).all()):
            return None
        points_px = hand.image_px.take(_RIGID_ROWS, axis=0).tolist()
        observed, cosine = self._own_view(points_px)
        view = view_palm(observed)
        if not (view.misfit <= MAX_MISFIT and view.tilt_rad <= MOST_TILT_RAD):
            return None
        readings = _readings(observed, hand.world_m.take(_RIGID_ROWS, axis=0).tolist(), view)
        shape_m, perspective_m, equation_m = (_under_the_skin(self._reference_m * cosine * one) for one in readings)
        return _fuse(view, (shape_m, perspective_m, equation_m), self._shows(points_px[0]))

    def reset(self) -> None:
        """Forget the last frames."""
        self._recent = ()
        self._outliers = self._far = OutlierState()

    def _own_view(self, points_px: Points) -> tuple[Points, float]:
        """(5, 2) keypoints as a camera looking straight at keypoint 21 sees them, one focal length away.

        The world landmarks are seen so, too. And the cosine from that view's distance to one along the camera's axis.
        """
        focal_px = self._focal_px
        (x, y), (u, v) = points_px[FORE], points_px[LITTLE]
        left_px, top_px = self._centre_px or ((x + u) / 2, (y + v) / 2)
        flat: Points = [((x - left_px) / focal_px, (y - top_px) / focal_px) for x, y in points_px]
        if self._centre_px is None:
            return flat, 1.0
        if self._distortion is not None:
            undistorted = cv2.undistortPoints(np.array([flat]), np.eye(3), self._distortion)
            flat = np.asarray(undistorted, np.float64).reshape(-1, 2).tolist()
        (x, y), (u, v) = flat[FORE], flat[LITTLE]
        return _turned_to((x + u) / 2, (y + v) / 2, flat)

    def _shows(self, point_px: Sequence[float]) -> bool:
        """Whether the image, whose middle is about the optical axis, shows the point."""
        if self._centre_px is None:
            return True
        (x, y), (middle_x, middle_y) = point_px, self._centre_px
        return 0 <= x <= 2 * middle_x and 0 <= y <= 2 * middle_y

    def _distance(self, now: Reading) -> Distance:
        shown_m = statistics.median(one.shown_m for one in self._recent)
        far_m = statistics.median(one.far_m for one in self._recent)
        scatter_m = _scatter([one.shown_m for one in self._recent])
        return Distance(
            shown_m=shown_m,
            # An outlier that is near is outvoted by the frames before it; a withdrawing hand is followed at once.
            safe_m=max(now.far_m, far_m),
            sd_m=math.hypot(KEYPOINT_SD * shown_m, _scatter(now.readings_m), scatter_m),
            tilt_rad=now.tilt_rad,
        )
