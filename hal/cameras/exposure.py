"""Is the image good enough: not dark, over-exposed or blurred?"""

from __future__ import annotations

from enum import Enum, auto

import cv2
import numpy as np

from hal.cameras.camera import ImageArray

DARK_LEVEL = 40.0  # mean grey below which MediaPipe begins to lose hands
BRIGHT_LEVEL = 250
BRIGHT_SHARE = 0.30  # of the image at the top of the scale
SHARP_EDGE = 0.14  # slope a pixel over contrast nearby: a sharp edge has 0.3 to 0.5, a slope across the window 0.07
_CHECK_WIDTH_PX = 480
_WINDOW_PX = 15
_CONTRAST = 30  # grey levels: less is no edge


class ImageFault(Enum):
    """What is wrong with an image."""

    DARK = auto()
    OVEREXPOSED = auto()
    BLURRED = auto()


def image_fault(image_bgr: ImageArray) -> ImageFault | None:
    """What is wrong with a (height, width, 3) uint8 image, None when nothing is."""
    width = image_bgr.shape[1]
    step = max(1, width // _CHECK_WIDTH_PX)
    grey = cv2.cvtColor(np.ascontiguousarray(image_bgr[::step, ::step]), cv2.COLOR_BGR2GRAY)
    if grey.mean() < DARK_LEVEL:
        return ImageFault.DARK
    if (grey >= BRIGHT_LEVEL).mean() > BRIGHT_SHARE:
        return ImageFault.OVEREXPOSED
    return ImageFault.BLURRED if _blurred(image_bgr) else None


def _blurred(image_bgr: ImageArray) -> bool:
    """Whether even the steepest edges are shallow for their contrast; without edges it can't be known."""
    scale = min(1.0, _CHECK_WIDTH_PX / image_bgr.shape[1])
    small = cv2.resize(image_bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)  # averages noise away
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    window = np.ones((_WINDOW_PX, _WINDOW_PX), np.uint8)
    contrast = cv2.subtract(cv2.dilate(grey, window), cv2.erode(grey, window)).astype(np.float32)
    edges = contrast > _CONTRAST
    if edges.mean() < 0.001:
        return False
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125)
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125)
    steepness = cv2.magnitude(across, down)[edges] / contrast[edges]
    return float(np.percentile(steepness, 98)) < SHARP_EDGE
