from __future__ import annotations

import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest

from kgdfa.augmentation import (
    AUGMENTATIONS,
    FALLBACK_AUGMENTATIONS,
    Augmentation,
    augment,
    detect_augmented,
    detect_photo,
)
from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.hand import Hand, Side
from kgdfa.preprocess import LARGEST_SIDE_PX, Image, as_bgr8, brighten, reduced
from tests.kgdfa.hands import drawn_hand


@pytest.mark.parametrize("shape", [(6, 5), (6, 5, 1), (6, 5, 3), (6, 5, 4)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_every_usual_image_becomes_eight_bit_colour(shape: tuple[int, ...], kind: type) -> None:
    full: np.ndarray = np.full(shape, np.iinfo(kind).max, dtype=kind)
    out = as_bgr8(full)
    assert out.shape == (6, 5, 3)
    assert out.dtype == np.uint8
    assert (out == 255).all()


@pytest.mark.parametrize(
    ("picture", "fault"),
    [
        (np.zeros((0, 5, 3), np.uint8), KgdfaFault.IMAGE_EMPTY),
        (np.zeros((5, 5, 2), np.uint8), KgdfaFault.IMAGE_CHANNELS),
        (np.zeros((5, 5, 3), np.float32), KgdfaFault.IMAGE_NUMBERS),
        (np.zeros(5, np.uint8), KgdfaFault.IMAGE_EMPTY),
    ],
)
def test_other_images_are_refused_by_name(picture: np.ndarray, fault: KgdfaFault) -> None:
    with pytest.raises(KgdfaError) as raised:
        as_bgr8(picture)
    assert raised.value.code is fault


class SpotDetector:
    """Finds the brightest spot and calls it the wrist of a drawn hand."""

    def __init__(self, *, blind: bool = False) -> None:
        self.blind = blind
        self.asked = 0

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        self.asked += 1
        if self.blind:
            return ()
        y, x = np.unravel_index(int(image_bgr[..., 0].argmax()), image_bgr.shape[:2])
        points = drawn_hand("ooooo", scale=0.1).image_px
        world = np.zeros((21, 3))
        world[8] = (0.05, 0.0, 0.0)
        return (Hand(image_px=points - points[0] + (x, y), world_m=world, presence=0.9, side=Side.LEFT),)


class TwoHands(SpotDetector):
    """Finds another hand so many reference segments beside, which is the larger one in every second image."""

    def __init__(self, apart: float) -> None:
        super().__init__()
        self.apart = apart

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        (hand,) = super().detect(image_bgr, captured_ns)
        larger = 0.5 if self.asked % 2 else 2.0
        points = (hand.image_px - hand.image_px[0]) * larger
        other = replace(hand, image_px=points + hand.image_px[0] + (self.apart * hand.reference_px, 0), presence=0.7)
        return (hand, other)


def spotted() -> Image:
    image = np.zeros((200, 160, 3), np.uint8)
    image[80:87, 50:57] = 255
    return image


@pytest.mark.parametrize("augmentation", [*AUGMENTATIONS, *FALLBACK_AUGMENTATIONS], ids=str)
def test_what_any_detection_finds_is_reported_on_the_image_itself(augmentation: Augmentation) -> None:
    hand = detect_augmented(SpotDetector(), spotted(), augmentation)
    assert hand is not None
    assert hand.image_px[0] == pytest.approx((53, 83), abs=4)


def test_a_mirrored_view_reports_the_other_side_and_mirrors_space() -> None:
    plain = detect_augmented(SpotDetector(), spotted(), Augmentation())
    mirrored = detect_augmented(SpotDetector(), spotted(), Augmentation(mirrored=True))
    assert plain is not None
    assert mirrored is not None
    assert (plain.side, mirrored.side) == (Side.LEFT, Side.RIGHT)
    assert mirrored.world_m[8, 0] == pytest.approx(-plain.world_m[8, 0])


@pytest.mark.parametrize("apart", [8.0, 2.4, 1.0])
def test_every_look_is_of_the_hand_that_the_plain_one_shows(apart: float) -> None:
    looks = detect_photo(TwoHands(apart), SpotDetector(), spotted())
    assert [hand.presence for hand in looks] == [0.9] * len(AUGMENTATIONS)


def test_second_detections_are_taken_only_where_the_first_is_empty() -> None:
    eager = SpotDetector()
    assert len(detect_photo(SpotDetector(), eager, spotted())) == len(AUGMENTATIONS)
    assert eager.asked == 0
    assert len(detect_photo(SpotDetector(blind=True), eager, spotted())) == 1
    assert eager.asked == 1
    assert detect_photo(SpotDetector(blind=True), SpotDetector(blind=True), spotted()) == ()


def test_a_view_has_its_stated_size() -> None:
    shown, transform = augment(spotted(), Augmentation(border=0.5, size_px=300))
    assert max(shown.shape[:2]) == 300
    assert transform.shape == (2, 3)


def augmented_whole(image: Image, augmentation: Augmentation) -> Image:
    """Border first, at the image's own size: what every photo went through before large ones were reduced."""
    image = brighten(image) if augmentation.brightened else image
    border = round(augmentation.border * max(image.shape[:2]))
    image = np.asarray(cv2.copyMakeBorder(image, border, border, border, border, cv2.BORDER_REPLICATE))
    scale = augmentation.size_px / max(image.shape[:2])
    smoothing = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=smoothing))
    height, width = image.shape[:2]
    if augmentation.turn_deg:
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), augmentation.turn_deg, 1)
        image = np.asarray(cv2.warpAffine(image, turn, (width, height), borderMode=cv2.BORDER_REPLICATE))
    return image[:, ::-1] if augmentation.mirrored else image


