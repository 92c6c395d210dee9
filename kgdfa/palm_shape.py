"""The palm as a flat, rigid shape: how much it is tilted, and its size on the image without the tilt.

Tilting shortens lengths across the tilt's axis and leaves those along it as they are. So the largest stretch of
the map from the palm's own plane to the image (its first singular value) is that of a palm that faces the
camera, whatever the tilt: Eq. 4 without its error. The ratio of the two singular values is the tilt's cosine.
A mirrored map (left hand, back of the hand) has the same singular values.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import mul

import numpy as np

from kgdfa.hand import Keypoint

# The part of the palm that moves as one piece; the thumb's base is left out.
RIGID = (Keypoint.WRIST, Keypoint.INDEX_MCP, Keypoint.MIDDLE_MCP, Keypoint.RING_MCP, Keypoint.PINKY_MCP)

# Their places in the palm's plane in reference segments from keypoint 21, as MediaPipe marks them on a flat palm that
# faces the camera: median of six digital hands at 35 cm (`rleex evaluate distance` uses other hands).
SHAPE = np.array([(0.016, 1.395), (0.477, -0.121), (0.139, -0.174), (-0.179, -0.082), (-0.477, 0.121)])
FORE, LITTLE = RIGID.index(Keypoint.INDEX_MCP), RIGID.index(Keypoint.PINKY_MCP)
# Plain numbers from here on: of so few, NumPy's arithmetic takes longer to start than to do.
_ACROSS, _ALONG = (SHAPE - SHAPE.mean(axis=0)).T.tolist()
_SOLVE_ACROSS, _SOLVE_ALONG = np.linalg.pinv(SHAPE - SHAPE.mean(axis=0)).tolist()
Points = Sequence[Sequence[float]]  # the keypoints RIGID, (5, 2) or (5, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class PalmView:
    """What an image of the palm gives. stretch: length on the image of one reference segment that lies across the view.

    along: 0-1, whether that stretch runs along the palm (1, wrist to knuckles) or across it (0).
    misfit: what no flat palm explains, as a share of the palm's size; about 0.05 for a hand well seen.
    """

    stretch: float
    tilt_rad: float
    along: float
    misfit: float


def view_palm(rigid: Points) -> PalmView:
    """Fit the palm's shape to the keypoints RIGID, (5, 2) in any unit of length; the stretch has that unit."""
    x, y = (sum(axis) / len(rigid) for axis in zip(*rigid, strict=True))
    xs, ys = [point[0] - x for point in rigid], [point[1] - y for point in rigid]
    # The affine map: one reference segment across the palm becomes (a, b) on the image, one along it (c, d).
    a, b = _dot(_SOLVE_ACROSS, xs), _dot(_SOLVE_ACROSS, ys)
    c, d = _dot(_SOLVE_ALONG, xs), _dot(_SOLVE_ALONG, ys)
    # Its singular values, and how much of the first one's direction is along the palm.
    mean, half = (a * a + b * b + c * c + d * d) / 2, (a * a + b * b - c * c - d * d) / 2
    apart = math.hypot(half, a * c + b * d)
    long = math.sqrt(mean + apart)
    cosine = min(1.0, abs(a * d - b * c) / long**2) if long > 0 else 0.0
    size = math.hypot(*xs, *ys)
    rest = (
        *(across * a + along * c - x for across, along, x in zip(_ACROSS, _ALONG, xs, strict=True)),
        *(across * b + along * d - y for across, along, y in zip(_ACROSS, _ALONG, ys, strict=True)),
    )
    return PalmView(
        stretch=long,
        tilt_rad=math.acos(cosine),
        along=(1 - half / apart) / 2 if apart > 0 else 0.0,
        misfit=math.hypot(*rest) / size if size > 0 else math.inf,
    )


def centre_offset(world: Points) -> float:
    """How much farther keypoint 21 is from the camera than the middle of the rigid part, in reference segments.

    world: (5, 3) keypoints in any unit, z away from the camera.
    """
    reference = math.dist(world[FORE], world[LITTLE])
    middle = (world[FORE][2] + world[LITTLE][2]) / 2
    return (middle - sum(point[2] for point in world) / len(world)) / reference if reference > 0 else 0.0


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    total: float = sum(map(mul, one, other))
    return total
