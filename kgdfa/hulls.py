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
    return np.asarray(_corners(points_px.astype(np.float32), members)[:, 0, :], dtype=np.float64)


def tip_depths(points_px: FloatArray, *hulls: tuple[int, ...]) -> FloatArray:
    """How deep each fingertip lies in each hull: (hulls, 5) pixels, thumb to pinky, negative outside, 0 on the edge."""
    points, tips = points_px.astype(np.float32), points_px.take(_TIP_ROWS, axis=0).tolist()
    corners = [_corners(points, members) for members in hulls]
    return np.array([[cv2.pointPolygonTest(polygon, tip, True) for tip in tips] for polygon in corners])


def _corners(points: NDArray[np.float32], members: tuple[int, ...]) -> NDArray[np.float32]:
    """(m, 1, 2), as OpenCV has it."""
    return np.asarray(cv2.convexHull(points.take(_ROWS[members], axis=0)), np.float32)
