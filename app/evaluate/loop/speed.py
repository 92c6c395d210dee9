"""Table 4: the whole pipeline's size and speed beside bare MediaPipe's and other detectors', on the same frames.

Each frame goes through all, one after the other, so that whatever else the machine does slows them alike. The
ratio is the one of sums; the stages are timed inside the pipeline.

Throughput: frames per second offline, when so many processes each take a recording of their own. One recording can't be
shared out: tracking, vote and button go from frame to frame. The figure of one worker is by the same clock.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import BrokenBarrierError
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
from rich.table import Table

from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, percent, plain, process_pool, table
from app.evaluate.loop.frames import SpeedFrames
from app.evaluate.loop.networks import NetworkSize, OnnxDetector, bundle_sizes
from app.perception.reporting import PreviewPacer
from app.system.errors import AppError
from app.system.scheduling import gc_freeze
from app.text.catalogue import tr
from kgdfa.button_state import ButtonPlace
from kgdfa.draw import draw
from kgdfa.pipeline import Pipeline, PipelineInput
from kgdfa.preprocess import AsNeeded, Image
from kgdfa.robust import RobustRules
from kgdfa.robust_distance import RobustRange

if TYPE_CHECKING:
    from multiprocessing.synchronize import Barrier

    from kgdfa.keypoints import HandDetector

Result = TypeVar("Result")
WHOLE, BARE = "whole", "bare"
WARM_UP = 15  # frames before the clock runs
START_S = 300.0  # within which every worker must have loaded its model and warmed up
REFERENCE_M, THRESHOLD_M = 0.065, 0.20  # of a usual palm, and the paper's: neither costs time

# The paper's Table 4: mAP@0.5 in %, millions of parameters, seconds a frame and frames per second on its laptop.
PAPER_TABLE_4 = {
    "KGDFA": (95.67, 43.12, 0.03, 34),
    "Faster-RCNN": (90.21, 137.06, 0.92, 1),
    "YOLOv3": (83.03, 61.53, 0.25, 4),
    "SSD": (84.26, 26.29, 0.12, 8),
    "Mobilenet-YOLOv4-lite": (85.25, 41.01, 0.06, 17),
    "YOLOv5m": (87.77, 35.7, 0.17, 6),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorFigures:
    """One detector: a frame's milliseconds, and in how many of the frames it found a hand.

    multiply_adds: of all its networks once; a followed hand needs `hand_landmarks_detector` alone. None: not counted.
    """

    parameters: int
    multiply_adds: int | None
    ms: float
    hands: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedFigures:
    """Milliseconds a frame; `ratio` of the whole pipeline to bare MediaPipe. stages_ms: by their keys.

    detectors: by their names, the pipeline's own the first.
    """

    frames: int
    hands: int
    bare_ms: float
    whole_ms: float
    ratio: float
    fps: float
    stages_ms: dict[str, float]
    detectors: dict[str, DetectorFigures]


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
    return Pipeline(place=place, follow=detector.follow, **parts)


def measure_speed(
    images: list[Image], model: Path, *, focal_px: float, onnx: Sequence[Path] = (), step: Step = lambda: None
) -> SpeedFigures:
    """All over the same frames, at 30 frames per second of their own time. onnx: models of other detectors.

    Raises AppError for a model that is none.
    """
    from kgdfa.keypoints import HandDetector, live_detector

    others = open_detectors(onnx)
    watch, hands, preview = Stopwatch(), Counter[str](), PreviewPacer()
    height, width = images[0].shape[:2]
    place = ButtonPlace.in_the_middle(width, height, THRESHOLD_M)
    with HandDetector(model) as bare, live_detector(model) as detector:
        pipeline = _timed_pipeline(detector, focal_px, place, watch)
        for number, image in enumerate([*images[:WARM_UP], *images]):
            if number == min(WARM_UP, len(images)):
                gc_freeze()  # as a session's perception does
                watch.spent_s.clear()
                hands.clear()
            now_ns = (number + 1) * FRAME_NS
            if number % 2:
                hands[BARE] += _run_bare(bare, image, now_ns, watch)
            with watch.running(WHOLE):
                report = pipeline.process(PipelineInput(image_bgr=image, captured_ns=now_ns))
            if not number % 2:
                hands[BARE] += _run_bare(bare, image, now_ns, watch)
            hands[WHOLE] += report.hand is not None
            for name, other in others.items():
                with watch.running(name):
                    _, scores = other.detect(image)
                hands[name] += len(scores) > 0
            with watch.running("drawing"):
                preview.message(image, now_ns, lambda shown, scale: draw(shown, report, place, scale))  # noqa: B023
            step()
    sizes = list(bundle_sizes(model).values())
    added = [one.multiply_adds for one in sizes if one.multiply_adds is not None]
    own = NetworkSize(sum(one.parameters for one in sizes), sum(added) if len(added) == len(sizes) else None)
    measured = {WHOLE: own, BARE: own} | {name: other.network for name, other in others.items()}
    return _figures(watch, len(images), hands, measured)


def open_detectors(onnx: Sequence[Path]) -> dict[str, OnnxDetector]:
    """By the name that tells them apart. Raises AppError for a model that is none."""
    names = Counter(path.name for path in onnx)
    return {path.name if names[path.name] == 1 else str(path): OnnxDetector(path) for path in onnx}


def _run_bare(bare: Any, image: Image, now_ns: int, watch: Stopwatch) -> bool:
    """Whether it found a hand. First on every other frame: whichever is second finds the image in the cache."""
    with watch.running(BARE):
        return bool(bare.infer(image, now_ns).hand_landmarks)


def _figures(watch: Stopwatch, frames: int, hands: Counter[str], sizes: dict[str, NetworkSize]) -> SpeedFigures:
    spent_ms = {name: 1000 * seconds / frames for name, seconds in watch.spent_s.items()}
    detectors = {
        name: DetectorFigures(
            parameters=size.parameters, multiply_adds=size.multiply_adds, ms=spent_ms.pop(name), hands=hands[name]
        )
        for name, size in sizes.items()
    }
    bare_ms, whole_ms = detectors[BARE].ms, detectors[WHOLE].ms
    inside = sum(ms for name, ms in spent_ms.items() if name != "drawing")
    spent_ms["rest"] = whole_ms - inside
    return SpeedFigures(
        frames=frames,
        hands=hands[WHOLE],
        bare_ms=bare_ms,
        whole_ms=whole_ms,
        ratio=whole_ms / bare_ms,
        fps=1000 / whole_ms,
        stages_ms=spent_ms,
        detectors=detectors,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Throughput:
    """`workers` processes took `frames` frames altogether, at `fps` a second."""

    workers: int
    frames: int
    fps: float


def worker_counts(workers: int | None) -> list[int]:
    """How many processes at once are timed: one, and so many; None: as many as this process has cores; 0: none."""
    most = len(os.sched_getaffinity(0)) if workers is None else workers
    return sorted({1, most}) if most else []


def measure_throughput(frames: SpeedFrames, model: Path, workers: int) -> Throughput:
    """`workers` processes at once, each over all the frames. Raises AppError when one can't begin, or ends."""
    barrier = multiprocessing.get_context("spawn").Barrier(workers)
    with process_pool(workers, _share, (barrier,)) as pool:
        futures = [pool.submit(_run, frames, model) for _ in range(workers)]
        try:
            runs = [future.result() for future in futures]
        except BaseException:
            for process in multiprocessing.active_children():  # what they measure is of no more use
                process.terminate()
            raise
    processed = sum(observed for observed, _, _ in runs)
    spent_s = max(end for _, _, end in runs) - min(start for _, start, _ in runs)
    return Throughput(workers=workers, frames=processed, fps=processed / spent_s)


