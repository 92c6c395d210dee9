"""How far each finger is bent (Eq. 1) and how far fingertips are apart."""

from __future__ import annotations

import numpy as np

from kgdfa.gesture import Finger
from kgdfa.hand import FloatArray, Keypoint

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
