"""What each glance of the search wins: hands that the plain picture missed; and what it costs: time, false hands."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from app.evaluate.digital_hands import digital_scenes, picture
from app.evaluate.gesture_photos import Photo
from hal.cameras.digital_hand.render import keypoints_m, project_px
from kgdfa.augmentation import StillDetector, to_image
from kgdfa.hand import FloatArray, Hand
from kgdfa.preprocess import Image, as_bgr8
from kgdfa.redetection import REDETECTION_VIEWS, View, render_view

NO_HAND = "none:nohand"
EDGE_ON = 0.6  # a palm seen edge on is taken to be this share of its length wide
RIGHT_ANCHORS = 0.35  # keypoints off by more than this on average, in palm anchors, are not of that hand
TIMED_RUNS = 15


@dataclass(frozen=True, slots=True, kw_only=True)
class GlanceWorth:
    """One glance: right and wrong hands among the pictures that the plain one missed, hands where there is none."""

    view: View
    right: int
    wrong: int
    false_hands: int
    cost_ms: float


def missed_hands(
    detector: StillDetector, per_pose: int, first_seed: int, tell: Callable[[], None]
) -> list[tuple[Image, FloatArray]]:
    """Pictures of digital hands that the plain look misses, with their true keypoints, (21, 2) px."""
    missed = []
    for _, scene, seed in digital_scenes(per_pose, first_seed):
        image, joints = picture(scene, seed), keypoints_m(scene)
        if joints is not None and not detector.detect(image):
            missed.append((image, project_px(joints, scene.lens)))
        tell()
    return missed


def empty_rooms(count: int, first_seed: int) -> list[Image]:
    """Digital rooms that the hand has left."""
    scenes = (scene for _, scene, _ in digital_scenes(count, first_seed))
    by_room = {scene.person.room_seed: scene for scene in scenes}
    return [picture(replace(scene, place=None), 0) for scene in by_room.values()]


def photos_without_hand(photos: Iterable[Photo], directory: Path) -> list[Image]:
    """The photos labelled as showing none, those that can be read."""
    read = (cv2.imread(str(directory / photo.path)) for photo in photos if photo.label == NO_HAND)
    return [as_bgr8(image) for image in read if image is not None]


def measure_glances(
    detector: StillDetector, missed: list[tuple[Image, FloatArray]], empty: list[Image]
) -> list[GlanceWorth]:
    """Each glance of the search, in its order; the plain one, which is among them, finds none of the missed."""
    return [_worth(detector, view, missed, empty) for view in REDETECTION_VIEWS]


def _worth(
    detector: StillDetector, view: View, missed: list[tuple[Image, FloatArray]], empty: list[Image]
) -> GlanceWorth:
    errors = [_error(hand, truth) for image, truth in missed if (hand := _detected_in_view(detector, image, view))]
    return GlanceWorth(
        view=view,
        right=sum(error < RIGHT_ANCHORS for error in errors),
        wrong=sum(error >= RIGHT_ANCHORS for error in errors),
        false_hands=sum(_detected_in_view(detector, image, view) is not None for image in empty),
        cost_ms=_cost_ms(view),
    )


def _detected_in_view(detector: StillDetector, image: Image, view: View) -> Hand | None:
    shown, transform = render_view(image, view)
    hands = detector.detect(shown)
    return to_image(hands[0], transform) if hands else None


def _error(hand: Hand, truth_px: FloatArray) -> float:
    """Mean distance of the keypoints from where they are, in palm anchors."""
    across, along = (float(np.linalg.norm(truth_px[a] - truth_px[b])) for a, b in ((5, 17), (0, 9)))
    return float(np.linalg.norm(hand.image_px - truth_px, axis=1).mean()) / max(across, EDGE_ON * along)


def _cost_ms(view: View) -> float:
    image = np.random.default_rng(0).integers(0, 255, (720, 1280, 3), dtype=np.uint8)
    spent = []
    for _ in range(TIMED_RUNS):
        start = time.perf_counter()
        render_view(image, view)
        spent.append(1000 * (time.perf_counter() - start))
    return float(np.median(spent))
