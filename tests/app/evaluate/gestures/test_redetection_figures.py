"""The figures of re-detection: right, wrong and false hands are counted apart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.evaluate.gestures.redetection import (
    empty_rooms,
    images_without_hand,
    measure_near,
    measure_redetection,
    missed_hands,
    near_hands,
)
from app.evaluate.readings import GESTURE_NAMES, LabelledImage
from kgdfa.hand import Hand, Side
from kgdfa.preprocess import Image
from kgdfa.redetection import SOUGHT_PALM
from kgdfa.views import FULL_VIEW, NEAR_VIEWS, REDETECTION_VIEWS
from logs.reason import Reason
from tests.kgdfa.hands import drawn_points


class BrightSpot:
    """Finds a drawn hand, its wrist at the brightest spot, in images that have a really bright one."""

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        grey = image_bgr[..., 0]
        if grey.max() < 250:
            return ()
        y, x = np.unravel_index(int(grey.argmax()), grey.shape)
        points = drawn_points("ooooo")
        points = points - points[0] + (x, y)
        return (Hand(image_px=points, world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT),)


class Blind:
    """Finds nothing."""

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        return ()


def room(*, spot: bool) -> Image:
    image = np.full((720, 1280, 3), 90, np.uint8)
    if spot:
        image[398:403, 638:643] = 255
    return image


def test_hands_in_their_place_elsewhere_and_where_there_is_none_are_counted_apart() -> None:
    points = drawn_points("ooooo")
    there = points - points[0] + (640, 400)
    missed = [(room(spot=True), there), (room(spot=True), there + np.array([500, 0])), (room(spot=False), there)]
    measured = {one.view: one for one in measure_redetection(BrightSpot(), missed, [room(spot=True), room(spot=False)])}
    plain = measured[FULL_VIEW]
    assert (plain.right, plain.wrong) == (1, 1)
    assert (plain.false_hands, plain.empty) == (1, 2)
    assert list(measured) == list(REDETECTION_VIEWS)


def test_a_near_hand_is_sought_in_the_size_of_its_palm() -> None:
    points = drawn_points("ooooo")
    scale = SOUGHT_PALM * 720 / float(np.linalg.norm(points[9] - points[0]))
    sizes: list[int] = []

    class Eye:
        def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
            sizes.append(int(np.count_nonzero(image_bgr[..., 0] > 200)))
            return ()

    square = np.zeros((720, 1280, 3), np.uint8)
    square[310:410, 590:690] = 255
    figures = measure_near(Eye(), [(square, points)], [])
    assert len(figures) == 3 + len(NEAR_VIEWS)
    assert sizes[0] == pytest.approx((100 * min(1.0, scale) / (1 if scale >= 1 else 2)) ** 2, rel=0.1)


def test_near_hands_are_gestures_as_near_as_a_push() -> None:
    near = near_hands(1, 20_000)
    assert len(near) == len(GESTURE_NAMES)
    palms_px = [float(np.linalg.norm(truth[9] - truth[0])) for _, truth in near]
    assert min(palms_px) > 200


def test_every_digital_hand_is_missed_by_the_blind_and_its_rooms_are_empty_without_it() -> None:
    steps = []
    missed = missed_hands(Blind(), 1, 20_000, lambda: steps.append(1))
    assert len(missed) == len(steps) > 12
    (empty,) = empty_rooms(1, 20_000)
    assert all((image != empty).any() for image, _ in missed)


def test_only_readable_images_without_a_hand_are_taken(tmp_path: Path) -> None:
    for name in ("room.png", "hand.png"):
        cv2.imwrite(str(tmp_path / name), room(spot=False)[:20, :20])
    labels = {"room.png": "none:nohand", "hand.png": "5", "gone.png": "none:nohand"}
    images = [LabelledImage(path=path, label=label, source="s", group="g") for path, label in labels.items()]
    unreadable: dict[str, Reason] = {}
    assert [image.shape for image in images_without_hand(images, tmp_path, unreadable)] == [(20, 20, 3)]
    assert list(unreadable) == ["gone.png"]


def test_images_without_a_hand_are_held_one_at_a_time_and_reduced(tmp_path: Path) -> None:
    read: list[str] = []

    def listed() -> Iterator[LabelledImage]:
        for number in range(3):
            read.append(f"{number}.png")
            cv2.imwrite(str(tmp_path / read[-1]), np.zeros((40, 2560, 3), np.uint8))
            yield LabelledImage(path=read[-1], label="none:nohand")

    images = images_without_hand(listed(), tmp_path, {})
    assert next(images).shape == (20, 1280, 3)
    assert read == ["0.png"]
    (first, *_) = measure_redetection(Blind(), [], images)
    assert (first.empty, first.false_hands) == (2, 0)
