"""What a film's frame is drawn with: text in any language, panels, polylines. Pixels, BGR, y down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]  # (height, width, 3) BGR
Colour = tuple[int, int, int]

GROUND: Colour = (24, 20, 18)
PANEL: Colour = (38, 32, 29)
EDGE: Colour = (74, 64, 58)
TEXT: Colour = (235, 232, 230)
MUTED: Colour = (160, 150, 145)
ACCENT: Colour = (245, 190, 90)  # what was measured
PLANNED: Colour = (90, 160, 245)  # what was commanded
GOOD: Colour = (120, 210, 110)
WARN: Colour = (60, 190, 245)
BAD: Colour = (85, 85, 245)
LEFT_LEG: Colour = (245, 190, 90)
RIGHT_LEG: Colour = (150, 205, 130)
SMALL, NORMAL, LARGE = 14, 17, 24
REGULAR, BOLD = 400, 700
_SHIFT = 4  # sub-pixel drawing, in powers of two


@dataclass(frozen=True, slots=True)
class Box:
    """A part of the frame."""

    x: int
    y: int
    width: int
    height: int

    @property
    def right(self) -> int:
        return self.x + self.width

    @property
    def bottom(self) -> int:
        return self.y + self.height

    def inner(self, margin: int, top: int = 0) -> Box:
        """Without a margin, and without its title."""
        return Box(self.x + margin, self.y + margin + top, self.width - 2 * margin, self.height - 2 * margin - top)


@lru_cache(maxsize=1)
def _face() -> cv2.FontFace:
    return cv2.FontFace("sans")  # built into OpenCV 5, with Chinese


@lru_cache(maxsize=4096)
def text_width(text: str, size: int = NORMAL, weight: int = REGULAR) -> int:
    """In pixels."""
    _, _, width, _ = cv2.getTextSize((4000, 200), text, (0, 0), _face(), size, weight)
    return int(width)


def write(
    image: Image,
    at: tuple[int, int],
    text: str,
    colour: Colour = TEXT,
    size: int = NORMAL,
    *,
    weight: int = REGULAR,
    right: bool = False,
) -> int:
    """Text with its baseline there, from or up to that place; where it ends."""
    x, y = at
    width = text_width(text, size, weight)
    x -= width if right else 0
    cv2.putText(image, text, (x, y), colour, _face(), size, weight)
    return x + width


def cut(text: str, width: int, size: int = NORMAL) -> str:
    """As much of it as fits, an ellipsis for the rest."""
    if text_width(text, size) <= width:
        return text
    low, high = 0, len(text)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if text_width(text[:middle] + "…", size) <= width else (low, middle - 1)
    return text[:low].rstrip() + "…"


def panel(image: Image, box: Box, title: str) -> Box:
    """Its ground and title; what is left for the content."""
    cv2.rectangle(image, (box.x, box.y), (box.right, box.bottom), PANEL, -1)
    write(image, (box.x + 10, box.y + 20), title, MUTED, SMALL)
    return box.inner(8, 22)


def lines(
    image: Image, points: Sequence[tuple[float, float]] | NDArray[np.float64], colour: Colour, width: int
) -> None:
    """One line through points, with sub-pixels."""
    fixed = np.round(np.asarray(points, dtype=np.float64).reshape(-1, 1, 2) * (1 << _SHIFT)).astype(np.int32)
    if len(fixed) > 1:
        cv2.polylines(image, [fixed], False, colour, width, cv2.LINE_AA, _SHIFT)


def disc(image: Image, at: tuple[float, float], radius: float, colour: Colour) -> None:
    """A filled one."""
    x, y = (round(value * (1 << _SHIFT)) for value in at)
    cv2.circle(image, (x, y), round(radius * (1 << _SHIFT)), colour, -1, cv2.LINE_AA, _SHIFT)


def dashed(image: Image, y: int, from_x: int, to_x: int, colour: Colour) -> None:
    """A level line in dashes."""
    for x in range(from_x, to_x, 10):
        cv2.line(image, (x, y), (min(x + 5, to_x), y), colour, 1)
