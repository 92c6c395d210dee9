"""How an image is shown to a hand detector: turned, smaller, brighter, surrounded with black; and where it then is.

MediaPipe's palm detector misses some hands in plain sight, near ones and folded ones above all, and finds most of
them in the same image made smaller, turned by 25° or made brighter (docs: gestures).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from kgdfa.hand import FloatArray
from kgdfa.preprocess import Image

BRIGHTER = 0.5  # gamma of a near view: of 300 near hands 229 are found instead of 178 (docs: gestures, near views)
SHRUNK = 2  # a view has half the image's pixels each way: more cost time, and the landmark model sees 224


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How an image is shown, in half its pixels each way: scaled and turned about its middle.

    gamma: exponent of each pixel's share of white. black: what surrounds the image, instead of its edge pixels.
    """

    scale: float = 1.0
    turn_deg: float = 0.0
    gamma: float = 1.0
    black: bool = False


FULL_VIEW = View()
REDETECTION_VIEWS = (
    FULL_VIEW,
    View(scale=0.8),
    View(scale=0.8, turn_deg=25),
    View(scale=0.8, turn_deg=-25),
    View(scale=0.6),
)
# A near hand just lost is shown plainly first, and then in these, in turn. Of untracked digital hands at 14.5 to 19 cm
# 57 % are found plainly and 89 % turned, brighter and surrounded with black, as MediaPipe's own crops are (docs:
# gestures, near views).
NEAR_VIEWS = tuple(View(turn_deg=turn_deg, gamma=BRIGHTER, black=True) for turn_deg in (25, 0, -25))


def in_other_light(view: View) -> View:
    """The view brighter and surrounded with black, or as it is if it was so."""
    if view.black:
        return replace(view, gamma=1.0, black=False)
    return replace(view, gamma=BRIGHTER, black=True)


def render_view(image_bgr: Image, view: View) -> tuple[Image, FloatArray]:
    """The image as the view shows it, and the (2, 3) affine map from the image's pixels to the view's."""
    if view == FULL_VIEW:
        return image_bgr, np.eye(3)[:2]
    height, width = image_bgr.shape[:2]
    size = (max(1, width // SHRUNK), max(1, height // SHRUNK))
    border = cv2.BORDER_CONSTANT if view.black else cv2.BORDER_REPLICATE
    placed = _turned(image_bgr, view, size, border) if view.turn_deg else _smaller(image_bgr, view.scale, size, border)
    shown, transform = placed
    return (shown if view.gamma == 1.0 else np.asarray(cv2.LUT(shown, _brightened(view.gamma)), np.uint8)), transform


@cache
def _brightened(gamma: float) -> Image:
    return np.asarray(np.rint(255 * (np.arange(256) / 255) ** gamma), dtype=np.uint8)


def _turned(image_bgr: Image, view: View, size: tuple[int, int], border: int) -> tuple[Image, FloatArray]:
    height, width = image_bgr.shape[:2]
    transform: FloatArray = cv2.getRotationMatrix2D((width / 2, height / 2), view.turn_deg, view.scale) / SHRUNK
    shown = cv2.warpAffine(image_bgr, transform, size, borderMode=border)
    return np.asarray(shown, dtype=np.uint8), transform


def _smaller(image_bgr: Image, scale: float, size: tuple[int, int], border: int) -> tuple[Image, FloatArray]:
    """In the middle of the view; without a turn this is several times as fast as warping."""
    height, width = image_bgr.shape[:2]
    wide, high = (max(1, round(scale * side)) for side in size)
    left, top = (size[0] - wide) // 2, (size[1] - high) // 2
    small = cv2.resize(image_bgr, (wide, high), interpolation=cv2.INTER_LINEAR)
    right, bottom = size[0] - wide - left, size[1] - high - top
    shown = cv2.copyMakeBorder(small, top, bottom, left, right, border)
    x, y = wide / width, high / height
    # Pixels are named by their middle, half a pixel from their edge.
    transform = np.array([[x, 0, left + (x - 1) / 2], [0, y, top + (y - 1) / 2]])
    return np.asarray(shown, dtype=np.uint8), transform


def near_view(missing: int, scale: float) -> View:
    """The one of NEAR_VIEWS after so many frames without the hand, in this size."""
    return replace(NEAR_VIEWS[missing % len(NEAR_VIEWS)], scale=scale)
