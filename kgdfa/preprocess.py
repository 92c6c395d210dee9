"""The image of a file or a camera as 8-bit BGR; what can't be one is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from kgdfa.errors import KgdfaError, KgdfaFault

Image = NDArray[np.uint8]
# Of a photo that is augmented as it is, and of a camera's frame. With its border a phone's photo of 12 megapixels takes
# 0.8 GB in every thread, for views of 768 pixels at most.
LARGEST_SIDE_PX = 1280


def as_bgr8(image: NDArray[Any]) -> Image:
    """(h, w), (h, w, 1), (h, w, 3) BGR or (h, w, 4) BGRA, 8 or 16 bit, to (h, w, 3) uint8 BGR.

    Raises KgdfaError for images of zero size, other channel counts and other number types.
    """
    if image.ndim not in (2, 3) or image.size == 0:
        raise KgdfaError(KgdfaFault.IMAGE_EMPTY, shape=str(image.shape))
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels not in _TO_BGR:
        raise KgdfaError(KgdfaFault.IMAGE_CHANNELS, channels=channels)
    if image.dtype not in (np.uint8, np.uint16):
        raise KgdfaError(KgdfaFault.IMAGE_NUMBERS, kind=str(image.dtype))
    eight_bit = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    conversion = _TO_BGR[channels]
    if conversion is None:
        return np.asarray(eight_bit, dtype=np.uint8)
    return np.asarray(cv2.cvtColor(eight_bit, conversion), dtype=np.uint8)


def reduced(image_bgr: Image) -> Image:
    """An image with more than LARGEST_SIDE_PX on its longer side made smaller, to that; any other one as it is."""
    sides = image_bgr.shape[1::-1]
    scale = LARGEST_SIDE_PX / max(sides)
    if scale >= 1:
        return image_bgr
    width, height = (max(1, round(side * scale)) for side in sides)
    return np.asarray(cv2.resize(image_bgr, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


_TO_BGR = {1: cv2.COLOR_GRAY2BGR, 3: None, 4: cv2.COLOR_BGRA2BGR}


Prepare = Callable[[NDArray[Any]], Image]

_MEDIAN_PX = 3
_BLUR_SD_PX = 1.5
_SHARPNESS = 0.7  # how much of what a blur takes away is added again
_GRAINY = 0.11  # noise relative to light: digital hands show up to 0.09, the same ones dark or grainy 0.15 and more
_DARK = 90.0  # grey level that the lightest twentieth of an image reaches, below which it is dark
_LIGHT = 200.0  # where a lightened image's lightest twentieth is put,
_MOST_GAIN = 8.0  # by no more than this: what is black shows noise only
EVALUATED_EVERY = 10  # frames: light changes slowly, and judging takes half a millisecond
_STRIDE = 16  # of the pixels that tell how dark an image is
_MIDDLE = 5  # an image's grain is measured in the middle one of so many parts each way,
_ROWS = 4  # by every fourth row of it
_IMMERKAER = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)  # blind to planes, edges and lines
_IMMERKAER_GAIN = 6.0  # of noise
_MEDIAN_OF_NORMAL = 0.6745  # median size of a normal draw, in sd


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


def lighten(image_bgr: NDArray[Any]) -> Image:
    """A dark image multiplied until its lightest parts are light; any other one as it is."""
    image = as_bgr8(image_bgr)
    lightest = float(np.percentile(image[::_STRIDE, ::_STRIDE, 1], 95))
    if lightest >= _DARK:
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=min(_MOST_GAIN, _LIGHT / max(lightest, 1.0))), dtype=np.uint8)


def as_needed(image_bgr: NDArray[Any]) -> Image:
    """Denoised where it is grainy, then lightened where it is dark: a good image stays as it is."""
    image = as_bgr8(image_bgr)
    return lighten(denoise(image) if grain(image) > _GRAINY else image)


class AsNeeded:
    """`as_needed` for a camera's frames: every tenth is assessed, and those after it are taken to be like it."""

    def __init__(self) -> None:
        self._frames = 0
        self._prepare: Prepare = as_bgr8

    def __call__(self, image_bgr: NDArray[Any]) -> Image:
        """One frame after the other."""
        image = as_bgr8(image_bgr)
        if self._frames % EVALUATED_EVERY == 0:
            self._prepare = as_bgr8 if as_needed(image) is image else as_needed
        self._frames += 1
        return self._prepare(image)


def grain(image_bgr: Image) -> float:
    """The noise of an image's middle relative to its light.

    The noise's sd as by Immerkær (1996, Comput. Vis. Image Underst. 64, 300), with a median in place of his mean,
    so that edges don't count.
    """
    height, width = image_bgr.shape[:2]
    top, left = (_MIDDLE // 2) * height // _MIDDLE, (_MIDDLE // 2) * width // _MIDDLE
    middle = image_bgr[top : height - top, left : width - left, 1]
    if middle.size == 0:
        return 0.0
    rough = np.abs(cv2.filter2D(middle, cv2.CV_16S, _IMMERKAER)[::_ROWS])
    noise_sd = float(np.median(rough)) / (_MEDIAN_OF_NORMAL * _IMMERKAER_GAIN)
    return noise_sd / max(float(middle[::_ROWS].mean()), 1.0)


PREPARATIONS: dict[str, Prepare] = {
    "none": as_bgr8,
    "denoise": denoise,
    "sharpen": sharpen,
    "denoise+sharpen": denoise_and_sharpen,
    "brighten": brighten,
    "lighten": lighten,
    "as needed": as_needed,
}


def find_preparation(name: str) -> Prepare:
    """The preparation of that name. Raises KgdfaError naming those there are."""
    if name not in PREPARATIONS:
        raise KgdfaError(KgdfaFault.PREPROCESSING, name=name, known=", ".join(PREPARATIONS))
    return PREPARATIONS[name]
