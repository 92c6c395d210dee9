"""Processes that detect hands, a detector in each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.util import Finalize
from pathlib import Path
from typing import TypeVar

import cv2

from app.evaluate.harness import FRAME_NS, Step, process_pool
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector, live_detector
from kgdfa.preprocess import Image

GAP_NS = 1_000_000_000
Piece = TypeVar("Piece")
Result = TypeVar("Result")


@dataclass(slots=True)
class PoolDetector:
    """A detector with its own clock."""

    inner: HandDetector
    now_ns: int = GAP_NS

    def reset(self) -> None:
        """A pause, and nothing is remembered: results do not depend on what the detector saw before."""
        self.now_ns += GAP_NS
        self.inner.reset(self.now_ns)

    def detect(self, image_bgr: Image) -> tuple[Hand, ...]:
        """The hands in the next frame, captured at `now_ns`."""
        self.now_ns += FRAME_NS
        return self.inner.detect(image_bgr, self.now_ns)


Work = Callable[[PoolDetector, Piece], Result]
_detector: list[PoolDetector] = []  # this process's own


@contextmanager
def detector_pool(model: Path, count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes with a detector each; on leaving early, work not begun is dropped.

    Raises KgdfaError for a model that is none, AppError when one of the processes ends.
    """
    HandDetector(model).close()  # here: a process that can't begin has no sentence
    with process_pool(count, initializer=_begin, initargs=(model,)) as pool:
        yield pool


def map_pool(pool: ProcessPoolExecutor, work: Work[Piece, Result], pieces: Sequence[Piece], step: Step) -> list[Result]:
    """`work` done on every piece, results in their order; `step` is called as each ends."""
    return list(iterate_pool(pool, work, pieces, step))


def iterate_pool(
    pool: ProcessPoolExecutor, work: Work[Piece, Result], pieces: Sequence[Piece], step: Step
) -> Iterator[Result]:
    """The same, each result as soon as it and those before it are there."""

    def done(_: Future[Result]) -> None:
        step()

    futures = [pool.submit(_do, work, piece) for piece in pieces]
    for future in futures:
        future.add_done_callback(done)
    for future in futures:
        yield future.result()


def _begin(model: Path) -> None:
    cv2.setNumThreads(1)
    detector = live_detector(model)
    # MediaPipe can't free its model any more once the interpreter winds up its threads.
    Finalize(None, detector.close, exitpriority=1)
    _detector.append(PoolDetector(detector))


def _do(work: Work[Piece, Result], piece: Piece) -> Result:
    detector = _detector[0]
    detector.reset()
    return work(detector, piece)
