"""The hands in a folder's images and in digital ones: detected with a bar, kept in a file of keypoints."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.common import check_replaced, show
from app.cli.evaluate.common import hand_model, progress
from app.evaluate.harness import EvaluateFault
from app.evaluate.readings import UNPREPARED, DetectedImage, LabelledImage, read_labels
from app.system.errors import AppError
from app.text.catalogue import tr
from kgdfa.preprocess import Prepare, as_bgr8, find_preparation

if TYPE_CHECKING:
    from collections.abc import Generator

    from app.evaluate.digital import LabelledScene

FIT_DIGITAL = 40  # digital hands a pose that a fit gets beside the images


def detected_images(
    directory: Path, keypoints: Path | None, home: Path | None, prepare: str = UNPREPARED
) -> list[DetectedImage]:
    """The hands in a folder's images: those that the keypoint file does not hold as they are now are detected.

    An interrupted detection keeps what it has, and the next one completes it. prepare: of PREPARATIONS. Raises AppError
    where no image can be read.
    """
    from app.evaluate.gestures.images import load_hands, save_hands, to_detect, unseen_image

    preparation, images = find_preparation(prepare), read_labels(directory)
    kept = load_hands(keypoints, images, prepare) if keypoints is not None and keypoints.exists() else None
    detected = [*map(unseen_image, images)] if kept is None else kept
    numbers = to_detect(detected, directory)
    if keypoints is not None and any(not (detected[k].error and detected[k].contents) for k in numbers):
        check_replaced(keypoints)  # before the work; what could not be read then will probably leave the file as it is
    found, changed = _found([images[k] for k in numbers], directory, home, preparation), 0
    try:
        for number, one in zip(numbers, found, strict=True):
            before, detected[number] = detected[number], one
            changed += (one.error, one.contents) != (before.error, before.contents)
    except KeyboardInterrupt:
        found.close()  # what is under way ends, the others are not begun
        if keypoints is not None and changed:
            save_hands(detected, keypoints, prepare)
            show(tr("evaluate.keypoints.kept", file=keypoints, done=changed, total=len(numbers)))
        raise
    if all(one.error for one in detected):
        raise AppError(EvaluateFault.IMAGE_UNREADABLE, file=images[0].path)
    if keypoints is not None and (changed or kept is None):
        save_hands(detected, keypoints, prepare)
    return detected


def _found(
    images: list[LabelledImage], directory: Path, home: Path | None, preparation: Prepare
) -> Generator[DetectedImage, None, None]:
    """The hands in these images, with a bar; without images no model is needed."""
    from app.evaluate.gestures.images import detect_images

    if images:
        with progress("detecting", len(images)) as step:
            for one in detect_images(images, directory, hand_model(home), preparation):
                yield one
                step()


def fitted_beside(directory: Path, keypoints: Path | None, home: Path | None) -> list[DetectedImage]:
    """The hands of a further folder, whose keypoints may lie in it."""
    own = directory / "keypoints.npz"
    return detected_images(directory, own if keypoints is None and own.exists() else keypoints, home)


def fitted_digital(home: Path | None, *keypoints: Path | None) -> list[DetectedImage]:
    """The digital hands that every fit gets, kept beside the first of these keypoint files that has them, or could."""
    from app.evaluate.digital import FIT_SEEDS, digital_scenes
    from app.evaluate.gestures.images import load_hands, save_hands
    from app.evaluate.gestures.synthetic import near_scenes

    scenes = [*digital_scenes(FIT_DIGITAL, FIT_SEEDS), *near_scenes()]
    files = [file.with_stem(file.stem + "-digital") for file in keypoints if file]
    file = next((file for file in files if file.exists()), files[0] if files else None)
    if file is not None and file.exists():
        return load_hands(file, [labelled for labelled, _, _ in scenes])
    detected = detected_scenes(scenes, home)
    if file is not None:
        save_hands(detected, file)
    return detected


def detected_scenes(scenes: list[LabelledScene], home: Path | None, prepare: Prepare = as_bgr8) -> list[DetectedImage]:
    from app.evaluate.digital import detect_digital

    with progress("digital", len(scenes)) as step:
        return detect_digital(hand_model(home), scenes, step, prepare)
