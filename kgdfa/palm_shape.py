"""The palm as a flat, rigid shape: how an affine picture of it tells distance and tilt.

Tilting shortens lengths across the tilt's axis and leaves those along it as they are. So the largest stretch of
the map from the palm's own plane to the picture (its first singular value) is that of a palm that faces the
camera, whatever the tilt: Eq. 4 without its error. The ratio of the two singular values is the tilt's cosine.
A mirrored map (left hand, back of the hand) has the same singular values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kgdfa.hand import FloatArray, Keypoint

# The part of the palm that moves as one piece; the thumb's base is left out.
RIGID = (Keypoint.WRIST, Keypoint.INDEX_MCP, Keypoint.MIDDLE_MCP, Keypoint.RING_MCP, Keypoint.PINKY_MCP)

# Their places in the palm's plane in palm anchors from keypoint 21, as MediaPipe marks them on a flat palm that
# faces the camera: median of six digital hands at 35 cm (`rleex evaluate distance` uses other hands).
SHAPE = np.array([(0.016, 1.395), (0.477, -0.121), (0.139, -0.174), (-0.179, -0.082), (-0.477, 0.121)])
_CENTRE = SHAPE.mean(axis=0)
_SOLVER = np.linalg.pinv(SHAPE - _CENTRE)


@dataclass(frozen=True, slots=True, kw_only=True)
class PalmView:
    """What a picture of the palm says. stretch: picture length of one palm anchor that lies across the view.

    along: 0-1, whether that stretch runs along the palm (1, wrist to knuckles) or across it (0).
    misfit: what no flat palm explains, as a share of the palm's size; about 0.05 for a hand well seen.
    """

    stretch: float
    tilt_rad: float
    along: float
    misfit: float


def view_palm(image: FloatArray) -> PalmView:
    """Fit the palm's shape to (21, 2) keypoints, in any unit of length; the stretch has that unit."""
    seen = image[list(RIGID)]
    seen = seen - seen.mean(axis=0)
    affine = _SOLVER @ seen
    palm, (long, short), _ = np.linalg.svd(affine)
    size = float(np.linalg.norm(seen))
    misfit = float(np.linalg.norm((SHAPE - _CENTRE) @ affine - seen)) / size if size > 0 else math.inf
    cosine = min(1.0, float(short / long)) if long > 0 else 0.0
    return PalmView(stretch=float(long), tilt_rad=math.acos(cosine), along=float(palm[1, 0] ** 2), misfit=misfit)


def centre_offset(world: FloatArray) -> float:
    """How much farther keypoint 21 is from the camera than the middle of the rigid part, in palm anchors.

    world: (21, 3) keypoints in any unit, z away from the camera.
    """
    anchor = float(np.linalg.norm(world[Keypoint.INDEX_MCP] - world[Keypoint.PINKY_MCP]))
    middle = (world[Keypoint.INDEX_MCP, 2] + world[Keypoint.PINKY_MCP, 2]) / 2
    return float(middle - world[list(RIGID), 2].mean()) / anchor if anchor > 0 else 0.0
