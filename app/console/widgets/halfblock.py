"""A picture as terminal cells: two pixels a cell, `▀` in two colours; letters of growing ink without colours."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from app.ipc.messages import Preview

Pixels = NDArray[np.uint8]  # (height, width, 3) RGB

_INK = " .:-=+*#%@"
_KEEP = 0xF8  # five bits a channel: neighbours merge, styles repeat, and the eye can't tell in a cell


def pixels_of(preview: Preview) -> Pixels:
    """The preview's bytes as an array."""
    return np.frombuffer(preview.rgb, np.uint8).reshape(preview.height_px, preview.width_px, 3)


def fit(width_px: int, height_px: int, columns: int, rows: int) -> tuple[int, int]:
    """Columns and pixel rows (even) of the largest undistorted picture; a cell is twice as high as wide."""
    scale = min(columns / width_px, 2 * rows / height_px)
    return max(1, int(width_px * scale)), max(2, int(height_px * scale) // 2 * 2)


def resample(pixels: Pixels, width: int, height: int) -> Pixels:
    """The picture at another size: nearest row and column, which keeps the drawn lines' full colour."""
    if pixels.shape[:2] == (height, width):
        return pixels
    rows = (np.arange(height) + 0.5) * pixels.shape[0] / height
    columns = (np.arange(width) + 0.5) * pixels.shape[1] / width
    smaller: Pixels = pixels[rows.astype(np.intp)[:, None], columns.astype(np.intp)[None, :]]
    return smaller


def smooth(pixels: Pixels, width: int, height: int) -> Pixels:
    """The picture at another size, for a terminal with real pixels."""
    import cv2

    return np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def to_strips(pixels: Pixels) -> list[Strip]:
    """One strip of half blocks for each two rows of pixels."""
    kept = pixels.astype(np.uint32) & _KEEP
    packed = kept[..., 0] << 16 | kept[..., 1] << 8 | kept[..., 2]
    return [_strip(packed[row], packed[row + 1]) for row in range(0, packed.shape[0] - 1, 2)]


def to_letters(pixels: Pixels) -> list[Strip]:
    """One strip of letters for each two rows of pixels, by their brightness."""
    light = pixels.astype(np.float32).mean(axis=2)
    light = (light[0:-1:2] + light[1::2]) / 2
    index = np.minimum((light / 256 * len(_INK)).astype(np.intp), len(_INK) - 1)
    return [Strip([Segment("".join(_INK[i] for i in row))], len(row)) for row in index]


def _strip(upper: NDArray[np.uint32], lower: NDArray[np.uint32]) -> Strip:
    changes = np.flatnonzero((np.diff(upper) != 0) | (np.diff(lower) != 0)) + 1
    starts = [0, *changes.tolist()]
    ends = [*starts[1:], len(upper)]
    segments = [
        Segment("▀" * (end - start), _style(int(upper[start]), int(lower[start])))
        for start, end in zip(starts, ends, strict=True)
    ]
    return Strip(segments, len(upper))


@lru_cache(maxsize=4096)
def _style(upper: int, lower: int) -> Style:
    return Style.from_color(_colour(upper), _colour(lower))


@lru_cache(maxsize=4096)
def _colour(packed: int) -> Color:
    return Color.from_rgb(packed >> 16, packed >> 8 & 0xFF, packed & 0xFF)
