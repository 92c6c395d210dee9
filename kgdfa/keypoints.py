"""MediaPipe's hand landmarker behind our own types: the one file that imports mediapipe.

The model is tracked from frame to frame (VIDEO mode); photos are detected one by one (`still=True`).
Asking the tracker for two hands while one is there runs its palm detector in every frame, twice the cost
(docs/decisions.md). So one hand is tracked. Only when it is new, and now and then until it is known to be the
enrolled one, is a second tracker asked for two; where there are two, that one goes on, until one is left.
"""

from __future__ import annotations

import os
import sys
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import mediapipe as mp
import numpy as np
from mediapipe.tasks.python import BaseOptions
from mediapipe.tasks.python.vision import HandLandmarker, HandLandmarkerOptions, RunningMode

from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.hand import FloatArray, Hand, Side, same_place
from kgdfa.preprocess import Image, as_bgr8
from kgdfa.redetection import Detection, Redetector, Shows

# MediaPipe 1.x names the person's own hand on an unmirrored image, as ours are (0.10 had them the other way round).
_SIDES = {"Left": Side.LEFT, "Right": Side.RIGHT}
SEEK_FRAMES = 5  # how often a second hand is searched for until the enrolled one is known
BLANK = np.zeros((64, 64, 3), np.uint8)
ALONE_FRAMES = 10  # with one hand in view until the tracker of one takes over again


