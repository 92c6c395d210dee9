"""The palm's three flexion creases, drawn where the camera sees them.

They tell a palm from a back: without them MediaPipe can't name the side of an open digital hand. Courses after
the usual descriptions of the distal, proximal and thenar creases; nobody's in particular.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np

from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.raycast import Float32Array, Grid
from hal.cameras.digital_hand.skeleton import FloatArray, HandShape

# Each from its end at the hand's edge, as (across, along): across 0 at the little finger's knuckle and 1 at the
# forefinger's, along 0 on the line between them and 1 at the wrist.
_DISTAL = ((-0.12, 0.22), (0.25, 0.17), (0.55, 0.12), (0.78, 0.00))
_PROXIMAL = ((1.12, 0.25), (0.80, 0.27), (0.40, 0.38), (0.12, 0.52))
_THENAR = ((1.12, 0.24), (0.82, 0.35), (0.62, 0.55), (0.60, 0.78), (0.68, 0.95))
_POINTS = 16  # of each line
_SURFACE_M = 0.012  # of the reference palm, in front of the joints' plane
_HIDDEN_M = 0.010  # nearer by this, something is before the palm
_MIN_FACING = 0.2  # cosine between the palm's normal and the direction to the camera
_BLUR_CELLS, _WIDTH_CELLS, _FRACTION_BITS = 0.8, 2, 4


def _dense(line: tuple[tuple[float, float], ...]) -> FloatArray:
    given = np.array(line)
    at = np.linspace(0, len(given) - 1, _POINTS)
    return np.stack([np.interp(at, np.arange(len(given)), column) for column in given.T], axis=1)


_LINES = tuple(_dense(line) for line in (_DISTAL, _PROXIMAL, _THENAR))


def palm_lines(
    joints: FloatArray, shape: HandShape, hand_m: Float32Array, grid: Grid, lens: Intrinsics
) -> Float32Array:
    """How much of a line each cell shows, (rows, columns) in [0, 1].

    joints: (21, 3) in the camera's frame, metres. hand_m: (rows, columns) depth of the surface.
    """
    drawn = np.zeros(hand_m.shape, np.float32)
    wrist, index, pinky = joints[0], joints[5], joints[17]
    normal = np.cross(index - wrist, pinky - wrist) * (-1.0 if shape.left else 1.0)
    normal /= np.linalg.norm(normal)
    if -normal[2] < _MIN_FACING:
        return drawn
    for line in _LINES:
        across, along = line[:, :1], line[:, 1:]
        points = pinky + across * (index - pinky) + along * (wrist - (index + pinky) / 2)
        points += normal * _SURFACE_M * shape.scale
        cells = grid.cells(points, lens)
        for start, end in pairwise(range(_POINTS)):
            column, row = ((cells[start] + cells[end]) / 2).astype(int)
            if not (0 <= column < grid.columns and 0 <= row < grid.rows):
                continue
            if abs(hand_m[row, column] - (points[start, 2] + points[end, 2]) / 2) < _HIDDEN_M:
                ends = np.rint(cells[[start, end]] * 2**_FRACTION_BITS).astype(int).tolist()
                cv2.line(drawn, ends[0], ends[1], 1.0, _WIDTH_CELLS, cv2.LINE_AA, _FRACTION_BITS)
    return np.asarray(cv2.GaussianBlur(drawn, (0, 0), _BLUR_CELLS), np.float32)
