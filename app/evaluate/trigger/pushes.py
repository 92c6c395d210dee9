"""Quick pushes before the real pipeline, frame by frame: which of them command, and why the others do not.

As `response` makes them, without its processes: the digital hand rests, signs, is recognised, pushes and withdraws
within the click's time, and rests again. Time is the camera's own, so that a run repeats, on a busy machine too.
Pushes of one hand begin at different moments between two frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from enum import Enum, auto
from itertools import pairwise
from typing import Any

import msgspec
from rich.table import Table

from app.evaluate.digital import PoolDetector, map_pool
from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, percent, table
from app.evaluate.loop.response import APPROACH_M, THRESHOLD_M
from app.evaluate.trigger.table6 import chain
from app.text.catalogue import render, tr
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import SETTLED
from kgdfa.button import ButtonState
from kgdfa.gesture import Gesture
from kgdfa.pipeline import Pipeline, PipelineInput, Report
from logs.reason import Reason, reason

BEGIN_NS = 1_000_000_000
REST_FRAMES = 12
RECOGNITION_FRAMES = 180  # six seconds, as `response` waits
AFTER_FRAMES = 8  # in which a push that has ended may still command
REACTION_NS = 60_000_000  # from the frame that is recognised until the hand begins to push


class PushFault(Enum):
    """Why a push did not command just its own gesture."""

    WRONG_COMMAND = auto()
    NOT_RECOGNISED = auto()  # explanation
    CANCELLED = auto()  # reason
    NOT_WITHDRAWN = auto()
    HINT = auto()  # hint
    NOT_NEAR = auto()


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

    commanded: every gesture that went out during this push; fault: None when it is right.
    """

    seed: int
    gesture: Gesture
    commanded: tuple[Gesture, ...]
    fault: Reason | None
    lost: int
    refused: int
    nearest_m: float

    @property
    def ok(self) -> bool:
        """Whether exactly its own gesture was commanded."""
        return self.commanded == (self.gesture,)

    @property
    def unrequested(self) -> int:
        """Commands of other gestures, and second ones of its own."""
        return len(self.commanded) - (self.gesture in self.commanded)

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        return {
            "seed": self.seed,
            "gesture": self.gesture.value,
            "commanded": [one.value for one in self.commanded],
            "fault": msgspec.to_builtins(self.fault),
            "lost_frames": self.lost,
            "refused_frames": self.refused,
            "nearest_cm": round(100 * self.nearest_m, 1),
        }


@dataclass(slots=True)
class Stage:
    """One hand before one chain. The hand's own time begins anew with every bout, whatever the detector saw before."""

    camera: DigitalHandCamera
    pipeline: Pipeline
    detector: PoolDetector
    now_ns: int

    def next(self) -> Report:
        """The next frame through the chain."""
        self.now_ns += FRAME_NS
        self.detector.now_ns += FRAME_NS
        image = self.camera.render(self.now_ns).image_bgr
        return self.pipeline.process(PipelineInput(image_bgr=image, captured_ns=self.detector.now_ns))

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


def evaluate_pushes(pool: ProcessPoolExecutor, wanted: Sequence[Bout], step: Step) -> list[Push]:
    """Every push of every bout, in their order."""
    return [push for made in map_pool(pool, run_bout, wanted, step) for push in made]


def run_bout(detector: PoolDetector, bout: Bout) -> tuple[Push, ...]:
    """One bout, from a hand at rest."""
    camera = DigitalHandCamera(seed=bout.seed, clock_ns=lambda: 0)
    camera.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
    pipeline = chain("robust", camera.person, camera.lens, detector.inner, THRESHOLD_M)
    return pushed(Stage(camera, pipeline, detector, BEGIN_NS), bout)


def pushed(stage: Stage, bout: Bout) -> tuple[Push, ...]:
    """Every push of a bout by the hand on that stage."""
    return tuple(_push(stage, bout, number) for number in range(bout.pushes))


def _push(stage: Stage, bout: Bout, number: int) -> Push:
    before = _rest(stage)
    stage.camera.command(gesture=bout.gesture.value, at_ns=stage.now_ns)
    signing = list(stage.until(lambda report: report.gesture is bout.gesture, RECOGNITION_FRAMES))
    if signing[-1].gesture is not bout.gesture:
        return _outcome(bout, before, signing, [])
    between_ns = FRAME_NS * number // bout.pushes
    start_ns = stage.now_ns + REACTION_NS + between_ns
    stage.camera.command(click_s=bout.click_s, at_ns=start_ns)
    frames = int((start_ns - stage.now_ns + bout.click_s * 1e9) // FRAME_NS) + AFTER_FRAMES
    return _outcome(bout, before, signing, [stage.next() for _ in range(frames)])


def _rest(stage: Stage) -> ButtonState:
    """The button, once the hand has rested until nothing is recognised any more."""
    stage.camera.command(gesture=SETTLED, at_ns=stage.now_ns)
    resting = [stage.next() for _ in range(REST_FRAMES)]
    resting += stage.until(lambda report: report.gesture is None, RECOGNITION_FRAMES)
    return resting[-1].button


def _outcome(bout: Bout, before: ButtonState, signing: list[Report], pushing: list[Report]) -> Push:
    commanded = _commanded(before, [*signing, *pushing])
    return Push(
        seed=bout.seed,
        gesture=bout.gesture,
        commanded=commanded,
        fault=None if commanded == (bout.gesture,) else _fault(before, signing, pushing),
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


def _fault(before: ButtonState, signing: list[Report], pushing: list[Report]) -> Reason:
    """Why not just its own gesture was commanded, by the chain's own reasons where it has some."""
    last = (pushing or signing)[-1]
    if last.button.release_count > before.release_count:
        return reason(PushFault.WRONG_COMMAND)
    if not pushing:
        explanation = last.verdict.explanation if last.verdict else EvaluateFault.NO_HAND
        return reason(PushFault.NOT_RECOGNISED, explanation=explanation)
    if last.button.cancel_count > before.cancel_count:
        return reason(PushFault.CANCELLED, reason=last.button.cancel_reason)
    if any(report.button.pressed for report in pushing):
        return reason(PushFault.NOT_WITHDRAWN)
    hints = [report.button.hint for report in pushing if report.button.hint]
    return reason(PushFault.HINT, hint=hints[0]) if hints else reason(PushFault.NOT_NEAR)


def by_gesture_table(pushes: Sequence[Push]) -> Table:
    """How many pushes of each gesture command it."""
    rows = []
    for gesture in Gesture:
        of = [push for push in pushes if push.gesture is gesture]
        right = sum(push.ok for push in of)
        rows.append((gesture.value, len(of), right, f"{100 * right / len(of):.1f}" if of else "–"))
    return table("pushes", "gesture pushes commanded percent", rows)


def failed_table(pushes: Sequence[Push]) -> Table:
    """Each push that did not command just its own gesture, and why."""
    made = table("pushes.failed", "hand gesture frames_lost refused nearest_cm", left=2)
    made.add_column(tr("evaluate.column.why"))
    for push in pushes:
        if push.fault is not None:
            figures = (str(push.lost), str(push.refused), f"{100 * push.nearest_m:.1f}")
            made.add_row(str(push.seed), push.gesture.value, *figures, render(push.fault))
    return made


def summary(pushes: Sequence[Push]) -> str:
    """All of them in a sentence."""
    right, unrequested = sum(push.ok for push in pushes), sum(push.unrequested for push in pushes)
    share = percent(right / len(pushes), 2)
    return tr("evaluate.pushes.summary", right=right, pushes=len(pushes), share=share, unrequested=unrequested)
