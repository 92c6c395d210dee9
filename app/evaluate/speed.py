"""Table 4's row: the whole chain's speed beside bare MediaPipe's, on the same frames in the same run.

Each frame goes through both, one after the other, so that whatever else the machine does slows both alike. The
ratio is the one of sums; the stages are timed inside the chain.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kgdfa.button import ButtonPlace
from kgdfa.distance import Distance
from kgdfa.draw import draw
from kgdfa.gesture import Verdict
from kgdfa.hand import FloatArray, Hand
from kgdfa.pipeline import Picture, Pipeline
from kgdfa.preprocess import AsNeeded, Image, Prepare
from kgdfa.robust import RobustRules
from kgdfa.robust_distance import RobustRange

WARM_UP = 15  # frames before the clock runs
REFERENCE_M, THRESHOLD_M = 0.065, 0.20  # of a usual palm, and the paper's: neither costs time


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedFigures:
    """Milliseconds a frame; `ratio` of the whole chain to bare MediaPipe."""

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


@dataclass(frozen=True, slots=True)
class _TimedDetector:
    inner: Any
    watch: Stopwatch

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        with self.watch.running("keypoints"):
            hands: tuple[Hand, ...] = self.inner.detect(image_bgr, captured_ns)
            return hands


@dataclass(slots=True)
class _TimedRules:
    inner: RobustRules
    watch: Stopwatch
    name: str = RobustRules.name

    def classify(self, hand: Hand) -> Verdict:
        with self.watch.running("rules and explanation"):
            return self.inner.classify(hand)

    def predict_proba(self, hand: Hand) -> FloatArray:
        return self.inner.predict_proba(hand)


@dataclass(slots=True)
class _TimedRange:
    inner: RobustRange
    watch: Stopwatch
    name: str = "robust"

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:
        with self.watch.running("distance"):
            return self.inner.measure(hand, captured_ns)

    def reset(self) -> None:
        self.inner.reset()


def _timed_preparation(watch: Stopwatch) -> Prepare:
    as_needed = AsNeeded()

    def prepare(image_bgr: NDArray[Any]) -> Image:
        with watch.running("preprocessing"):
            return as_needed(image_bgr)

    return prepare


def measure_speed(
    images: list[Image], model: Path, *, focal_px: float, tell: Callable[[], None] = lambda: None
) -> SpeedFigures:
    """Both over the same frames, at 30 frames a second of their own time."""
    from kgdfa.keypoints import HandDetector, live_detector

    watch, hands = Stopwatch(), 0
    height, width = images[0].shape[:2]
    place = ButtonPlace.in_the_middle(width, height, THRESHOLD_M)
    with HandDetector(model) as bare, live_detector(model) as detector:
        pipeline = Pipeline(
            detector=_TimedDetector(detector, watch),
            rules=_TimedRules(RobustRules(), watch),
            range_finder=_TimedRange(RobustRange(focal_px=focal_px, reference_m=REFERENCE_M), watch),
            place=place,
            prepare=_timed_preparation(watch),
        )
        for number, image in enumerate([*images[:WARM_UP], *images]):
            if number == WARM_UP:
                watch.spent_s.clear()
                hands = 0
            now_ns = (number + 1) * 33_333_333
            if number % 2:
                _run_bare(bare, image, now_ns, watch)
            with watch.running("whole"):
                report = pipeline.process(Picture(image_bgr=image, captured_ns=now_ns))
            if not number % 2:
                _run_bare(bare, image, now_ns, watch)
            hands += report.hand is not None
            shown = image.copy()
            with watch.running("drawing, for the preview only"):
                draw(shown, report, place)
            tell()
    return _figures(watch, len(images), hands)


def _run_bare(bare: Any, image: Image, now_ns: int, watch: Stopwatch) -> None:
    """First on every other frame: whoever is second finds the picture in the cache."""
    with watch.running("bare"):
        bare.infer(image, now_ns)


def _figures(watch: Stopwatch, frames: int, hands: int) -> SpeedFigures:
    spent_ms = {name: 1000 * seconds / frames for name, seconds in watch.spent_s.items()}
    bare_ms, whole_ms = spent_ms.pop("bare"), spent_ms.pop("whole")
    inside = sum(ms for name, ms in spent_ms.items() if not name.startswith("drawing"))
    spent_ms["track, vote, button, report"] = whole_ms - inside
    return SpeedFigures(
        frames=frames,
        hands=hands,
        bare_ms=bare_ms,
        whole_ms=whole_ms,
        ratio=whole_ms / bare_ms,
        fps=1000 / whole_ms,
        stages_ms=spent_ms,
    )
