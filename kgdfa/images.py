"""Any picture an image file or camera may give, as 8-bit BGR; what can't be one is refused by name."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kgdfa.errors import KgdfaError

Image = NDArray[np.uint8]


def as_bgr8(image: NDArray[Any]) -> Image:
    """(h, w), (h, w, 1), (h, w, 3) BGR or (h, w, 4) BGRA, 8 or 16 bit, to (h, w, 3) uint8 BGR.

    Raises KgdfaError for pictures of zero size, other channel counts and other number types.
    """
    if image.ndim not in (2, 3) or image.size == 0:
        raise KgdfaError(f"A picture of shape {image.shape} has no pixels: check the camera or the file.")
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels not in _TO_BGR:
        raise KgdfaError(f"A picture with {channels} channels can't be read: give grey, BGR or BGRA.")
    if image.dtype not in (np.uint8, np.uint16):
        raise KgdfaError(f"A picture of {image.dtype} numbers can't be read: give 8 or 16 bit.")
    eight_bit = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    conversion = _TO_BGR[channels]
    if conversion is None:
        return np.asarray(eight_bit, dtype=np.uint8)
    return np.asarray(cv2.cvtColor(eight_bit, conversion), dtype=np.uint8)


_TO_BGR = {1: cv2.COLOR_GRAY2BGR, 3: None, 4: cv2.COLOR_BGRA2BGR}
