"""The hand as the detector reports it: 21 keypoints in two frames of reference, and the virtual 22nd."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from kgdfa.gesture import Gesture as Gesture  # noqa: PLC0414 - exported again: everybody looks for it here

FloatArray = NDArray[np.float64]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """An axis-aligned rectangle on the picture, pixels."""

    left_px: float
    top_px: float
    right_px: float
    bottom_px: float

    def contains(self, x_px: float, y_px: float) -> bool:
        """Whether the point lies inside or on the edge."""
        return self.left_px <= x_px <= self.right_px and self.top_px <= y_px <= self.bottom_px


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """One detected hand.

    image_px: (21, 2) keypoints on the picture, pixels, may lie outside of it.
    world_m: (21, 3) keypoints in metres about the hand's geometric centre, x right, y down,
        z away from the camera (MediaPipe's hand world landmarks).
    presence: the detector's confidence that a hand is there, in [0, 1].
    side: as the detector guesses it for an unmirrored picture; it flips now and then.
    tracked: found from the previous frame (True) or by the palm detector anew (False).
    """

    image_px: FloatArray
    world_m: FloatArray
    presence: float
    side: Side
    tracked: bool = False

    @property
    def palm_centre_px(self) -> FloatArray:
        """Keypoint 21, (2,): the midpoint of 5 and 17."""
        centre: FloatArray = (self.image_px[Keypoint.INDEX_MCP] + self.image_px[Keypoint.PINKY_MCP]) / 2
        return centre

    @property
    def anchor_px(self) -> float:
        """Length of the palm anchor, the segment from 5 to 17, pixels."""
        return float(np.linalg.norm(self.image_px[Keypoint.INDEX_MCP] - self.image_px[Keypoint.PINKY_MCP]))

    @property
    def bounding_box(self) -> Box:
        """The rectangle around all 22 points (the virtual one never widens it)."""
        low, high = self.image_px.min(axis=0), self.image_px.max(axis=0)
        return Box(
            left_px=float(low[0]),
            top_px=float(low[1]),
            right_px=float(high[0]),
            bottom_px=float(high[1]),
        )
