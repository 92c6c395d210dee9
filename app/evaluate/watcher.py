"""Looking at digital hands through one detector, and spreading that over processes with a detector each."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.util import Finalize
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from app.ipc.streams import TRIGGER
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector, live_detector
from kgdfa.preprocess import Image

FRAME_NS = TRIGGER.period_ns
GAP_NS = 1_000_000_000
BLANK_FRAMES = 2
BLANK: Image = np.zeros((72, 128, 3), np.uint8)

Piece = TypeVar("Piece")
Result = TypeVar("Result")


@dataclass(slots=True)
class Watcher:
    """One detector, in one growing time."""

    detector: HandDetector
    now_ns: int = GAP_NS

    def forget(self) -> None:
        """An empty room for a moment: the next hand is found anew, whatever was followed before."""
        self.now_ns += GAP_NS
        for _ in range(BLANK_FRAMES):
            self.look(BLANK)

    def look(self, image_bgr: Image) -> tuple[Hand, ...]:
        """The hands in the next frame, captured at `now_ns`."""
        self.now_ns += FRAME_NS
        return self.detector.detect(image_bgr, self.now_ns)


Work = Callable[[Watcher, Piece], Result]
_watcher: list[Watcher] = []  # this process's own


@contextmanager
def processes(model: Path, count: int) -> Iterator[ProcessPoolExecutor]:
    """So many processes with a detector each; what was not begun is dropped when one leaves early."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(model,))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def spread(
    pool: ProcessPoolExecutor, work: Work[Piece, Result], pieces: Sequence[Piece], done: Callable[[], None]
) -> list[Result]:
    """`work` done on every piece, results in their order; `done` is called as each ends."""

    def tell(_: Future[Result]) -> None:
        done()

    futures = [pool.submit(_do, work, piece) for piece in pieces]
    for future in futures:
        future.add_done_callback(tell)
    return [future.result() for future in futures]


def _begin(model: Path) -> None:
    cv2.setNumThreads(1)
    detector = live_detector(model)
    # MediaPipe can't free its model any more once the interpreter winds up its threads.
    Finalize(None, detector.close, exitpriority=1)
    _watcher.append(Watcher(detector))


def _do(work: Work[Piece, Result], piece: Piece) -> Result:
    watcher = _watcher[0]
    watcher.forget()
    return work(watcher, piece)