@pytest.mark.parametrize("shape", [(90, 64, 3), (720, 1280, 3), (1280, 961, 3)])
def test_photos_of_up_to_1280_pixels_are_augmented_as_they_always_were(shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    assert reduced(image) is image
    for augmentation in (*AUGMENTATIONS, *FALLBACK_AUGMENTATIONS):
        shown, transform = augment(image, augmentation)
        np.testing.assert_array_equal(shown, augmented_whole(image, augmentation))
        scale = augmentation.size_px / (max(shape) + 2 * round(augmentation.border * max(shape)))
        assert abs(np.linalg.det(transform[:, :2])) == pytest.approx(scale**2, rel=1e-12)


@pytest.mark.parametrize("augmentation", [*AUGMENTATIONS, *FALLBACK_AUGMENTATIONS], ids=str)
def test_what_is_found_in_a_reduced_photo_is_reported_on_the_photo_itself(augmentation: Augmentation) -> None:
    large = np.asarray(cv2.resize(spotted(), None, fx=15, fy=15, interpolation=cv2.INTER_NEAREST), np.uint8)
    hand = detect_augmented(SpotDetector(), large, augmentation)
    assert hand is not None
    assert hand.image_px[0] == pytest.approx((53 * 15, 83 * 15), abs=4 * 15)


def test_a_reduced_photo_keeps_its_shape() -> None:
    assert reduced(np.zeros((3000, 4000, 3), np.uint8)).shape == (960, LARGEST_SIDE_PX, 3)
    assert reduced(np.zeros((1, 1_000_000, 3), np.uint8)).shape == (1, LARGEST_SIDE_PX, 3)


@pytest.mark.parametrize("shape", [(3024, 4032, 3), (1_000_000, 1, 3)])
def test_a_large_photo_takes_no_more_memory_than_a_small_one(shape: tuple[int, ...]) -> None:
    photo = np.zeros(shape, np.uint8)
    tracemalloc.start()
    try:
        for augmentation in (*AUGMENTATIONS, *FALLBACK_AUGMENTATIONS):
            augment(photo, augmentation)
        assert tracemalloc.get_traced_memory()[1] < 100e6, "bytes"
    finally:
        tracemalloc.stop()
