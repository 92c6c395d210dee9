"""The pipeline's results drawn onto the image: skeleton, both hulls, bounding box and the virtual button.

An image that will be shown in terminal cells is too small for that: it gets thick bones and fingertips alone.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from kgdfa.button_state import ButtonPlace, ButtonState
from kgdfa.hand import INNER_HULL, OUTER_HULL, TIPS, FloatArray, Hand, Keypoint, hull
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
EDGE: Colour = (20, 20, 20)
BONE: Colour = (240, 240, 240)
JOINT: Colour = (200, 120, 30)
INNER: Colour = (60, 200, 250)
OUTER: Colour = (230, 160, 90)
BOX: Colour = (170, 170, 170)
PRESSED: Colour = (70, 190, 70)
RELEASED: Colour = (60, 60, 220)
COARSE_PX = 480  # narrower images get the coarse drawing: a terminal's cells, two pixels drawn for each one shown
_COARSE_BONE_PX = 2  # a pixel shown: thicker ones of a small hand would run into each other
_FULL = 0.8  # of the ring's inside, by the hand that is nearest without pressing: pressed looks different
_SHIFT = 3  # sub-pixel drawing, in powers of two


def draw(image_bgr: NDArray[np.uint8], report: Report, place: ButtonPlace, scale: float = 1.0) -> None:
    """Draw one report onto its image, (h, w, 3) uint8 BGR, in place; scale: of the image since the report."""
    if report.hand is not None:
        drawn = draw_hand if image_bgr.shape[1] > COARSE_PX else draw_bones
        drawn(image_bgr, report.hand, scale)
    safe_m = None if report.distance is None else report.distance.safe_m
    draw_button(image_bgr, report.button, place, scale, depth_share(safe_m, place.threshold_m))


def depth_share(safe_m: float | None, threshold_m: float) -> float:
    """How far a hand has come from twice the threshold (0) to the threshold (1); 0 without a distance."""
    if safe_m is None:
        return 0.0
    return min(1.0, max(0.0, 2 - safe_m / threshold_m))


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


def draw_bones(image_bgr: Image, hand: Hand, scale: float = 1.0) -> None:
    """The skeleton for a coarse grid: dark edges, thick bones, the fingertips as dots, in place."""
    fixed = _fixed(hand.image_px, scale)
    lines = [fixed.take(line, axis=0) for line in LINES]
    width = max(_COARSE_BONE_PX, round(scale * hand.reference_px / 7))
    for colour, wide in ((EDGE, width + 2), (BONE, width)):
        cv2.polylines(image_bgr, lines, False, colour, wide, cv2.LINE_AA, _SHIFT)
    for tip in TIPS:
        cv2.circle(image_bgr, fixed[tip].tolist(), (3 * width << _SHIFT) // 4, INNER, -1, cv2.LINE_AA, _SHIFT)


def draw_button(
    image_bgr: Image, button: ButtonState, place: ButtonPlace, scale: float = 1.0, share: float = 0.0
) -> None:
    """The virtual button, in place: green and whole while pressed, else a red ring (never colour alone).

    share: of the way to the threshold; the ring's inside fills with it.
    """
    centre = _fixed(np.array([place.x_px, place.y_px]), scale).tolist()
    radius = scale * place.radius_px
    width = max(2, round(radius / (5 if image_bgr.shape[1] <= COARSE_PX else 8)))
    if button.pressed:
        _disc(image_bgr, centre, radius, PRESSED)
        _disc(image_bgr, centre, radius, BONE, width=max(1, width // 2))
        return
    if share > 0:
        _disc(image_bgr, centre, _FULL * share * (radius - width / 2), RELEASED)
    _disc(image_bgr, centre, radius, RELEASED, width=width)


def _disc(image_bgr: Image, centre: list[int], radius_px: float, colour: Colour, *, width: int = -1) -> None:
    cv2.circle(image_bgr, centre, round(radius_px * (1 << _SHIFT)), colour, width, cv2.LINE_AA, _SHIFT)


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
