"""The paper's first step, denoise and sharpen, and brightening besides, each behind a name (see docs/gestures.md)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kgdfa.errors import KgdfaError
from kgdfa.images import Image, as_bgr8

Prepare = Callable[[NDArray[Any]], Image]

_MEDIAN_PX = 3
_BLUR_SD_PX = 1.5
_SHARPNESS = 0.7  # how much of what a blur takes away is added again


def denoise(image_bgr: NDArray[Any]) -> Image:
    """A 3×3 median: takes a sensor's grain and keeps edges."""
    return np.asarray(cv2.medianBlur(as_bgr8(image_bgr), _MEDIAN_PX), dtype=np.uint8)


def sharpen(image_bgr: NDArray[Any]) -> Image:
    """Unsharp masking."""
    image = as_bgr8(image_bgr)
    blurred = cv2.GaussianBlur(image, (0, 0), _BLUR_SD_PX)
    return np.asarray(cv2.addWeighted(image, 1 + _SHARPNESS, blurred, -_SHARPNESS, 0), dtype=np.uint8)


def denoise_and_sharpen(image_bgr: NDArray[Any]) -> Image:
    """Both, in the paper's order."""
    return sharpen(denoise(image_bgr))


def brighten(image_bgr: NDArray[Any]) -> Image:
    """Spread the lightness locally (CLAHE), colours kept."""
    lab = cv2.cvtColor(as_bgr8(image_bgr), cv2.COLOR_BGR2LAB)
    lab[..., 0] = cv2.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(np.ascontiguousarray(lab[..., 0]))
    return np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2BGR), dtype=np.uint8)


PREPARATIONS: dict[str, Prepare] = {
    "none": as_bgr8,
    "denoise": denoise,
    "sharpen": sharpen,
    "denoise+sharpen": denoise_and_sharpen,
    "brighten": brighten,
}


def find_preparation(name: str) -> Prepare:
    """The preparation of that name. Raises KgdfaError naming those there are."""
    if name not in PREPARATIONS:
        raise KgdfaError(f"There is no preprocessing {name!r}: choose one of {', '.join(PREPARATIONS)}.")
    return PREPARATIONS[name]
