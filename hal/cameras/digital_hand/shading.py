"""Colour of the image: skin under one lamp with darker creases and a soft outline, and the room behind the hand.

The palm's three flexion creases are drawn where the camera sees them: they tell a palm from a back, and without them
MediaPipe can't name the side of an open digital hand. Courses after the usual descriptions of the distal, proximal and
thenar creases; nobody's in particular.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import ImageArray, Intrinsics
from hal.cameras.digital_hand.raycast import Float32Array, Grid
from hal.cameras.digital_hand.skeleton import FloatArray, HandShape

# Backward slope of the surface beyond which a cell belongs to the silhouette of a nearer part.
_CREASE_M = 0.010  # depth below the surroundings at which a crease is darkest
_CREASE_REACH_M = 0.008  # how far a crease's shade spreads
_LINE_SHADE = 0.2  # of the light that a line of the palm keeps back
_SILHOUETTE_CELLS = 1.1  # blur of the outline


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """A lamp and what the room reflects. towards: unit vector to the lamp in the camera's frame."""

    towards: tuple[float, float, float] = (0.3, -0.6, -0.74)
    lamp: float = 0.75
    ambient: float = 0.45
    tint_bgr: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Painted:
    """colour_bgr: (rows, columns, 3) uint8; cover: (rows, columns) float32 in [0, 1]."""

    colour_bgr: NDArray[np.uint8]
    cover: Float32Array


def paint(
    depth_m: Float32Array, lines: Float32Array, cell_m: float, tone_bgr: tuple[float, float, float], light: Light
) -> Painted:
    """Shade a depth map whose cells are cell_m wide on the hand; infinite depth is not covered. lines: the palm's."""
    met = np.isfinite(depth_m)
    cover = _outline(met)
    filled = _fill(depth_m, met)
    lit = _lambert(np.asarray(cv2.GaussianBlur(filled, (0, 0), 1.0), np.float32), cell_m, light)
    shade = lit * _creases(filled, met, cell_m) * (np.float32(1.0) - np.float32(_LINE_SHADE) * lines)
    return Painted(_skin(shade, tone_bgr, light), cover)


def _outline(met: NDArray[np.bool_]) -> Float32Array:
    soft = cv2.GaussianBlur(met.astype(np.float32), (0, 0), _SILHOUETTE_CELLS)
    cover: Float32Array = np.clip((soft - 0.25) * 2.0, 0.0, 1.0)
    return cover


def _fill(depth_m: Float32Array, met: NDArray[np.bool_]) -> Float32Array:
    """Depth with the background set just behind the hand, so that filters see no infinity."""
    if not met.any():
        return np.zeros_like(depth_m)
    behind = np.float32(depth_m[met].max() + 0.005)
    return np.where(met, depth_m, behind)


def _lambert(depth_m: Float32Array, cell_m: float, light: Light) -> Float32Array:
    slope_x = cv2.Sobel(depth_m, cv2.CV_32F, 1, 0, scale=0.125 / cell_m)
    slope_y = cv2.Sobel(depth_m, cv2.CV_32F, 0, 1, scale=0.125 / cell_m)
    to_x, to_y, to_z = (np.float32(part) for part in light.towards)
    length = cv2.sqrt(slope_x * slope_x + slope_y * slope_y + np.float32(1.0))
    # Normal of z(x, y) towards the camera is (slope_x, slope_y, -1) / length; wrapped, as skin scatters light.
    facing = (slope_x * to_x + slope_y * to_y - to_z) / length
    wrapped = np.maximum((facing + np.float32(0.35)) / np.float32(1.35), np.float32(0.0))
    sky = np.float32(0.6) + np.float32(0.4) / length
    lit: Float32Array = wrapped * np.float32(light.lamp) + np.float32(light.ambient) * sky
    return lit


def _creases(filled: Float32Array, met: NDArray[np.bool_], cell_m: float) -> Float32Array:
    reach = max(1.0, _CREASE_REACH_M / cell_m)
    weights = met.astype(np.float32)
    around = cv2.GaussianBlur(filled * weights, (0, 0), reach) / (cv2.GaussianBlur(weights, (0, 0), reach) + 1e-6)
    depth = np.clip((filled - around) / np.float32(_CREASE_M), 0.0, 1.0)
    kept: Float32Array = 1.0 - np.float32(0.55) * depth
    return kept


def _skin(shade: Float32Array, tone_bgr: tuple[float, float, float], light: Light) -> NDArray[np.uint8]:
    # Shadows on skin are redder than its lights: blue and green fall faster than red.
    steps = np.arange(512, dtype=np.float32) / 256.0
    tone = np.asarray(tone_bgr) * np.asarray(light.tint_bgr)
    table = np.stack([tone[channel] * steps**power for channel, power in enumerate((1.12, 1.08, 0.92))], axis=1)
    index = np.clip(shade * 256.0, 0, 511).astype(np.int32)
    skin: NDArray[np.uint8] = np.clip(table, 0, 255).astype(np.uint8)[index]
    return skin


Room = NDArray[np.float32]


def room_bgr(seed: int, light: Light, width_px: int, height_px: int) -> ImageArray:
    """(height, width, 3) uint8; the same for the same arguments."""
    draw = np.random.default_rng([seed, 0x726F_6F6D])
    room = _wall(draw, width_px, height_px)
    for _ in range(int(draw.integers(2, 9))):
        _furniture(room, draw)
    if draw.random() < 0.6:
        _clothes(room, draw)
    blurred = cv2.GaussianBlur(room, (0, 0), float(draw.uniform(2.0, 7.0)) * width_px / 1280)
    brightness = (light.ambient + 0.6 * light.lamp) * np.asarray(light.tint_bgr)
    return np.clip(blurred * brightness, 0, 255).astype(np.uint8)


def _wall(draw: np.random.Generator, width_px: int, height_px: int) -> Room:
    base = draw.uniform(60, 225) + draw.uniform(-25, 25, 3)
    across = np.linspace(-1, 1, width_px, dtype=np.float32)[None, :, None] * draw.uniform(-30, 30)
    down = np.linspace(-1, 1, height_px, dtype=np.float32)[:, None, None] * draw.uniform(-30, 30)
    wall: Room = (base + across + down).astype(np.float32)
    return wall


def _furniture(room: Room, draw: np.random.Generator) -> None:
    height_px, width_px = room.shape[:2]
    left, top = draw.uniform(-0.1, 0.9) * width_px, draw.uniform(-0.1, 0.9) * height_px
    wide, high = draw.uniform(0.05, 0.45) * width_px, draw.uniform(0.05, 0.6) * height_px
    colour = draw.uniform(20, 235) + draw.uniform(-40, 40, 3)
    cv2.rectangle(room, (int(left), int(top)), (int(left + wide), int(top + high)), colour.tolist(), -1)


def _clothes(room: Room, draw: np.random.Generator) -> None:
    height_px, width_px = room.shape[:2]
    centre = (int(width_px * draw.uniform(0.3, 0.7)), int(height_px * 1.05))
    axes = (int(width_px * draw.uniform(0.2, 0.3)), int(height_px * draw.uniform(0.5, 0.75)))
    colour = draw.uniform(20, 160) + draw.uniform(-40, 40, 3)
    cv2.ellipse(room, centre, axes, 0.0, 0.0, 360.0, colour.tolist(), -1)


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
