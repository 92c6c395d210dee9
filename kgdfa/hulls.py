"""The paper's two convex hulls of the palm (Fig. 2) and which fingertips lie outside of them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from kgdfa.hand import FloatArray, Keypoint

INNER_HULL = (0, 1, 2, 5, 9, 13, 17)
OUTER_HULL = (0, 1, 2, 3, 6, 10, 14, 18, 17)
TIPS = (Keypoint.THUMB_TIP, Keypoint.INDEX_TIP, Keypoint.MIDDLE_TIP, Keypoint.RING_TIP, Keypoint.PINKY_TIP)


_ROWS: dict[tuple[int, ...], NDArray[np.int64]] = {members: np.array(members) for members in (INNER_HULL, OUTER_HULL)}
_TIP_ROWS = np.array(TIPS)


def hull(points_px: FloatArray, members: tuple[int, ...]) -> FloatArray:
    """The convex hull of some keypoints: (21, 2) pixels and their numbers to (m, 2) corner points."""
    return np.asarray(_corners(points_px, members)[:, 0, :], dtype=np.float64)


def tip_depths(points_px: FloatArray, members: tuple[int, ...]) -> FloatArray:
    """How deep each fingertip lies in a hull, (5,) pixels from thumb to pinky: negative outside, 0 on the edge."""
    corners = _corners(points_px, members)
    return np.array([cv2.pointPolygonTest(corners, tip, True) for tip in points_px[_TIP_ROWS].tolist()])


def _corners(points_px: FloatArray, members: tuple[int, ...]) -> NDArray[np.float32]:
    """(m, 1, 2), as OpenCV has it."""
    corners: NDArray[np.float32] = cv2.convexHull(points_px[_ROWS[members]].astype(np.float32))
    return corners
