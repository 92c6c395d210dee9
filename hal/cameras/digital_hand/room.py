"""The room behind the digital hand: a wall with furniture out of focus, and the wearer's clothes below."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import ImageArray
from hal.cameras.digital_hand.shading import Light

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
