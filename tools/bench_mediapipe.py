"""What MediaPipe's hand landmarker costs by each option it has: image format, cores, delegate.

    python tools/bench_mediapipe.py [../shared/data/distance]

CPU time a frame, all threads, so that a busy machine distorts it less than wall time; what of it is the conversion of
the image; and how far the keypoints are from those of the way in use, as a share of the image. Its Python interface
has no option for threads.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import mediapipe as mp
import numpy as np
from mediapipe.tasks.python import BaseOptions
from mediapipe.tasks.python.vision import HandLandmarker, HandLandmarkerOptions, RunningMode

from app.evaluate.loop.frames import frames_for_speed
from app.system.config import load_config
from app.system.hand_model import find_model
from app.system.paths import find_home
from kgdfa.hand import FloatArray
from kgdfa.preprocess import Image

FRAMES, WARM_UP = 150, 10
FRAME_MS = 33
Convert = Callable[[Image], Any]
Delegate = BaseOptions.Delegate


def srgb(image: Image) -> Any:
    """As `kgdfa.keypoints` does."""
    return mp.Image(image_format=mp.ImageFormat.SRGB, data=cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


def srgba(image: Image) -> Any:
    """With an unused channel, which aligns pixels to four bytes."""
    return mp.Image(image_format=mp.ImageFormat.SRGBA, data=cv2.cvtColor(image, cv2.COLOR_BGR2RGBA))


# Name, conversion, delegate, whether on one core only.
WAYS: tuple[tuple[str, Convert, Any, bool], ...] = (
    ("in use", srgb, Delegate.CPU, False),
    ("SRGBA", srgba, Delegate.CPU, False),
    ("one core", srgb, Delegate.CPU, True),
    ("GPU delegate", srgb, Delegate.GPU, False),
)


def main() -> None:
    """A line for each way."""
    home = find_home(None)
    model = find_model(home, load_config(home.config)).read_bytes()
    with frames_for_speed(Path(sys.argv[1]) if len(sys.argv) > 1 else None, FRAMES) as recorded:
        images = recorded.images()
    cores = os.sched_getaffinity(0)
    reference: list[FloatArray | None] = []
    print("way           CPU ms  of it image  keypoints differ by")
    for name, convert, delegate, alone in WAYS:
        os.sched_setaffinity(0, {min(cores)} if alone else cores)
        try:
            cpu_ms, image_ms, found = timed(model, images, convert, delegate)
        except (RuntimeError, ValueError) as error:
            print(f"{name:12}  refused: {str(error).splitlines()[0][:80]}")
            continue
        reference = reference or found
        print(f"{name:12}  {cpu_ms:6.2f}  {image_ms:11.2f}  {difference(reference, found):.6f}")


def timed(
    model: bytes, images: list[Image], convert: Convert, delegate: Any
) -> tuple[float, float, list[FloatArray | None]]:
    """CPU ms a frame, of it in the conversion, and the keypoints (21, 2) of each frame."""
    base = BaseOptions(model_asset_buffer=model, delegate=delegate)
    found: list[FloatArray | None] = []
    begun_s = converting_s = 0.0
    with HandLandmarker.create_from_options(
        HandLandmarkerOptions(base_options=base, running_mode=RunningMode.VIDEO, num_hands=1)
    ) as landmarker:
        for number, image in enumerate(images):
            if number == WARM_UP:
                begun_s, converting_s = time.process_time(), 0.0
            before_s = time.thread_time()
            converted = convert(image)
            converting_s += time.thread_time() - before_s
            hands = landmarker.detect_for_video(converted, (number + 1) * FRAME_MS).hand_landmarks
            found.append(np.array([(point.x, point.y) for point in hands[0]]) if hands else None)
        spent_s = time.process_time() - begun_s
    counted = len(images) - WARM_UP
    return 1000 * spent_s / counted, 1000 * converting_s / counted, found


def difference(first: list[FloatArray | None], second: list[FloatArray | None]) -> float:
    """The largest; infinite where only one has a hand."""
    return max(
        0.0
        if one is None and other is None
        else float("inf")
        if one is None or other is None
        else float(np.abs(one - other).max())
        for one, other in zip(first, second, strict=True)
    )


if __name__ == "__main__":
    main()
