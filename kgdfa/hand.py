"""The hand as the detector reports it: 21 keypoints in two frames of reference, and the virtual 22nd."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from kgdfa.gesture import Finger

FloatArray = NDArray[np.float64]
SAME_HAND_REFERENCES = 2.0  # a hand this many reference segments from where one was is the same, tracked


class Keypoint(IntEnum):
    """MediaPipe's numbering of the 21 hand keypoints, and the paper's virtual one (Fig. 2)."""

    WRIST = 0
    THUMB_CMC = 1
    THUMB_MCP = 2
    THUMB_IP = 3
    THUMB_TIP = 4
    INDEX_MCP = 5
    INDEX_PIP = 6
    INDEX_DIP = 7
    INDEX_TIP = 8
    MIDDLE_MCP = 9
    MIDDLE_PIP = 10
    MIDDLE_DIP = 11
    MIDDLE_TIP = 12
    RING_MCP = 13
    RING_PIP = 14
    RING_DIP = 15
    RING_TIP = 16
    PINKY_MCP = 17
    PINKY_PIP = 18
    PINKY_DIP = 19
    PINKY_TIP = 20
    PALM_CENTRE = 21  # virtual: midpoint of 5 and 17


class Side(Enum):
    """Which of the wearer's hands."""

    LEFT = "left"
    RIGHT = "right"

    @property
    def other(self) -> Side:
        """The one on the other side."""
        return Side.RIGHT if self is Side.LEFT else Side.LEFT


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """An axis-aligned rectangle on the image, pixels."""

    left_px: float
    top_px: float
    right_px: float
    bottom_px: float


_PALM = np.array([Keypoint.WRIST, Keypoint.INDEX_MCP, Keypoint.MIDDLE_MCP, Keypoint.PINKY_MCP])


@dataclass(frozen=True, kw_only=True)
class Hand:
    """One detected hand; what follows from its keypoints is computed once (arrays are never changed in place).

    image_px: (21, 2) keypoints on the image, pixels, may lie outside of it.
    world_m: (21, 3) keypoints in metres about the hand's geometric centre, x right, y down,
        z away from the camera (MediaPipe's hand world landmarks).
    presence: the detector's confidence in the side, in [0, 1]; it gives no other.
    side: as the detector guesses it for an unmirrored image; it flips now and then (see `track`).
    tracked: found from the previous frame (True) or by the palm detector anew (False).
    """

    image_px: FloatArray
    world_m: FloatArray
    presence: float
    side: Side
    tracked: bool = False

    @cached_property
    def _palm_ends_px(self) -> tuple[float, float, float, float]:
        """Keypoints 5 and 17 as plain numbers: of so few, NumPy's own arithmetic takes longer to start than to do."""
        x, y = self.image_px[Keypoint.INDEX_MCP].tolist()
        u, v = self.image_px[Keypoint.PINKY_MCP].tolist()
        return x, y, u, v

    @cached_property
    def palm_centre_px(self) -> FloatArray:
        """Keypoint 21, (2,): the midpoint of 5 and 17."""
        centre: FloatArray = (self.image_px[Keypoint.INDEX_MCP] + self.image_px[Keypoint.PINKY_MCP]) / 2
        return centre

    @cached_property
    def reference_px(self) -> float:
        """Length of the reference segment, keypoints 5 to 17, pixels."""
        x, y, u, v = self._palm_ends_px
        return math.hypot(x - u, y - v)

    @cached_property
    def palm_px(self) -> float:
        """The longest of the palm's sides, at least 1: one is seen at full length however the palm is turned."""
        wrist, fore, middle, little = self.image_px.take(_PALM, axis=0).tolist()
        return max(1.0, math.dist(fore, little), *(math.dist(wrist, knuckle) for knuckle in (fore, middle, little)))

    def palm_shift_px(self, other: Hand) -> float:
        """How far keypoint 21 is from where the other hand has it."""
        (x, y, u, v), (a, b, c, d) = self._palm_ends_px, other._palm_ends_px
        return math.hypot((x + u) / 2 - (a + c) / 2, (y + v) / 2 - (b + d) / 2)

    @cached_property
    def bounding_box(self) -> Box:
        """The rectangle around all 22 points (the virtual one never widens it)."""
        left_px, top_px = np.minimum.reduce(self.image_px).tolist()
        right_px, bottom_px = np.maximum.reduce(self.image_px).tolist()
        return Box(left_px=left_px, top_px=top_px, right_px=right_px, bottom_px=bottom_px)


