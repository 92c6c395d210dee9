"""Quick pushes before the real pipeline, frame by frame: which of them command, and why the others do not.

As `response` makes them, without its processes: the digital hand rests, signs, is recognised, pushes and withdraws
within the click's time, and rests again. Time is the camera's own, so that a run repeats, on a busy machine too.
How long each push takes, when between two frames it begins, which frames a busy machine would leave out, and how a
hand trembles, is drawn by the hand's seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from app.evaluate.detector_pool import PoolDetector, iterate_pool
from app.evaluate.harness import FRAME_NS, EvaluateFault, Step
from app.evaluate.loop.response import APPROACH_M, THRESHOLD_M, shared
from app.evaluate.trigger.chain import chain
from app.evaluate.trigger.push_results import ButtonPhase, Push, PushFault, PushFrame, PushRun
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import SETTLED, TREMOR_HZ, Tremor
from hal.cameras.digital_hand.render import person_of
from kgdfa.button_state import ButtonState
from kgdfa.gesture import Gesture
from kgdfa.pipeline import Pipeline, PipelineInput, Report
from logs.reason import Reason, reason
from profiles.schema import HandUsed

LEFT = {HandUsed.LEFT: True, HandUsed.RIGHT: False, HandUsed.EITHER: None}  # which hand of a digital person
BEGIN_NS = 1_000_000_000
REST_FRAMES = 12
RECOGNITION_FRAMES = 180  # six seconds, as `response` waits
AFTER_FRAMES = 8  # in which a push that has ended may still command
REACTION_NS = 60_000_000  # from the frame that is recognised until the hand begins to push


@dataclass(frozen=True, slots=True)
class Click:
    """A push there and back again. begins_ns: after the first frame in which the hand could begin."""

    duration_s: float
    begins_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Bout:
    """One hand that pushes with one gesture, once for each click.

    left_out: share of the camera's frames, 0 to 1. tremor_m: peak to peak, see `tremor_of`. left: which hand; None: as
    the seed draws it.
    """

    seed: int
    gesture: Gesture
    clicks: tuple[Click, ...]
    left_out: float = 0.0
    tremor_m: float = 0.0
    left: bool | None = None


@dataclass(slots=True)
class Stage:
    """One hand before one chain. The hand's own time begins anew with every bout, whatever the detector saw before."""

    camera: DigitalHandCamera
    pipeline: Pipeline
    detector: PoolDetector
    now_ns: int
    left_out: float = 0.0
    draw: np.random.Generator = field(default_factory=np.random.default_rng)

    def next(self) -> Report:
        """The next frame that is not left out, through the chain."""
        frames = 1
        while self.left_out and self.draw.random() < self.left_out:
            frames += 1
        self.now_ns += frames * FRAME_NS
        self.detector.now_ns += frames * FRAME_NS
        image = self.camera.render(self.now_ns).image_bgr
        return self.pipeline.process(PipelineInput(image_bgr=image, captured_ns=self.detector.now_ns))

    def until(self, wanted: Callable[[Report], bool], most: int) -> Iterator[Report]:
        """Frames up to the first that is wanted, at most so many."""
        for _ in range(most):
            report = self.next()
            yield report
            if wanted(report):
                return

    def before(self, end_ns: int) -> Iterator[Report]:
        """Frames as long as the next one of the camera is not after that time."""
        while self.now_ns + FRAME_NS <= end_ns:
            yield self.next()


def bouts(
    seeds: Sequence[int],
    *,
    attempts: int,
    click_s: tuple[float, float],
    left_out: float = 0.0,
    tremor_m: float = 0.0,
    left: bool | None = None,
) -> list[Bout]:
    """So many pushes of each gesture, shared among the hands; a push takes from click_s[0] to click_s[1]."""
    return [
        Bout(
            seed=seed,
            gesture=gesture,
            clicks=tuple(_clicks(seed, number, count, click_s)),
            left_out=left_out,
            tremor_m=tremor_m,
            left=left,
        )
        for seed, count in shared(attempts, seeds)
        for number, gesture in enumerate(Gesture)
        if count
    ]


def _clicks(seed: int, number: int, count: int, click_s: tuple[float, float]) -> Iterator[Click]:
    draw = np.random.default_rng([seed, number, 0x70757368])
    for _ in range(count):
        yield Click(duration_s=float(draw.uniform(*click_s)), begins_ns=int(draw.integers(FRAME_NS)))


def tremor_of(seed: int, travel_m: float) -> Tremor | None:
    """How this hand trembles by so much; None: it does not."""
    if travel_m == 0:
        return None
    draw = np.random.default_rng([seed, 0x7472656D])
    x, y, z = draw.normal(size=3)
    length = math.hypot(x, y, z)
    return Tremor(
        travel_m=travel_m, frequency_hz=float(draw.uniform(*TREMOR_HZ)), axis=(x / length, y / length, z / length)
    )


