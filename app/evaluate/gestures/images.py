"""Hands in labelled images: detected in every view, kept in a file, classified by both rule sets as they ship."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from app.evaluate.gestures.measures import Classified
from app.evaluate.harness import EvaluateFault, write_whole
from app.evaluate.readings import (
    GESTURE_NAMES,
    NO_MEMORY,
    UNPREPARED,
    DetectedImage,
    LabelledImage,
    read_image,
    unreadable_image,
)
from app.system.errors import AppError
from kgdfa.augmentation import FALLBACK_THRESHOLD, StillDetector, detect_photo
from kgdfa.errors import KgdfaError
from kgdfa.gesture import Verdict
from kgdfa.hand import FloatArray, Hand, Side
from kgdfa.preprocess import Prepare, as_bgr8
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustRules
from logs.reading.arrays import check_finite, read_arrays
from logs.reading.errors import cause_of
from logs.reading.regular import MAX_IMAGE, read_bytes
from logs.reason import Reason, reason, reason_of


def unseen_image(labelled: LabelledImage) -> DetectedImage:
    """One that was not detected yet: in a keypoint file it is the same as one that was missing."""
    return DetectedImage(image=labelled, hands=(), error=unreadable_image(labelled))


def contents_of(file: Path) -> str:
    """SHA-256 of a photo's file; empty where none can be read. Its time would change with every copy."""
    try:
        return sha256(read_bytes(file, MAX_IMAGE)).hexdigest()
    except OSError:
        return ""


def to_detect(kept: Sequence[DetectedImage], directory: Path) -> list[int]:
    """Which of these images to detect: files that are there, and had an error or other contents when they were kept.

    Of those that are not there the kept keypoints count: photos may stay with the people they show. Older keypoint
    files know no contents.
    """

    def is_outdated(one: DetectedImage) -> bool:
        file = directory / one.image.path
        if one.error:
            return os.path.isfile(file)  # noqa: PTH113  # False too for a name that no file system takes
        return bool(one.contents) and contents_of(file) not in ("", one.contents)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return [number for number, outdated in enumerate(pool.map(is_outdated, kept)) if outdated]


def detect_images(
    images: Sequence[LabelledImage], directory: Path, model: Path, prepare: Prepare = as_bgr8
) -> Iterator[DetectedImage]:
    """The hands in every view of every image, in order. Each thread has its detectors."""
    from kgdfa.keypoints import HandDetector

    own, closing = threading.local(), ExitStack()  # MediaPipe's detectors can't be left to the interpreter's end

    def detectors() -> tuple[StillDetector, StillDetector]:
        if not hasattr(own, "pair"):
            low = FALLBACK_THRESHOLD
            plain = HandDetector(model, still=True, max_hands=2)
            sensitive = HandDetector(model, still=True, max_hands=2, min_detection=low, min_presence=low)
            own.pair = closing.enter_context(plain), closing.enter_context(sensitive)
        pair: tuple[StillDetector, StillDetector] = own.pair
        return pair

    def detect(labelled: LabelledImage) -> DetectedImage:
        contents = contents_of(directory / labelled.path)  # before it is read: one replaced now differs the next time
        image = read_image(labelled, directory)
        if isinstance(image, Reason):
            return DetectedImage(image=labelled, hands=(), error=image, contents=contents)
        plain, sensitive = detectors()
        try:
            hands, error = detect_photo(plain, sensitive, prepare(image)), None
        except KgdfaError as failed:
            hands, error = (), reason_of(failed)
        except NO_MEMORY:
            hands, error = (), unreadable_image(labelled)
        return DetectedImage(image=labelled, hands=hands, error=error, contents=contents)

    with closing, ThreadPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(detect, images)


def save_hands(detected: Sequence[DetectedImage], path: Path, prepare: str = UNPREPARED) -> None:
    """Write every image's hands as a compressed npz. Raises AppError when it can't be written.

    prepare: the name of the preprocessing before detection.
    """
    hands = [(number, hand) for number, one in enumerate(detected) for hand in one.hands]
    content = io.BytesIO()
    np.savez_compressed(
        content,
        prepare=np.array([prepare]),
        images=np.array([[*msgspec.to_builtins(one.image).values(), _encoded(one.error)] for one in detected]),
        contents=np.array([one.contents for one in detected], dtype=np.str_),
        owner=np.array([number for number, _ in hands], dtype=np.int64),
        image_px=np.array([hand.image_px for _, hand in hands], dtype=np.float32).reshape(-1, 21, 2),
        world_m=np.array([hand.world_m for _, hand in hands], dtype=np.float32).reshape(-1, 21, 3),
        presence=np.array([hand.presence for _, hand in hands]),
        side=np.array([hand.side.value for _, hand in hands], dtype="U5"),
    )
    write_whole(path, content.getvalue())