_together: list[Barrier] = []  # of a process, where it waits for the others


def _share(together: Barrier) -> None:
    _together.append(together)


def _run(frames: SpeedFrames, model: Path) -> tuple[int, float, float]:
    """How many frames, and when: from and to, by the machine's monotonic clock, which all processes share."""
    from kgdfa.keypoints import live_detector

    cv2.setNumThreads(1)
    images = frames.images()
    height, width = images[0].shape[:2]
    place = ButtonPlace.in_the_middle(width, height, THRESHOLD_M)
    finder = RobustRange(focal_px=frames.focal_px, reference_m=REFERENCE_M)
    parts: dict[str, Any] = {"rules": RobustRules(), "range_finder": finder, "prepare": AsNeeded()}
    with live_detector(model) as detector:
        pipeline = Pipeline(detector=detector, place=place, follow=detector.follow, **parts)
        start_s = 0.0
        for number, image in enumerate([*images[:WARM_UP], *images]):
            if number == min(WARM_UP, len(images)):
                _wait_for_others(_together[0])
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


def detectors_table(figures: SpeedFigures) -> Table:
    """Table 4: a row a detector, the paper's below."""
    made = table("table_4", "detector parameters multiply_adds ms fps hands")
    for name, one in figures.detectors.items():
        label = tr(f"evaluate.stage.{name}") if name in {WHOLE, BARE} else name
        adds = "–" if one.multiply_adds is None else f"{one.multiply_adds / 1e9:.2f}"
        shares = (f"{one.ms:.1f}", f"{1000 / one.ms:.0f}", percent(one.hands / figures.frames))
        made.add_row(plain(label), f"{one.parameters / 1e6:.2f}", adds, *shares)
    made.add_section()
    for name, (_, millions, frame_s, fps) in PAPER_TABLE_4.items():
        label = tr("evaluate.paper_row", name=name)
        made.add_row(label, f"{millions:.2f}", "–", f"{1000 * frame_s:.0f}", str(fps), "–")
    return made
