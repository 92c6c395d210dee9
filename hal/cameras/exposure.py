"""Is the picture good enough? A sentence for the therapist when it is dark, over-exposed or blurred."""

from __future__ import annotations

import cv2
import numpy as np

from hal.cameras.camera import ImageArray

DARK_LEVEL = 40.0  # mean grey below which MediaPipe begins to lose hands
BRIGHT_LEVEL = 250
BRIGHT_SHARE = 0.30  # of the picture at the top of the scale
SHARP_EDGE = 12.0  # the steepest hundredth of a sharp picture's edges, grey levels a pixel
_LOOK_WIDTH_PX = 480

DARK = "The picture is dark: switch on a light, or turn the camera away from the window."
BRIGHT = "The picture is over-exposed: dim the light behind the hand, or lower the camera's exposure."
BLURRED = "The picture is blurred: clean or focus the lens, and give it more light."


def hint(image_bgr: ImageArray) -> str:
    """What is wrong with a picture, as a sentence; empty when nothing is."""
    width = image_bgr.shape[1]
    step = max(1, width // _LOOK_WIDTH_PX)
    grey = cv2.cvtColor(np.ascontiguousarray(image_bgr[::step, ::step]), cv2.COLOR_BGR2GRAY)
    if grey.mean() < DARK_LEVEL:
        return DARK
    if (grey >= BRIGHT_LEVEL).mean() > BRIGHT_SHARE:
        return BRIGHT
    return BLURRED if _steepest(image_bgr) < SHARP_EDGE else ""


def _steepest(image_bgr: ImageArray) -> float:
    """Edge steepness that one pixel in a hundred exceeds, after the sensor's noise is averaged away."""
    scale = min(1.0, _LOOK_WIDTH_PX / image_bgr.shape[1])
    small = cv2.resize(image_bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.25)
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.25)
    return float(np.percentile(cv2.magnitude(across, down), 99))
