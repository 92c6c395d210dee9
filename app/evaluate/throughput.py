"""How many frames a second the whole chain does offline, when so many processes each take a recording of their own.

One recording can't be shared out: tracking, vote and button go from frame to frame. A lab has many recordings, and
for those the machine's cores count. The figure of one worker is the single process's, by the same clock.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Barrier, BrokenBarrierError

import cv2

from app.evaluate.sequence import PERIOD_NS, pictures, read_frames
from app.evaluate.speed import REFERENCE_M, THRESHOLD_M, WARM_UP
from app.system.errors import AppError
from kgdfa.button import ButtonPlace
from kgdfa.pipeline import Picture, Pipeline
from kgdfa.preprocess import AsNeeded, Image
from kgdfa.robust import RobustRules
from kgdfa.robust_distance import RobustRange

START_S = 300.0  # within which every worker must have read its frames and loaded its model


@dataclass(frozen=True, slots=True, kw_only=True)
class Throughput:
    """workers processes looked at `frames` frames altogether, at `fps` a second."""

    workers: int
    frames: int
    fps: float


def frames_for_speed(directory: Path | None, count: int) -> tuple[list[Image], float]:
    """Pictures and focal length: of a recording, or of the digital hand showing one gesture after the other."""
    if directory is not None:
        listed = read_frames(directory)[:count]
        return list(pictures(listed)), listed[0].focal_px
    from hal.cameras.digital_hand.driver import DigitalHandCamera
    from hal.cameras.digital_hand.skeleton import GESTURES

    camera = DigitalHandCamera(clock_ns=lambda: 0)
    images = []
    for number in range(count):
        if number % 25 == 0:
            camera.command(gesture=GESTURES[number // 25 % len(GESTURES)].name, at_ns=number * PERIOD_NS)
        images.append(camera.render((number + 1) * PERIOD_NS).image_bgr)
    return images, camera.lens.fx_px


def worker_counts(workers: int | None) -> list[int]:
    """How many processes at once are timed: one, and so many; None: as many as this process has cores; 0: none."""
    most = len(os.sched_getaffinity(0)) if workers is None else workers
    return sorted({1, most}) if most else []


def measure_throughput(directory: Path | None, count: int, model: Path, workers: int) -> Throughput:
    """`workers` processes at once, each over `count` frames. Raises AppError when one of them can't begin."""
    context = multiprocessing.get_context("spawn")
    with context.Manager() as manager, ProcessPoolExecutor(workers, mp_context=context) as pool:
        barrier = manager.Barrier(workers)
        futures = [pool.submit(_run, directory, count, model, barrier) for _ in range(workers)]
        runs = [future.result() for future in futures]
    frames = sum(seen for seen, _, _ in runs)
    spent_s = max(end for _, _, end in runs) - min(start for _, start, _ in runs)
    return Throughput(workers=workers, frames=frames, fps=frames / spent_s)


def _run(directory: Path | None, count: int, model: Path, together: Barrier) -> tuple[int, float, float]:
    """Frames looked at, and when: from and to, by the machine's monotonic clock, which all processes share."""
    from kgdfa.keypoints import live_detector

    cv2.setNumThreads(1)
    images, focal_px = frames_for_speed(directory, count)
    height, width = images[0].shape[:2]
    place = ButtonPlace.in_the_middle(width, height, THRESHOLD_M)
    with live_detector(model) as detector:
        finder = RobustRange(focal_px=focal_px, reference_m=REFERENCE_M)
        pipeline = Pipeline(
            detector=detector, rules=RobustRules(), range_finder=finder, place=place, prepare=AsNeeded()
        )
        start_s = 0.0
        for number, image in enumerate([*images[:WARM_UP], *images]):
            if number == min(WARM_UP, len(images)):
                _wait_for_the_others(together)
                start_s = time.monotonic()
            pipeline.process(Picture(image_bgr=image, captured_ns=(number + 1) * PERIOD_NS))
        return len(images), start_s, time.monotonic()


def _wait_for_the_others(together: Barrier) -> None:
    try:
        together.wait(START_S)
    except BrokenBarrierError as error:
        raise AppError(f"A worker did not begin within {START_S:.0f} s: take fewer workers or frames.") from error
