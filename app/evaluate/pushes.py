"""Quick pushes before the real chain, frame by frame: which of them command, and why the others do not.

As `response` makes them, without its processes: the digital hand rests where it rests there, signs, is recognised,
pushes and withdraws within the click's time, and rests again. Time is the camera's own, so that a run repeats,
on a busy machine too. Pushes of one hand begin at different moments between two frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from app.evaluate.response import APPROACH_M, THRESHOLD_M
from app.evaluate.trigger import chain
from app.evaluate.watcher import Watcher, spread
from app.ipc.streams import TRIGGER
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import SETTLED
from kgdfa.button import ButtonState
from kgdfa.gesture import Gesture
from kgdfa.pipeline import Picture, Pipeline, Report

FRAME_NS = TRIGGER.period_ns
BEGIN_NS = 1_000_000_000
REST_FRAMES = 12
RECOGNITION_FRAMES = 180  # six seconds, as `response` waits
AFTER_FRAMES = 8  # in which a push that has ended may still command
REACTION_NS = 60_000_000  # from the frame that is recognised until the hand begins to push


@dataclass(frozen=True, slots=True, kw_only=True)
class Bout:
    """One hand that pushes `pushes` times with one gesture."""

    seed: int
    gesture: Gesture
    pushes: int
    click_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """What came of one push. lost: frames of it without a hand; refused: with a hand, without a distance.

    commanded: every gesture that went out, at any time of the bout's part of this push; reason: empty when it is right.
    """

    seed: int
    gesture: Gesture
    commanded: tuple[Gesture, ...]
    reason: str
    lost: int
    refused: int
    nearest_m: float

    @property
    def ok(self) -> bool:
        """Whether exactly its own gesture was commanded."""
        return self.commanded == (self.gesture,)

    @property
    def unasked(self) -> int:
        """Commands of other gestures, and second ones of its own."""
        return len(self.commanded) - (self.gesture in self.commanded)

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        return {
            "seed": self.seed,
            "gesture": self.gesture.value,
            "commanded": [one.value for one in self.commanded],
            "reason": self.reason,
            "lost_frames": self.lost,
            "refused_frames": self.refused,
            "nearest_cm": round(100 * self.nearest_m, 1),
        }


@dataclass(slots=True)
class Stage:
    """One hand before one chain. The hand's own time begins anew with every bout, whatever the detector saw before."""

    camera: DigitalHandCamera
    pipeline: Pipeline
    watcher: Watcher
    now_ns: int

    def next(self) -> Report:
        """The next frame through the chain."""
        self.now_ns += FRAME_NS
        self.watcher.now_ns += FRAME_NS
        image = self.camera.render(self.now_ns).image_bgr
        return self.pipeline.process(Picture(image_bgr=image, captured_ns=self.watcher.now_ns))

    def until(self, wanted: Callable[[Report], bool], most: int) -> Iterator[Report]:
        """Frames up to the first that is wanted, at most so many."""
        for _ in range(most):
            report = self.next()
            yield report
            if wanted(report):
                return


def bouts(seeds: Sequence[int], *, pushes: int, click_s: float) -> list[Bout]:
    """Twelve gestures a hand."""
    return [Bout(seed=seed, gesture=gesture, pushes=pushes, click_s=click_s) for seed in seeds for gesture in Gesture]


def evaluate_pushes(pool: ProcessPoolExecutor, wanted: Sequence[Bout], step: Callable[[], None]) -> list[Push]:
    """Every push of every bout, in their order."""
    return [push for made in spread(pool, look_at, wanted, step) for push in made]


def look_at(watcher: Watcher, bout: Bout) -> tuple[Push, ...]:
    """One bout, from a hand at rest."""
    camera = DigitalHandCamera(seed=bout.seed, clock_ns=lambda: 0)
    camera.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
    pipeline = chain("robust", camera.person, camera.lens, watcher.detector, THRESHOLD_M)
    return pushed(Stage(camera, pipeline, watcher, BEGIN_NS), bout)


def pushed(stage: Stage, bout: Bout) -> tuple[Push, ...]:
    """Every push of a bout by the hand on that stage."""
    return tuple(_push(stage, bout, number) for number in range(bout.pushes))


def _push(stage: Stage, bout: Bout, number: int) -> Push:
    before = _rest(stage)
    stage.camera.command(gesture=bout.gesture.value, at_ns=stage.now_ns)
    signing = list(stage.until(lambda report: report.gesture is bout.gesture, RECOGNITION_FRAMES))
    if signing[-1].gesture is not bout.gesture:
        return _judged(bout, before, signing, [])
    between_ns = FRAME_NS * number // bout.pushes
    start_ns = stage.now_ns + REACTION_NS + between_ns
    stage.camera.command(click_s=bout.click_s, at_ns=start_ns)
    frames = int((start_ns - stage.now_ns + bout.click_s * 1e9) // FRAME_NS) + AFTER_FRAMES
    return _judged(bout, before, signing, [stage.next() for _ in range(frames)])


def _rest(stage: Stage) -> ButtonState:
    """The button, once the hand has rested until nothing is recognised any more."""
    stage.camera.command(gesture=SETTLED, at_ns=stage.now_ns)
    resting = [stage.next() for _ in range(REST_FRAMES)]
    resting += stage.until(lambda report: report.gesture is None, RECOGNITION_FRAMES)
    return resting[-1].button


def _judged(bout: Bout, before: ButtonState, signing: list[Report], pushing: list[Report]) -> Push:
    commanded = _commanded(before, [*signing, *pushing])
    return Push(
        seed=bout.seed,
        gesture=bout.gesture,
        commanded=commanded,
        reason="" if commanded == (bout.gesture,) else _why(before, signing, pushing),
        lost=sum(report.hand is None for report in pushing),
        refused=sum(report.hand is not None and report.distance is None for report in pushing),
        nearest_m=min((report.distance.safe_m for report in pushing if report.distance), default=math.inf),
    )


def _commanded(before: ButtonState, reports: list[Report]) -> tuple[Gesture, ...]:
    buttons = [before, *(report.button for report in reports)]
    return tuple(
        after.released_gesture
        for was, after in pairwise(buttons)
        if after.release_count > was.release_count and after.released_gesture is not None
    )


def _why(before: ButtonState, signing: list[Report], pushing: list[Report]) -> str:
    """Why not just its own gesture was commanded, in the chain's own words where it has some."""
    last = (pushing or signing)[-1]
    if last.button.release_count > before.release_count:
        return "commanded wrongly"
    if not pushing:
        return f"not recognised: {last.verdict.explanation if last.verdict else 'no hand'}"
    if last.button.cancel_count > before.cancel_count:
        return f"cancelled: {last.button.cancel_reason}"
    if any(report.button.pressed for report in pushing):
        return "pressed, and not seen withdrawing"
    hints = [report.button.hint for report in pushing if report.button.hint]
    return hints[0] if hints else "not seen near enough"