def load_hands(path: Path, images: Sequence[LabelledImage], prepare: str = UNPREPARED) -> list[DetectedImage]:
    """What `save_hands` wrote. Raises AppError when it is no such file, or of other images or another preprocessing."""
    try:
        arrays = read_arrays(path)
        detected, prepared = _stored_images(arrays), str(arrays.get("prepare", [UNPREPARED])[0])
    except (OSError, ValueError, KeyError, IndexError, TypeError, msgspec.MsgspecError) as error:
        raise AppError(EvaluateFault.KEYPOINTS_UNREADABLE, file=path, detail=cause_of(error)) from error
    if [one.image for one in detected] != [*images] or prepared != prepare:
        raise AppError(EvaluateFault.KEYPOINTS_OF_OTHERS, file=path)
    return detected


def _encoded(error: Reason | None) -> str:
    return msgspec.json.encode(error).decode() if error else ""


def _decoded(error: str, path: str) -> Reason | None:
    if error and not error.startswith("{"):  # files of 0.1 keep it as text
        return reason(EvaluateFault.IMAGE_UNREADABLE, file=path)
    return msgspec.json.decode(error, type=Reason) if error else None


def _stored_images(file: dict[str, NDArray[Any]]) -> list[DetectedImage]:
    count = len(file["owner"])
    if file["image_px"].shape != (count, 21, 2) or file["world_m"].shape != (count, 21, 3):
        raise ValueError("keypoints of another shape")
    check_finite({name: file[name] for name in ("image_px", "world_m", "presence")})
    listed = file["images"] if "images" in file else file["photos"]  # their name in files of 0.1
    contents = file.get("contents", np.full(len(listed), ""))  # older files have none
    hands: list[list[Hand]] = [[] for _ in listed]
    rows = zip(file["owner"], file["image_px"], file["world_m"], file["presence"], file["side"], strict=True)
    for owner, image_px, world_m, presence, side in rows:
        hands[owner].append(
            Hand(
                image_px=image_px.astype(np.float64),
                world_m=world_m.astype(np.float64),
                presence=float(presence),
                side=Side(str(side)),
            )
        )
    return [
        DetectedImage(
            image=LabelledImage(path=str(path), label=str(label), source=str(source), group=str(group)),
            hands=tuple(own),
            error=_decoded(str(error), str(path)),
            contents=str(content),
        )
        for (path, label, source, group, error), own, content in zip(listed, hands, contents, strict=True)
    ]


# From the hands that an image's views gave, at least one, the plain view's first: the verdict, and the confidence in
# each gesture, (12,).
ImageClassifier = Callable[[Sequence[Hand]], tuple[Verdict, FloatArray]]


def published_classifier() -> ImageClassifier:
    """The paper's rules on the plain view alone: they give no confidence that could be averaged."""
    rules = PublishedRules()
    return lambda hands: (rules.classify(hands[0]), rules.predict_proba(hands[0]))


def robust_classifier(rules: RobustRules, *, views: int | None = None) -> ImageClassifier:
    """The robust rules with test-time augmentation: the mean confidence over the first `views` (all, if None)."""
    return lambda hands: rules.classify_augmented(hands[:views])


def classify_all(detected: Sequence[DetectedImage], classifier: ImageClassifier) -> list[Classified]:
    """Every image classified; one without a hand is none, with no confidence in anything."""
    return [classify_image(one, classifier) for one in detected]


def classify_image(one: DetectedImage, classifier: ImageClassifier) -> Classified:
    """One image classified."""
    if not one.hands:
        nothing = np.zeros(len(GESTURE_NAMES))
        return Classified(image=one.image, detected=False, verdict=None, scores=nothing, readable=one.error is None)
    verdict, scores = classifier(one.hands)
    return Classified(image=one.image, detected=True, verdict=verdict, scores=scores)


def classify_as_shipped(detected: Sequence[DetectedImage], *, views: int | None = None) -> dict[str, list[Classified]]:
    """Both rule sets as the program runs them."""
    return {
        PublishedRules.name: classify_all(detected, published_classifier()),
        RobustRules.name: classify_all(detected, robust_classifier(RobustRules(), views=views)),
    }
