"""Other views of a live picture while no hand is found: smaller, or turned. What finds one is kept until it is lost.

A tracker looks for the hand near where it was, so that a push of 0.3 s leaves it behind. The frame that loses a hand is
therefore looked at once more: with none to follow, the tracker looks everywhere.

MediaPipe's palm detector misses some hands in plain sight, near ones and folded ones above all, and finds most of
them in the same picture made smaller or turned by 25° (docs/gestures.md). A frame has time for one view only, so a
search shows another one in each frame. A followed hand costs nothing when the plain picture found it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from kgdfa.hand import FloatArray, Hand
from kgdfa.images import Image
from kgdfa.looks import on_picture

PATIENCE_FRAMES = 2  # without a hand before the search begins, plainly: the plain picture finds most that come
SHRUNK = 2  # a view has half the picture's pixels each way: warping all of them costs as much as the detector


@dataclass(frozen=True, slots=True, kw_only=True)
class Glance:
    """How a picture is shown, in half its pixels each way: scaled and turned about its middle, edge pixels repeated."""

    scale: float = 1.0
    turn_deg: float = 0.0


PLAIN = Glance()
SEARCH = (
    PLAIN,
    Glance(scale=0.8),
    Glance(scale=0.8, turn_deg=25),
    Glance(scale=0.8, turn_deg=-25),
    Glance(scale=0.6),
)


@dataclass(frozen=True, slots=True)
class Search:
    """How the next frame is looked at, and how many in a row before it showed no hand."""

    glance: Glance = PLAIN
    missing: int = 0


def after(search: Search, *, found: bool) -> Search:
    """The search after one more frame."""
    if found:
        return replace(search, missing=0)
    missing = search.missing + 1
    if missing < PATIENCE_FRAMES:
        return replace(search, missing=missing)
    return Search(SEARCH[(missing - PATIENCE_FRAMES) % len(SEARCH)], missing)


def glance_at(image_bgr: Image, glance: Glance) -> tuple[Image, FloatArray]:
    """The picture as the glance shows it, and the (2, 3) affine map from the picture's pixels to the glance's."""
    if glance == PLAIN:
        return image_bgr, np.eye(3)[:2]
    height, width = image_bgr.shape[:2]
    transform: FloatArray = cv2.getRotationMatrix2D((width / 2, height / 2), glance.turn_deg, glance.scale) / SHRUNK
    size = (width // SHRUNK, height // SHRUNK)
    shown = cv2.warpAffine(image_bgr, transform, size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(shown, dtype=np.uint8), transform


class Searcher:
    """Shows each frame to a tracker, `look`, and searches when it has lost the hand."""

    def __init__(self, look: Callable[[Image, int], tuple[Hand, ...]]) -> None:
        self._look = look
        self._search = Search()
        self._following = False

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        """The hands in the next frame, where its picture has them; () when there is none."""
        hands = self._glance(image_bgr, captured_ns)
        if not hands and self._following:
            hands = self._glance(image_bgr, captured_ns)
        self._following = bool(hands)
        self._search = after(self._search, found=self._following)
        return hands

    def _glance(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        shown, transform = glance_at(image_bgr, self._search.glance)
        hands = self._look(shown, captured_ns)
        return hands if shown is image_bgr else tuple(on_picture(hand, transform) for hand in hands)
