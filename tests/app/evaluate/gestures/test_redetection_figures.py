"""The figures of re-detection: right, wrong and false hands are counted apart."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from app.evaluate.gestures.ablation import empty_rooms, images_without_hand, measure_redetection, missed_hands
from app.evaluate.readings import LabelledImage
from kgdfa.hand import Hand, Side
from kgdfa.preprocess import Image
from kgdfa.redetection import FULL_VIEW, REDETECTION_VIEWS
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
    assert plain.false_hands == 1
    assert list(measured) == list(REDETECTION_VIEWS)


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
    assert len(images_without_hand(images, tmp_path)) == 1