class HandDetector:
    """Finds hands in images. Close it, or use `with`: as the interpreter ends, MediaPipe can't any more."""

    def __init__(
        self,
        model: Path,
        *,
        still: bool = False,
        max_hands: int = 1,
        min_detection: float = 0.5,
        min_presence: float = 0.5,
        watch_rivals: bool = False,
        search: bool = False,
    ) -> None:
        """Load the model. Raises KgdfaError when the file is missing or is no hand model.

        watch_rivals: look for a second hand whenever one is new or unknown. search: re-detect a lost hand in other
        views of the image (video only; see `redetection`).
        """
        self._still = still
        self._search = search and not still
        self._last_ms = -1
        self._begin()
        mode = RunningMode.IMAGE if still else RunningMode.VIDEO
        self._landmarker = _load(model, mode, max_hands, min_detection, min_presence)
        self._two_hands = _load(model, RunningMode.VIDEO, 2, 0.5, 0.5) if watch_rivals else None
        # What has tracked nothing detects at half the cost of a tracker that must forget first.
        self._untracked = _load(model, RunningMode.IMAGE, 1, 0.5, 0.5) if self._search else None
        self._beside = ThreadPoolExecutor(1, "untracked detection")  # its thread begins with the first detection
        loaded = [one for one in (self._landmarker, self._two_hands, self._untracked) if one is not None]
        self._free = weakref.finalize(self, _close_all, loaded, self._beside)

    def _begin(self) -> None:
        """No hand has been seen yet."""
        self._searcher = (
            Redetector(self._observed, self._ordered, self._begin_look, self._forget) if self._search else None
        )
        self._previous: tuple[Hand, ...] = ()
        self._unknown = False  # whether the hand in view is the enrolled one
        self._frames = 0
        self._alone_frames = ALONE_FRAMES

    def reset(self, captured_ns: int) -> None:
        """Forget every hand: the next frame is detected as the first one of a new detector would be."""
        self._begin()
        for tracker in () if self._still else (self._landmarker, self._two_hands):
            if tracker is not None:
                self._track(tracker, BLANK, captured_ns)

    def follow(self, hand: Hand | None, unknown: bool, sought: Shows | None) -> None:
        """Which of the hands just found commands, to be the next ones' first; unknown: another one may be enrolled.

        sought: the keypoints may be of a shape that the hand does not have; an untracked detection that shows this is
        believed. None: they are believed as they are.
        """
        self._unknown = unknown
        if self._searcher is not None:
            self._searcher.sought = sought
        if hand is not None:
            self._previous = (hand, *(other for other in self._previous if other is not hand))

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        """The hands in one image, the tracked one first; () when there is none.

        Raises KgdfaError for an image that can't be read (see `preprocess.as_bgr8`).
        """
        image = as_bgr8(image_bgr)
        hands = self._detect(image, captured_ns)
        if self._two_hands is not None:
            hands = self._with_second(image, captured_ns, hands)
        self._previous = hands
        return hands

    def close(self) -> None:
        """Free the model; harmless when done twice."""
        self._free()
        self._landmarker = self._two_hands = self._untracked = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def infer(self, image_bgr: Image, captured_ns: int = 0) -> Any:
        """MediaPipe's own result on one image, as it gives it: what `rleex evaluate speed` calls bare."""
        if self._landmarker is None:
            raise KgdfaError(KgdfaFault.DETECTOR_CLOSED)
        if self._still:
            return self._landmarker.detect(_as_mediapipe(image_bgr))
        return self._track(self._landmarker, image_bgr, captured_ns)

    def _track(self, landmarker: Any, image: Image, captured_ns: int) -> Any:
        self._last_ms = max(self._last_ms + 1, captured_ns // 1_000_000)  # MediaPipe wants growing time
        return landmarker.detect_for_video(_as_mediapipe(image), self._last_ms)

    def _detect(self, image: Image, captured_ns: int) -> tuple[Hand, ...]:
        if self._still:
            return self._observed(image, captured_ns)
        hands = (self._searcher.detect if self._searcher else self._observed)(image, captured_ns)
        first = self._previous[:1]  # tracked: found where the first one of the frame before was
        return tuple(replace(hand, tracked=any(same_place(hand, other) for other in first)) for hand in hands)

    def _observed(self, image: Image, captured_ns: int) -> tuple[Hand, ...]:
        one = self._alone_frames >= ALONE_FRAMES
        result = self.infer(image, captured_ns) if one else self._track(self._two_hands, image, captured_ns)
        return _hands(result, image)

    def _begin_look(self, image: Image) -> Detection:
        """Begin to detect the hand as if none were tracked, beside the tracker; () while two are."""
        if self._untracked is None or self._alone_frames < ALONE_FRAMES:
            return lambda: ()
        result = self._beside.submit(self._untracked.detect, _as_mediapipe(image)).result
        return lambda: _hands(result(), image)

    def _forget(self, captured_ns: int) -> None:
        """The tracker of one hand detects anew in the next frame: it loses what it follows in an empty one."""
        self._track(self._landmarker, BLANK, captured_ns)

    def _ordered(self, hands: tuple[Hand, ...]) -> tuple[Hand, ...]:
        """The one that is nearest to the first of the frame before in front."""
        if len(hands) < 2 or not self._previous:
            return hands
        first = self._previous[0].palm_centre_px
        return tuple(sorted(hands, key=lambda hand: float(np.linalg.norm(hand.palm_centre_px - first))))

    def _with_second(self, image: Image, captured_ns: int, hands: tuple[Hand, ...]) -> tuple[Hand, ...]:
        """Two hands where there are two: looked for while the first is new or unknown, tracked until one is left."""
        self._frames += 1
        if self._alone_frames < ALONE_FRAMES:
            self._alone_frames = 0 if len(hands) > 1 else self._alone_frames + 1
            return hands
        if not hands or (hands[0].tracked and not (self._unknown and self._frames % SEEK_FRAMES == 0)):
            return hands
        observed = _hands(self._track(self._two_hands, image, captured_ns), image)
        others = tuple(hand for hand in observed if not same_place(hand, hands[0]))
        if others:
            self._alone_frames = 0
        return hands + others[:1]


def live_detector(model: Path) -> HandDetector:
    """As before a camera: one hand followed, searched for where it is lost, a second one watched for."""
    return HandDetector(model, watch_rivals=True, search=True)


def _close_all(landmarkers: list[Any], beside: ThreadPoolExecutor) -> None:
    beside.shutdown()
    for landmarker in landmarkers:
        landmarker.close()


def _as_mediapipe(image: Image) -> Any:
    return mp.Image(image_format=mp.ImageFormat.SRGB, data=cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


def _hands(result: Any, image: Image) -> tuple[Hand, ...]:
    height, width = image.shape[:2]
    found = zip(result.hand_landmarks, result.hand_world_landmarks, result.handedness, strict=True)
    return tuple(
        Hand(
            image_px=_array(landmarks)[:, :2] * (width, height),
            world_m=_array(world),
            presence=side.score,
            side=_SIDES[side.category_name],
        )
        for landmarks, world, (side, *_) in found
    )


def _array(landmarks: Any) -> FloatArray:
    return np.array([(point.x, point.y, point.z) for point in landmarks], dtype=np.float64)


def _load(model: Path, mode: Any, hands: int, min_detection: float, min_presence: float) -> Any:
    if not model.is_file():
        raise KgdfaError(KgdfaFault.HAND_MODEL_MISSING, path=model)
    options = HandLandmarkerOptions(
        base_options=BaseOptions(model_asset_buffer=model.read_bytes()),
        running_mode=mode,
        num_hands=hands,
        min_hand_detection_confidence=min_detection,
        min_hand_presence_confidence=min_presence,
        min_tracking_confidence=min_presence,
    )
    blank = _as_mediapipe(np.zeros((64, 64, 3), np.uint8))
    try:
        with SILENCE:
            landmarker = HandLandmarker.create_from_options(options)
            # The first detection prints more and is slow: make it here.
            landmarker.detect(blank) if mode is RunningMode.IMAGE else landmarker.detect_for_video(blank, -1)
    except (RuntimeError, ValueError) as error:
        raise KgdfaError(KgdfaFault.HAND_MODEL_INVALID, path=model, detail=str(error)) from error
    return landmarker


class Silence:
    """Nothing leaves the process by file descriptor 2 while any thread is within.

    MediaPipe's C++ logs there whatever one asks of it, across the console's screen. The descriptor is the process's:
    threads that each kept and restored it would restore what another one had put there.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._within = 0
        self._kept = -1

    def __enter__(self) -> None:
        with self._lock:
            if self._within == 0:
                sys.stderr.flush()
                nowhere = os.open(os.devnull, os.O_WRONLY)
                self._kept = os.dup(2)
                os.dup2(nowhere, 2)
                os.close(nowhere)
            self._within += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._within -= 1
            if self._within == 0:
                os.dup2(self._kept, 2)
                os.close(self._kept)


SILENCE = Silence()
