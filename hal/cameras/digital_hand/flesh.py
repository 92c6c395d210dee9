"""Flesh on the bones: rounded cones between joints, whose smooth union is the hand's surface.

Radii are in millimetres for the reference palm of 82 mm and scale with it; finger breadths are near the adult
medians of ANSUR II (index finger about 19 mm at the PIP joint).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.cameras.digital_hand.skeleton import FloatArray, HandShape

# (from, to, radius at from, radius at to), joints numbered as keypoints; 21 and up are the helpers below.
_FINGERS = (
    (5, 6, 11.4, 9.8), (6, 7, 9.7, 8.5), (7, 8, 8.5, 7.0),
    (9, 10, 11.4, 10.0), (10, 11, 9.9, 8.7), (11, 12, 8.7, 7.2),
    (13, 14, 11.0, 9.4), (14, 15, 9.3, 8.2), (15, 16, 8.2, 6.8),
    (17, 18, 10.2, 8.5), (18, 19, 8.4, 7.3), (19, 20, 7.3, 6.1),
)  # fmt: skip
_THUMB = ((1, 2, 15.0, 12.0), (2, 3, 11.4, 10.2), (3, 4, 10.2, 7.8))
_PALM = (
    (0, 5, 15.0, 12.4), (0, 9, 15.0, 12.6), (21, 13, 15.0, 12.2), (21, 17, 15.5, 11.6),
    (5, 9, 12.0, 12.2), (9, 13, 12.2, 11.8), (13, 17, 11.8, 10.8),
    (21, 23, 16.0, 14.5), (23, 17, 14.5, 11.0),
    (26, 22, 15.0, 10.0), (26, 2, 15.5, 12.0), (22, 2, 9.0, 9.5), (26, 0, 15.0, 15.0), (22, 5, 10.0, 11.0),
)  # fmt: skip
_FOREARM = ((26, 24, 15.5, 22.0), (21, 24, 16.0, 22.0), (0, 24, 18.0, 25.0), (24, 25, 26.0, 40.0))
CONES = (*_FINGERS, *_THUMB, *_PALM, *_FOREARM)
_FROM = np.array([cone[0] for cone in CONES])
_TO = np.array([cone[1] for cone in CONES])
_RADII_M = np.array([cone[2:] for cone in CONES]) / 1000
_ROUND_START = ~np.isin(_FROM, _TO)
_FOREARM_M = (0.045, 0.30)  # along the forearm from the wrist: where it has become round, and where we end it


@dataclass(frozen=True, slots=True)
class Flesh:
    """n rounded cones. a, b: (n, 3) axis ends; radius_a, radius_b: (n,), metres.

    round_start: (n,) whether end a needs a ball of its own; where another cone ends there, it has one already.
    """

    a: FloatArray
    b: FloatArray
    radius_a: FloatArray
    radius_b: FloatArray
    round_start: NDArray[np.bool_]


def flesh(joints: FloatArray, shape: HandShape) -> Flesh:
    """The cones around (21, 3) joints, in whichever frame the joints are."""
    points = np.vstack([joints, _helpers(joints, shape)])
    radii = _RADII_M * shape.scale
    return Flesh(points[_FROM], points[_TO], radii[:, 0], radii[:, 1], _ROUND_START)


def _helpers(joints: FloatArray, shape: HandShape) -> FloatArray:
    """21: heel below the pinky; 22: web of the thumb; 23: outer palm; 24, 25: forearm; 26: heel below the thumb."""
    wrist, middle, pinky = joints[0], joints[9], joints[17]
    across, along = joints[17] - joints[5], middle - wrist
    heel = wrist + 0.27 * across + 0.06 * along
    web = 0.40 * joints[2] + 0.30 * joints[5] + 0.30 * joints[1]
    outer = 0.50 * heel + 0.50 * pinky + 0.06 * across
    thenar = 0.60 * joints[1] + 0.40 * wrist - 0.08 * across
    near, far = (wrist - along / np.linalg.norm(along) * length * shape.scale for length in _FOREARM_M)
    return np.stack([heel, web, outer, near, far, thenar])
