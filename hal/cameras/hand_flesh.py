"""Flesh on the bones: rounded cones between joints, whose smooth union is the hand's surface.

Radii are in millimetres for the reference palm of 82 mm and scale with it; finger breadths are near the adult
medians of ANSUR II (index finger about 19 mm at the PIP joint).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hal.cameras.hand_skeleton import FloatArray, HandShape

# (from, to, radius at from, radius at to), joints numbered as keypoints; 21 and up are the helpers below.
_FINGERS = (
    (5, 6, 11.2, 9.6), (6, 7, 9.4, 8.2), (7, 8, 8.2, 6.6),
    (9, 10, 11.2, 9.8), (10, 11, 9.6, 8.4), (11, 12, 8.4, 6.8),
    (13, 14, 10.8, 9.2), (14, 15, 9.0, 7.9), (15, 16, 7.9, 6.5),
    (17, 18, 9.8, 8.2), (18, 19, 8.0, 7.0), (19, 20, 7.0, 5.8),
)  # fmt: skip
_THUMB = ((1, 2, 15.0, 12.2), (2, 3, 11.6, 10.0), (3, 4, 10.2, 7.6))
_PALM = (
    (0, 5, 14.5, 12.0), (0, 9, 14.5, 12.4), (0, 13, 14.5, 12.0), (21, 17, 14.5, 11.2),
    (5, 9, 11.6, 11.8), (9, 13, 11.8, 11.4), (13, 17, 11.4, 10.4),
    (1, 22, 14.0, 10.0), (0, 1, 14.0, 13.0), (21, 23, 14.0, 12.5), (22, 2, 8.5, 9.5),
)  # fmt: skip
_FOREARM = ((0, 24, 23.0, 26.0), (21, 24, 16.0, 24.0), (24, 25, 26.0, 40.0))
CONES = (*_FINGERS, *_THUMB, *_PALM, *_FOREARM)
_FROM = np.array([cone[0] for cone in CONES])
_TO = np.array([cone[1] for cone in CONES])
_RADII_M = np.array([cone[2:] for cone in CONES]) / 1000
FIRST_FOREARM_CONE = len(_FINGERS) + len(_THUMB) + len(_PALM)
_FOREARM_M = (0.045, 0.30)  # along the forearm from the wrist: where it has become round, and where we end it


@dataclass(frozen=True, slots=True)
class Flesh:
    """n rounded cones. a, b: (n, 3) axis ends; radius_a, radius_b: (n,), metres."""

    a: FloatArray
    b: FloatArray
    radius_a: FloatArray
    radius_b: FloatArray


def flesh(joints: FloatArray, shape: HandShape) -> Flesh:
    """The cones around (21, 3) joints, in whichever frame the joints are."""
    points = np.vstack([joints, _helpers(joints, shape)])
    radii = _RADII_M * shape.scale
    return Flesh(points[_FROM], points[_TO], radii[:, 0], radii[:, 1])


def _helpers(joints: FloatArray, shape: HandShape) -> FloatArray:
    """21: the heel of the hand below the pinky; 22: the web of the thumb; 23: the outer palm; 24, 25: forearm."""
    wrist, middle, pinky = joints[0], joints[9], joints[17]
    across = joints[17] - joints[5]
    heel = wrist + 0.20 * across
    web = 0.42 * joints[2] + 0.30 * joints[5] + 0.28 * joints[1]
    outer = 0.55 * heel + 0.45 * pinky + 0.06 * across
    down = (wrist - middle) / np.linalg.norm(wrist - middle)
    near, far = (wrist + down * length * shape.scale for length in _FOREARM_M)
    return np.stack([heel, web, outer, near + 0.05 * across, far + 0.05 * across])