def same_place(hand: Hand, other: Hand) -> bool:
    """Whether two detections may be of the same hand."""
    reach_px = SAME_HAND_REFERENCES * max(hand.reference_px, other.reference_px)
    return hand.palm_shift_px(other) < reach_px


def is_cut_off(hand: Hand, width_px: int, height_px: int) -> bool:
    """Whether part of the hand is out of the image, so that its gesture can't be classified (its palm may be)."""
    box = hand.bounding_box
    return not (box.left_px >= 0 and box.top_px >= 0 and box.right_px < width_px and box.bottom_px < height_px)


# Vertex and the two ends of its arms. Fingers: at the PIP joint, to MCP and to the tip. Thumb: at keypoint 2,
# to its tip and along the added link 2-5. The text leaves Fig. 2(c) open; this reading fits its thresholds.
ANGLE_POINTS: dict[Finger, tuple[Keypoint, Keypoint, Keypoint]] = {
    Finger.THUMB: (Keypoint.THUMB_MCP, Keypoint.THUMB_TIP, Keypoint.INDEX_MCP),
    Finger.FORE: (Keypoint.INDEX_PIP, Keypoint.INDEX_MCP, Keypoint.INDEX_TIP),
    Finger.MIDDLE: (Keypoint.MIDDLE_PIP, Keypoint.MIDDLE_MCP, Keypoint.MIDDLE_TIP),
    Finger.RING: (Keypoint.RING_PIP, Keypoint.RING_MCP, Keypoint.RING_TIP),
    Finger.PINKY: (Keypoint.PINKY_PIP, Keypoint.PINKY_MCP, Keypoint.PINKY_TIP),
}
_VERTEX, _FIRST, _SECOND = (list(column) for column in zip(*ANGLE_POINTS.values(), strict=True))


def finger_angles_deg(points: FloatArray) -> FloatArray:
    """Eq. 1 for each finger: (21, 2) or (21, 3) points to (5,) degrees in [0, 180]; 180 is straight.

    An arm of zero length gives 0: a finger seen end on counts as bent.
    """
    return angles_deg(points[_FIRST] - points[_VERTEX], points[_SECOND] - points[_VERTEX])


def angles_deg(first: FloatArray, second: FloatArray) -> FloatArray:
    """The angle between rows: (n, d) and (n, d) to (n,) degrees; 0 where a row has no length."""
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    dots = np.sum(first * second, axis=-1)
    cosines = np.divide(dots, lengths, out=np.ones_like(dots), where=lengths > 0)
    angles: FloatArray = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    return angles


def apart(points: FloatArray, first: Keypoint, second: Keypoint) -> float:
    """P(first, second): the distance between two keypoints, in the points' unit (Eq. 2)."""
    return float(np.linalg.norm(points[first] - points[second]))


INNER_HULL = (0, 1, 2, 5, 9, 13, 17)
OUTER_HULL = (0, 1, 2, 3, 6, 10, 14, 18, 17)
TIPS = (Keypoint.THUMB_TIP, Keypoint.INDEX_TIP, Keypoint.MIDDLE_TIP, Keypoint.RING_TIP, Keypoint.PINKY_TIP)


_ROWS: dict[tuple[int, ...], NDArray[np.int64]] = {members: np.array(members) for members in (INNER_HULL, OUTER_HULL)}
_TIP_ROWS = np.array(TIPS)


def hull(points_px: FloatArray, members: tuple[int, ...]) -> FloatArray:
    """The convex hull of some keypoints: (21, 2) pixels and their numbers to (m, 2) corner points."""
    return np.asarray(_corners(points_px.astype(np.float32), members)[:, 0, :], dtype=np.float64)


def tip_depths(points_px: FloatArray, *hulls: tuple[int, ...]) -> FloatArray:
    """How deep each fingertip lies in each hull: (hulls, 5) pixels, thumb to pinky, negative outside, 0 on the edge."""
    points, tips = points_px.astype(np.float32), points_px.take(_TIP_ROWS, axis=0).tolist()
    corners = [_corners(points, members) for members in hulls]
    return np.array([[cv2.pointPolygonTest(polygon, tip, True) for tip in tips] for polygon in corners])


def _corners(points: NDArray[np.float32], members: tuple[int, ...]) -> NDArray[np.float32]:
    """(m, 1, 2), as OpenCV has it."""
    return np.asarray(cv2.convexHull(points.take(_ROWS[members], axis=0)), np.float32)
