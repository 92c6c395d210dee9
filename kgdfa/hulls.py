"""The paper's two convex hulls of the palm (Fig. 2) and which fingertips lie outside of them."""

from __future__ import annotations

import cv2
import numpy as np

from kgdfa.hand import FloatArray, Keypoint

INNER_HULL = (0, 1, 2, 5, 9, 13, 17)
OUTER_HULL = (0, 1, 2, 3, 6, 10, 14, 18, 17)
TIPS = (Keypoint.THUMB_TIP, Keypoint.INDEX_TIP, Keypoint.MIDDLE_TIP, Keypoint.RING_TIP, Keypoint.PINKY_TIP)


def hull(points_px: FloatArray, members: tuple[int, ...]) -> FloatArray:
    """The convex hull of some keypoints: (21, 2) pixels and their numbers to (m, 2) corner points."""
    corners = cv2.convexHull(points_px[list(members)].astype(np.float32))
    return np.asarray(corners[:, 0, :], dtype=np.float64)


def tip_depths(points_px: FloatArray, members: tuple[int, ...]) -> FloatArray:
    """How deep each fingertip lies in a hull, (5,) pixels from thumb to pinky: negative outside, 0 on the edge."""
    corners = hull(points_px, members).astype(np.float32)
    depths = [cv2.pointPolygonTest(corners, tuple(map(float, points_px[tip])), True) for tip in TIPS]
    return np.array(depths, dtype=np.float64)
