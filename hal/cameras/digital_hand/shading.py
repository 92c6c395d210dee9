"""Colour of the image: skin under one lamp with darker creases and a soft outline, and the room behind the hand."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import ImageArray
from hal.cameras.digital_hand.raycast import Float32Array

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
    filled: Float32Array = np.where(met, depth_m, behind)
    return filled


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
    lit: ImageArray = np.clip(blurred * brightness, 0, 255).astype(np.uint8)
    return lit


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