def evaluate_pushes(pool: ProcessPoolExecutor, wanted: Sequence[Bout], step: Step) -> PushRun:
    """Every push of every bout, in their order; those made so far on Ctrl-C."""
    made: list[Push] = []
    try:
        for pushes in iterate_pool(pool, run_bout, wanted, step):
            made.extend(pushes)
    except KeyboardInterrupt:
        return PushRun(pushes=tuple(made), interrupted=True)
    return PushRun(pushes=tuple(made))


def run_bout(detector: PoolDetector, bout: Bout) -> tuple[Push, ...]:
    """One bout, from a hand at rest."""
    camera, inner = camera_of(bout), detector.inner
    pipeline = chain("robust", camera.person, camera.lens, inner, THRESHOLD_M, follow=inner.follow)
    draw = np.random.default_rng([bout.seed, tuple(Gesture).index(bout.gesture), 0x6C656674])
    return pushed(Stage(camera, pipeline, detector, BEGIN_NS, bout.left_out, draw), bout)


def camera_of(bout: Bout) -> DigitalHandCamera:
    """The bout's hand, moved to where it rests."""
    person, tremor = person_of(bout.seed, left=bout.left), tremor_of(bout.seed, bout.tremor_m)
    camera = DigitalHandCamera(seed=bout.seed, person=person, tremor=tremor, clock_ns=lambda: 0)
    camera.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
    return camera


def pushed(stage: Stage, bout: Bout) -> tuple[Push, ...]:
    """Every push of a bout by the hand on that stage."""
    return tuple(_push(stage, bout, click) for click in bout.clicks)


def _push(stage: Stage, bout: Bout, click: Click) -> Push:
    resting = _rest(stage)
    stage.camera.command(gesture=bout.gesture.value, at_ns=stage.now_ns)
    signing = list(stage.until(lambda report: report.gesture is bout.gesture, RECOGNITION_FRAMES))
    if signing[-1].gesture is not bout.gesture:
        return _outcome(stage, bout, click, stage.now_ns, [resting, signing, []])
    start_ns = stage.now_ns + REACTION_NS + click.begins_ns
    stage.camera.command(click_s=click.duration_s, at_ns=start_ns)
    end_ns = start_ns + int(click.duration_s * 1e9) + AFTER_FRAMES * FRAME_NS
    return _outcome(stage, bout, click, start_ns, [resting, signing, list(stage.before(end_ns))])


def _rest(stage: Stage) -> list[Report]:
    """The hand rests until nothing is recognised any more."""
    stage.camera.command(gesture=SETTLED, at_ns=stage.now_ns)
    resting = [stage.next() for _ in range(REST_FRAMES)]
    return resting + list(stage.until(lambda report: report.gesture is None, RECOGNITION_FRAMES))


def _outcome(stage: Stage, bout: Bout, click: Click, start_ns: int, parts: list[list[Report]]) -> Push:
    """parts: resting, signing, pushing."""
    _, signing, pushing = parts
    reports = [report for part in parts for report in part]
    commanded = _commanded(reports)
    ok, button = commanded == (bout.gesture,), reports[-1].button
    return Push(
        seed=bout.seed,
        gesture=bout.gesture,
        click_s=click.duration_s,
        commanded=commanded,
        fault=None if ok else _fault(reports[0].button, signing, pushing),
        lost=sum(report.hand is None for report in pushing),
        refused=sum(report.hand is not None and report.distance is None for report in pushing),
        nearest_m=min((report.distance.safe_m for report in pushing if report.distance), default=math.inf),
        command_s=(button.released_ns - button.released_recognised_ns) / 1e9 if ok else None,
        frames=tuple(_frames(stage, start_ns, reports, len(pushing))),
    )


def _frames(stage: Stage, start_ns: int, reports: list[Report], wanted: int) -> Iterator[PushFrame]:
    """The last frames, as many as wanted."""
    ahead_ns = stage.detector.now_ns - stage.now_ns  # the detector's clock, which reports carry, of the camera's
    for was, report in list(pairwise(reports))[-wanted:] if wanted else ():
        button, now_ns = report.button, report.captured_ns - ahead_ns
        cancelled = button.cancel_reason if button.cancel_count > was.button.cancel_count else None
        place = stage.camera.scene(now_ns).place
        yield PushFrame(
            at_ms=(now_ns - start_ns) / 1e6,
            true_m=place.position_m[2] if place else math.inf,
            shown_m=report.distance.shown_m if report.distance else None,
            safe_m=report.distance.safe_m if report.distance else None,
            verdict=report.verdict.gesture if report.verdict else None,
            voted=report.gesture,
            phase=_phase(button),
            code=cancelled or button.hint,
        )


def _phase(button: ButtonState) -> ButtonPhase:
    if button.pressed:
        return ButtonPhase.PRESSED
    return ButtonPhase.READY if button.ready else ButtonPhase.WAITING


def _commanded(reports: Iterable[Report]) -> tuple[Gesture, ...]:
    return tuple(
        after.released_gesture
        for was, after in pairwise(report.button for report in reports)
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
