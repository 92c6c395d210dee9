"""What denoising, sharpening and brightening are worth: pictures are spoilt in known ways, prepared, and judged.

One plain look a picture by the shipped rules, so that the preparation is all that differs. Spoiling depends on the
picture's place in the list only, and so is the same for every preparation.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app.evaluate.digital_hands import digital_scenes, picture
from app.evaluate.gesture_judge import RobustJudge, judge_photo
from app.evaluate.gesture_measures import NONE, Judged
from app.evaluate.gesture_photos import Photo, SeenPhoto
from kgdfa.augmentation import AUGMENTATIONS, Augmentation, StillDetector, detect_augmented
from kgdfa.preprocess import PREPARATIONS, Image, Prepare, as_bgr8

Spoil = Callable[[Image, int], Image]

DARK_SHARE, DARK_SD = 0.12, 4.0  # of the light that is left, and the sensor's noise in what is left, grey levels
NOISE_SD = 28.0  # grey levels, as at the highest gain of a webcam
BLUR_SHARE = 0.06  # of the picture's longer side a moving hand is smeared over
TIMED_SHAPE, TIMED_RUNS = (720, 1280, 3), 15
_UNTURNED = Augmentation(border=0.0, size_px=1280)  # the digital hand has room around it


@dataclass(frozen=True, slots=True, kw_only=True)
class Worth:
    """Shares: of pictures with a hand, where one was found; of gestures, told right; of undefined, accepted."""

    spoilt: str
    prepared: str
    pictures: int
    found: float
    right: float
    accepted_undefined: float


def _as_it_is(image: Image, _seed: int) -> Image:
    return image


def _dark(image: Image, seed: int) -> Image:
    return _noisy(np.asarray(image, np.float32) * DARK_SHARE, seed, DARK_SD)


def _grainy(image: Image, seed: int) -> Image:
    return _noisy(np.asarray(image, np.float32), seed, NOISE_SD)


def _blurred(image: Image, seed: int) -> Image:
    """Smeared along a line in a direction of its own."""
    length = max(3, round(BLUR_SHARE * max(image.shape[:2])))
    angle = np.random.default_rng(seed).uniform(0, np.pi)
    kernel = np.zeros((length, length), np.float32)
    middle, reach = (length - 1) / 2, (length - 1) / 2 * np.array([np.cos(angle), np.sin(angle)])
    ends = [tuple(round(float(value)) for value in middle + sign * reach) for sign in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE), np.uint8)


def _noisy(image: NDArray[np.float32], seed: int, sd: float) -> Image:
    noise = np.random.default_rng(seed).normal(0, sd, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


SPOILS: dict[str, Spoil] = {"as it is": _as_it_is, "dark": _dark, "noise": _grainy, "blur": _blurred}


def photo_pictures(photos: Sequence[Photo], directory: Path) -> Iterator[tuple[Photo, Image, Augmentation]]:
    """Photos that can be read, and how to look at them."""
    for photo in photos:
        image = cv2.imread(str(directory / photo.path), cv2.IMREAD_UNCHANGED)
        if image is not None:
            yield photo, as_bgr8(image), AUGMENTATIONS[0]


def digital_pictures(per_pose: int, first_seed: int) -> Iterator[tuple[Photo, Image, Augmentation]]:
    """Digital hands, and how to look at them."""
    for photo, scene, seed in digital_scenes(per_pose, first_seed):
        yield photo, picture(scene, seed), _UNTURNED


def measure_worth(
    pictures: Iterator[tuple[Photo, Image, Augmentation]],
    detector: StillDetector,
    tell: Callable[[], None] = lambda: None,
) -> list[Worth]:
    """Every way to spoil with every preparation; `tell` is called after each picture."""
    judge = RobustJudge()
    judged: dict[tuple[str, str], list[Judged]] = {(bad, good): [] for bad in SPOILS for good in PREPARATIONS}
    for seed, (photo, image, how) in enumerate(pictures):
        for bad, spoil in SPOILS.items():
            spoilt = spoil(image, seed)
            for good, prepare in PREPARATIONS.items():
                hand = detect_augmented(detector, prepare(spoilt), how)
                hands = () if hand is None else (hand,)
                judged[bad, good].append(judge_photo(SeenPhoto(photo=photo, hands=hands), judge))
        tell()
    return [_worth(bad, good, some) for (bad, good), some in judged.items()]


def _worth(spoilt: str, prepared: str, judged: list[Judged]) -> Worth:
    with_hand = [one.detected for one in judged if one.photo.label != "none:nohand"]
    right = [one.said == one.truth for one in judged if one.truth != NONE]
    accepted = [one.said != NONE for one in judged if one.truth == NONE]
    return Worth(
        spoilt=spoilt,
        prepared=prepared,
        pictures=len(judged),
        found=_share(with_hand),
        right=_share(right),
        accepted_undefined=_share(accepted),
    )


def _share(values: list[bool]) -> float:
    return sum(values) / max(len(values), 1)


def cost_ms(prepare: Prepare) -> float:
    """What a preparation costs at 1280×720, the median of a few runs."""
    image = np.random.default_rng(0).integers(0, 255, TIMED_SHAPE, dtype=np.uint8)
    spent = []
    for _ in range(TIMED_RUNS):
        start = time.perf_counter()
        prepare(image)
        spent.append(1000 * (time.perf_counter() - start))
    return float(np.median(spent))
