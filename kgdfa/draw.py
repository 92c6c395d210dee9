"""The pipeline's results drawn onto the image: skeleton, both hulls, bounding box and the virtual button."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from kgdfa.button import ButtonPlace, ButtonState
from kgdfa.hand import INNER_HULL, OUTER_HULL, FloatArray, Hand, Keypoint, hull
from kgdfa.pipeline import Report
from kgdfa.preprocess import Image

Colour = tuple[int, int, int]  # BGR

# The paper's links: MediaPipe's bones, and 2-5 which closes the palm. As lines from point to point.
LINES = tuple(
    np.array(line)
    for line in (
        (0, 1, 2, 3, 4),
        (2, 5, 9, 13, 17, 0),
        *((first, first + 1, first + 2, first + 3) for first in (5, 9, 13, 17)),
    )
)
BONE: Colour = (240, 240, 240)
JOINT: Colour = (200, 120, 30)
INNER: Colour = (60, 200, 250)
OUTER: Colour = (230, 160, 90)
BOX: Colour = (170, 170, 170)
PRESSED: Colour = (70, 190, 70)
RELEASED: Colour = (60, 60, 220)
_SHIFT = 3  # sub-pixel drawing, in powers of two


def draw(image_bgr: NDArray[np.uint8], report: Report, place: ButtonPlace, scale: float = 1.0) -> None:
    """Draw one report onto its image, (h, w, 3) uint8 BGR, in place; scale: of the image since the report."""
    if report.hand is not None:
        draw_hand(image_bgr, report.hand, scale)
    draw_button(image_bgr, report.button, place, scale)


def draw_hand(image_bgr: Image, hand: Hand, scale: float = 1.0) -> None:
    """Skeleton, inner and outer hull, bounding box, in place."""
    width = max(1, round(scale * hand.reference_px / 40))
    points = hand.image_px
    for members, colour in ((INNER_HULL, INNER), (OUTER_HULL, OUTER)):
        cv2.polylines(image_bgr, [_fixed(hull(points, members), scale)], True, colour, width, cv2.LINE_AA, _SHIFT)
    fixed = _fixed(points, scale)
    cv2.polylines(image_bgr, [fixed.take(line, axis=0) for line in LINES], False, BONE, width, cv2.LINE_AA, _SHIFT)
    middle = (fixed[Keypoint.INDEX_MCP] + fixed[Keypoint.PINKY_MCP]) // 2
    for point in (*fixed.tolist(), middle.tolist()):
        cv2.circle(image_bgr, point, (width + 1) << _SHIFT, JOINT, -1, cv2.LINE_AA, _SHIFT)
    low, high = fixed.min(axis=0).tolist(), fixed.max(axis=0).tolist()
    cv2.rectangle(image_bgr, low, high, BOX, 1, cv2.LINE_AA, _SHIFT)


def draw_button(image_bgr: Image, button: ButtonState, place: ButtonPlace, scale: float = 1.0) -> None:
    """The virtual button: green and filled while pressed, a red ring else (never colour alone), in place."""
    centre = _fixed(np.array([place.x_px, place.y_px]), scale).tolist()
    radius = round(scale * place.radius_px * (1 << _SHIFT))
    colour = PRESSED if button.pressed else RELEASED
    width = -1 if button.pressed else max(2, round(scale * place.radius_px / 8))
    cv2.circle(image_bgr, centre, radius, colour, width, cv2.LINE_AA, _SHIFT)


def caption(image_bgr: Image, lines: list[str]) -> Image:
    """The image with lines of text under it, (h + n, w, 3); wide enough to be read."""
    width = max(image_bgr.shape[1], 360)
    left = width - image_bgr.shape[1]
    padded = cv2.copyMakeBorder(image_bgr, 0, 18 * len(lines) + 6, 0, left, cv2.BORDER_CONSTANT)
    for row, line in enumerate(lines):
        where = (4, image_bgr.shape[0] + 15 + 18 * row)
        plain = line.replace("°", " deg").encode("ascii", "replace").decode()
        cv2.putText(padded, plain, where, cv2.FONT_HERSHEY_SIMPLEX, 0.42, BONE, 1, cv2.LINE_AA)
    return np.asarray(padded, dtype=np.uint8)


def _fixed(points_px: FloatArray, scale: float) -> NDArray[np.int32]:
    """Scaled, as the fixed-point numbers that OpenCV's drawing takes; far outliers are held near the image.

    A pixel is named by its middle, half a pixel from its edge.
    """
    scaled = np.clip(np.nan_to_num(points_px * scale + (scale - 1) / 2), -20_000, 20_000)
    return np.asarray(np.round(scaled * (1 << _SHIFT)), dtype=np.int32)
