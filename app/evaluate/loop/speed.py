"""Table 4's row: the whole pipeline's speed beside bare MediaPipe's, on the same frames in the same run.

Each frame goes through both, one after the other, so that whatever else the machine does slows both alike. The
ratio is the one of sums; the stages are timed inside the pipeline.

Throughput: frames per second offline, when so many processes each take a recording of their own. One recording can't be
shared out: tracking, vote and button go from frame to frame. The figure of one worker is by the same clock.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Barrier, BrokenBarrierError
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
from rich.table import Table

from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, table
from app.evaluate.readings import images_of, read_frames
from app.perception.reporting import PreviewPacer
from app.system.errors import AppError
from app.text.catalogue import tr
from kgdfa.button import ButtonPlace
from kgdfa.draw import draw
from kgdfa.pipeline import Pipeline, PipelineInput
from kgdfa.preprocess import AsNeeded, Image
from kgdfa.robust import RobustRules
from kgdfa.robust_distance import RobustRange

if TYPE_CHECKING:
    from kgdfa.keypoints import HandDetector

Result = TypeVar("Result")
WARM_UP = 15  # frames before the clock runs
START_S = 300.0  # within which every worker must have read its frames and loaded its model
REFERENCE_M, THRESHOLD_M = 0.065, 0.20  # of a usual palm, and the paper's: neither costs time


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedFigures:
    """Milliseconds a frame; `ratio` of the whole pipeline to bare MediaPipe. stages_ms: by their keys."""

    frames: int
    hands: int
    bare_ms: float
    whole_ms: float
    ratio: float
    fps: float
    stages_ms: dict[str, float]


class Stopwatch:
    """Adds up the time spent under each name."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = defaultdict(float)

    @contextmanager
    def running(self, name: str) -> Iterator[None]:
        """Count the time within."""
        start = time.perf_counter()
        yield
        self.spent_s[name] += time.perf_counter() - start

    def timed(self, name: str, work: Callable[..., Result]) -> Callable[..., Result]:
        """The same work, counted under a name."""

        def run(*args: Any) -> Result:
            with self.running(name):
                return work(*args)

        return run


def _timed_pipeline(detector: HandDetector, focal_px: float, place: ButtonPlace, watch: Stopwatch) -> Pipeline:
    """The whole pipeline with each stage timed."""
    rules, finder = RobustRules(), RobustRange(focal_px=focal_px, reference_m=REFERENCE_M)
    parts: dict[str, Any] = {
        "detector": SimpleNamespace(detect=watch.timed("keypoints", detector.detect)),
        "rules": SimpleNamespace(
            name=rules.name, classify=watch.timed("rules", rules.classify), predict_proba=rules.predict_proba
        ),
        "range_finder": SimpleNamespace(
            name=finder.name, measure=watch.timed("distance", finder.measure), reset=finder.reset
        ),
        "prepare": watch.timed("preprocessing", AsNeeded()),
    }
    return Pipeline(place=place, **parts)


def measure_speed(images: list[Image], model: Path, *, focal_px: float, step: Step = lambda: None) -> SpeedFigures:
    """Both over the same frames, at 30 frames per second of their own time."""
    from kgdfa.keypoints import HandDetector, live_detector

    watch, hands, preview = Stopwatch(), 0, PreviewPacer()
    height, width = images[0].shape[:2]
    place = ButtonPlace.in_the_middle(width, height, THRESHOLD_M)
    with HandDetector(model) as bare, live_detector(model) as detector:
        pipeline = _timed_pipeline(detector, focal_px, place, watch)
        for number, image in enumerate([*images[:WARM_UP], *images]):
            if number == WARM_UP:
                watch.spent_s.clear()
                hands = 0
            now_ns = (number + 1) * FRAME_NS
            if number % 2:
                _run_bare(bare, image, now_ns, watch)
            with watch.running("whole"):
                report = pipeline.process(PipelineInput(image_bgr=image, captured_ns=now_ns))
            if not number % 2:
                _run_bare(bare, image, now_ns, watch)
            hands += report.hand is not None
            with watch.running("drawing"):
                preview.message(image, now_ns, lambda shown, scale: draw(shown, report, place, scale))  # noqa: B023
            step()
    return _figures(watch, len(images), hands)


def _run_bare(bare: Any, image: Image, now_ns: int, watch: Stopwatch) -> None:
    """First on every other frame: whichever is second finds the image in the cache."""
    with watch.running("bare"):
        bare.infer(image, now_ns)


def _figures(watch: Stopwatch, frames: int, hands: int) -> SpeedFigures:
    spent_ms = {name: 1000 * seconds / frames for name, seconds in watch.spent_s.items()}
    bare_ms, whole_ms = spent_ms.pop("bare"), spent_ms.pop("whole")
    inside = sum(ms for name, ms in spent_ms.items() if name != "drawing")
    spent_ms["rest"] = whole_ms - inside
    return SpeedFigures(
        frames=frames,
        hands=hands,
        bare_ms=bare_ms,
        whole_ms=whole_ms,
        ratio=whole_ms / bare_ms,
        fps=1000 / whole_ms,
        stages_ms=spent_ms,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Throughput:
    """`workers` processes took `frames` frames altogether, at `fps` a second."""

    workers: int
    frames: int
    fps: float


def frames_for_speed(directory: Path | None, count: int) -> tuple[list[Image], float]:
    """Images and focal length: of a recording, or of the digital hand showing one gesture after the other."""
    if directory is not None:
        listed = read_frames(directory)[:count]
        return list(images_of(listed)), listed[0].focal_px
    from hal.cameras.digital_hand.driver import DigitalHandCamera
    from hal.cameras.digital_hand.skeleton import GESTURES

    camera = DigitalHandCamera(clock_ns=lambda: 0)
    images = []
    for number in range(count):
        if number % 25 == 0:
            camera.command(gesture=GESTURES[number // 25 % len(GESTURES)].name, at_ns=number * FRAME_NS)
        images.append(camera.render((number + 1) * FRAME_NS).image_bgr)
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
    frames = sum(observed for observed, _, _ in runs)
    spent_s = max(end for _, _, end in runs) - min(start for _, start, _ in runs)
    return Throughput(workers=workers, frames=frames, fps=frames / spent_s)


def _run(directory: Path | None, count: int, model: Path, together: Barrier) -> tuple[int, float, float]:
    """How many frames, and when: from and to, by the machine's monotonic clock, which all processes share."""
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
                _wait_for_others(together)
                start_s = time.monotonic()
            pipeline.process(PipelineInput(image_bgr=image, captured_ns=(number + 1) * FRAME_NS))
        return len(images), start_s, time.monotonic()


def _wait_for_others(together: Barrier) -> None:
    try:
        together.wait(START_S)
    except BrokenBarrierError as error:
        raise AppError(EvaluateFault.WORKER_TIMEOUT, limit_s=START_S) from error


def speed_table(figures: SpeedFigures, width_px: int, height_px: int) -> Table:
    """A row a stage, and the two whole ones."""
    rows = [(tr(f"evaluate.stage.{stage}"), f"{spent_ms:.2f}") for stage, spent_ms in figures.stages_ms.items()]
    made = table("speed", "stage ms", rows, frames=figures.frames, width=width_px, height=height_px)
    made.add_section()
    made.add_row(tr("evaluate.stage.bare"), f"{figures.bare_ms:.2f}")
    made.add_row(tr("evaluate.stage.whole"), f"{figures.whole_ms:.2f}")
    return made
