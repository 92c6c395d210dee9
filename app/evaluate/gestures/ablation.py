"""What preprocessing wins on degraded images, and what it costs.

Images are degraded in known ways, prepared, and classified in one plain view by the shipped rules, so that the
preparation is all that differs. Degradation depends on the image's place in the list only, and so is the same for
every preparation.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from app.evaluate.digital import digital_scenes, image_of_scene
from app.evaluate.gestures.images import classify_image, robust_classifier
from app.evaluate.gestures.measures import NONE, Classified
from app.evaluate.harness import EvaluateFault, Step, mean, percent, table
from app.evaluate.readings import NO_HAND, DetectedImage, LabelledImage, read_images
from app.system.errors import AppError
from app.text.catalogue import tr
from kgdfa.augmentation import AUGMENTATIONS, Augmentation, StillDetector, detect_augmented
from kgdfa.preprocess import PREPARATIONS, Image
from kgdfa.robust import RobustRules
from logs.reason import Reason

DARK_SHARE, DARK_SD = 0.12, 4.0  # of the light that is left, and the sensor's noise in what is left, grey levels
NOISE_SD = 28.0  # grey levels, as at the highest gain of a webcam
BLUR_SHARE = 0.06  # of the image's longer side a moving hand is smeared over
TIMED_RUNS = 15
_UNTURNED = Augmentation(border=0.0, size_px=1280)  # the digital hand has room around it


def cost_ms(work: Callable[[Image], object]) -> float:
    """Milliseconds on an image of 1280×720, the median of a few runs."""
    image = np.random.default_rng(0).integers(0, 255, (720, 1280, 3), dtype=np.uint8)
    spent = []
    for _ in range(TIMED_RUNS):
        start = time.perf_counter()
        work(image)
        spent.append(1000 * (time.perf_counter() - start))
    return float(np.median(spent))


Degradation = Callable[[Image, int], Image]


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparationFigures:
    """Shares: of images with a hand, where one was found; of gestures, classified right; of undefined, accepted.

    None: of nothing.
    """

    degraded: str
    prepared: str
    images: int
    found: float | None
    right: float | None
    accepted_undefined: float | None


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


DEGRADATIONS: dict[str, Degradation] = {"none": _as_it_is, "dark": _dark, "noise": _grainy, "blur": _blurred}


def photos(
    images: Sequence[LabelledImage], directory: Path, unreadable: dict[str, Reason]
) -> Iterator[tuple[LabelledImage, Image, Augmentation]]:
    """Image files that can be read, and the view to take; the others are added to `unreadable`.

    Raises AppError at the end where none can be read.
    """
    any_read = False
    for labelled, image in read_images(images, directory, unreadable):
        any_read = True
        yield labelled, image, AUGMENTATIONS[0]
    if not any_read:
        raise AppError(EvaluateFault.IMAGE_UNREADABLE, file=images[0].path)


def digital_images(per_pose: int, first_seed: int) -> Iterator[tuple[LabelledImage, Image, Augmentation]]:
    """Digital hands, and the view to take."""
    for labelled, scene, seed in digital_scenes(per_pose, first_seed):
        yield labelled, image_of_scene(scene, seed), _UNTURNED


def measure_preparations(
    images: Iterator[tuple[LabelledImage, Image, Augmentation]], detector: StillDetector, step: Step = lambda: None
) -> list[PreparationFigures]:
    """Every degradation with every preparation; `step` is called after each image."""
    classifier = robust_classifier(RobustRules())
    classified: dict[tuple[str, str], list[Classified]] = {
        (bad, good): [] for bad in DEGRADATIONS for good in PREPARATIONS
    }
    for seed, (labelled, image, view) in enumerate(images):
        for bad, degrade in DEGRADATIONS.items():
            degraded = degrade(image, seed)
            for good, prepare in PREPARATIONS.items():
                hand = detect_augmented(detector, prepare(degraded), view)
                hands = () if hand is None else (hand,)
                classified[bad, good].append(classify_image(DetectedImage(image=labelled, hands=hands), classifier))
        step()
    return [_prepared(bad, good, some) for (bad, good), some in classified.items()]


def preparation_costs() -> dict[str, float]:
    """Milliseconds that each preparation costs at 1280×720."""
    return {name: cost_ms(prepare) for name, prepare in PREPARATIONS.items()}


def preparation_table(measured: Sequence[PreparationFigures], costs_ms: dict[str, float]) -> Table:
    """A row a degradation and preparation."""
    rows = [
        (
            tr(f"evaluate.degraded.{one.degraded}"),
            one.prepared,
            *map(percent, (one.found, one.right, one.accepted_undefined)),
            f"{costs_ms[one.prepared]:.1f}",
        )
        for one in measured
    ]
    columns = "images prepared hand_found gestures_right undefined_accepted ms"
    return table("preparation", columns, rows, left=2, images=measured[0].images)


def _prepared(degraded: str, prepared: str, classified: list[Classified]) -> PreparationFigures:
    return PreparationFigures(
        degraded=degraded,
        prepared=prepared,
        images=len(classified),
        found=mean(one.detected for one in classified if one.image.label != NO_HAND),
        right=mean(one.predicted == one.truth for one in classified if one.truth != NONE),
        accepted_undefined=mean(one.predicted != NONE for one in classified if one.truth == NONE),
    )
