"""A second person's hand before the camera: it must command nothing, and cost the enrolled hand nothing.

Two digital hands in one scene, rendered and detected. The foreign hand is a therapist's: it reaches in, takes a gesture
and pushes, alone, beside the enrolled hand or across it. The same detected hands go through a chain without enrolment
as well, which says how many commands would have come of them. Then the enrolled hand pushes, alone and with a foreign
hand in view. Each clip is drawn before any is run, so that a run that was ended goes on where it was.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from msgspec import Struct, structs
from rich.table import Table

from app.evaluate.detector_pool import PoolDetector, iterate_pool
from app.evaluate.digital import side_of
from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, keep_line, kept_lines, table
from app.evaluate.loop.response import APPROACH_M, THRESHOLD_M
from app.evaluate.trigger.chain import Replay, chain
from app.evaluate.trigger.foreign_clips import (
    BESIDE_M,
    CLICK_S,
    CLIP_FRAMES,
    IN_NS,
    SECOND_NS,
    Clip,
    ForeignKind,
    PushKind,
    turned,
)
from app.system.errors import AppError
from app.system.program import PROGRAM, program_identity
from app.text.catalogue import tr
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import SETTLED
from hal.cameras.digital_hand.render import Scene, person_of, posed, render
from kgdfa.gesture import Gesture
from kgdfa.keypoints import HandDetector
from kgdfa.pipeline import PipelineInput, Report
from kgdfa.preprocess import Image
from kgdfa.track import Enrolment

COST_FRAMES = 30
TRACKERS = (("tracker_of_one", 1), ("tracker_of_two", 2))
# Of the enrolled hand's push, from its gesture's recognition on: when it begins, later after a hand that crossed and
# is back by then, and how long until it has commanded or does not.
PUSH_BEGIN_NS, CROSSED_BEGIN_NS = 2 * IN_NS, 3 * IN_NS
PUSH_TIME_NS = round(CLICK_S * SECOND_NS) + 10 * FRAME_NS


@dataclass(slots=True)
class KindResult:
    """Frames of one kind, those in which a foreign hand was in view, and what came of them."""

    clips: int = 0
    frames: int = 0
    commands: int = 0
    presses: int = 0
    without: int = 0  # commands of a chain that enrols nobody
    refused: int = 0  # frames whose reason was on the screen
    reasons: dict[str, int] = field(default_factory=dict)


@dataclass(slots=True)
class PushResult:
    """Pushes of the enrolled hand, and those that commanded exactly their gesture."""

    pushes: int = 0
    right: int = 0


class ClipOutcome(Struct, frozen=True, kw_only=True):
    """What came of one clip; a line of the file that keeps them. right: of the enrolled hand's own push.

    program: SHA-256 of its files, since clips of other rules make no sum; empty: not kept, or before it was.
    """

    name: str
    frames: int
    commands: int
    presses: int
    without: int
    refused: int
    reasons: dict[str, int]
    right: bool | None = None
    program: str = ""


@dataclass(slots=True)
class ForeignResult:
    """Of the frames with a foreign hand, and of the enrolled hand's own pushes, alone and beside one."""

    kinds: dict[str, KindResult]
    pushes: dict[str, PushResult] = field(default_factory=dict)
    interrupted: bool = False

    @property
    def commands(self) -> int:
        """Of foreign hands; there must be none."""
        return sum(kind.commands for kind in self.kinds.values())


class Stage:
    """Two hands before one detector, whose frames go through the enrolled person's chain."""

    def __init__(self, detector: PoolDetector, own_seed: int) -> None:
        self._detector = detector
        inner = detector.inner
        self.own = DigitalHandCamera(seed=own_seed, person=person_of(own_seed), clock_ns=lambda: 0)
        self.own.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
        person = self.own.person
        self.chain = chain(
            "robust",
            person,
            self.own.lens,
            self,
            THRESHOLD_M,
            enrolment=Enrolment(side=side_of(person)),
            follow=inner.follow,
        )
        self._replay = Replay()
        self._open_chain = chain("robust", person, self.own.lens, self._replay, THRESHOLD_M)
        self.without = 0  # commands that an open chain would have given
        self.clip_ns = 0

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Any, ...]:
        """The hands in one image, kept for the chain without enrolment."""
        self._replay.hands = self._detector.inner.detect(image_bgr, captured_ns)
        return self._replay.hands

    def next(self, scene: Scene) -> Report:
        """One more frame, of that scene."""
        self.clip_ns += FRAME_NS
        self._detector.now_ns += FRAME_NS
        image = render(scene, self.clip_ns // 1_000_000).image_bgr
        source = PipelineInput(image_bgr=image, captured_ns=self._detector.now_ns)
        report = self.chain.process(source)
        self.without = self._open_chain.process(source).button.release_count
        return report


def run_clip(detector: PoolDetector, clip: Clip) -> ClipOutcome:
    """What comes of one clip."""
    stage, right = Stage(detector, clip.own_seed), None
    if clip.kind is None:
        begin(stage)
        reports, right = own_push(stage, clip)
    else:
        reports = list(foreign_frames(stage, clip))
    refusals = [report.refusal.code.name for report in reports if report.refusal is not None]
    pressed = [False, *(report.button.pressed for report in reports)]
    return ClipOutcome(
        name=clip.name,
        frames=len(reports),
        commands=reports[-1].button.release_count,
        presses=sum(now and not was for was, now in pairwise(pressed)),
        without=stage.without,
        refused=len(refusals),
        reasons=dict(Counter(refusals)),
        right=right,
    )


def foreign_frames(stage: Stage, clip: Clip) -> Iterator[Report]:
    """Of a clip in which only a foreign hand pushes, from its coming on."""
    own, other = stage.own, clip.other
    assert other is not None
    if clip.gesture is not None:
        own.command(gesture=clip.gesture.value, at_ns=0)
        for _ in range(30):  # recognised, before the other hand comes
            stage.next(own.scene(stage.clip_ns))
    camera, begin_ns = other.camera(), stage.clip_ns
    for _ in range(CLIP_FRAMES):
        mine = own.scene(stage.clip_ns)
        if clip.kind in {ForeignKind.OTHER_SIDE, ForeignKind.SAME_SIDE}:
            mine = replace(mine, place=None)
        elif clip.kind is ForeignKind.BESIDE:
            mine = turned(mine, 0.0, (-BESIDE_M, 0.0), 0.0)
        yield stage.next(replace(mine, second=other.scene(camera, stage.clip_ns - begin_ns)))


def begin(stage: Stage) -> None:
    """The enrolled hand has commanded before, as in a session."""
    for shape in (Gesture.ZERO.value, SETTLED):
        stage.own.command(gesture=shape, at_ns=stage.clip_ns)
        for _ in range(15):
            stage.next(stage.own.scene(stage.clip_ns))


def own_push(stage: Stage, clip: Clip) -> tuple[list[Report], bool]:
    """The frames, and whether a push of the enrolled hand commands exactly its gesture.

    The foreign hand is in view from the gesture's recognition on.
    """
    own, other, gesture = stage.own, clip.other, clip.gesture
    assert gesture is not None
    camera = other.camera() if other is not None else None
    own.command(gesture=gesture.value, at_ns=stage.clip_ns)
    after_ns = CROSSED_BEGIN_NS if clip.push is PushKind.CROSSED else PUSH_BEGIN_NS
    begin_ns: int | None = None
    reports: list[Report] = []
    while len(reports) < CLIP_FRAMES and (begin_ns is None or stage.clip_ns < begin_ns + after_ns + PUSH_TIME_NS):
        scene = own.scene(stage.clip_ns)
        if begin_ns is not None and other is not None and camera is not None:
            scene = replace(scene, second=other.scene(camera, stage.clip_ns - begin_ns))
        reports.append(stage.next(scene))
        if begin_ns is None and reports[-1].gesture is gesture:
            begin_ns = stage.clip_ns
            own.command(click_s=CLICK_S, at_ns=begin_ns + after_ns)
    button = reports[-1].button
    return reports, button.release_count == 1 and button.released_gesture is gesture


def evaluate_foreign(
    pool: ProcessPoolExecutor, wanted: list[Clip], step: Step, keep: Path | None = None
) -> ForeignResult:
    """Every clip, with the outcomes that `keep` holds already. An interrupt ends it with what there is.

    Raises AppError for a file that can't be used, or holds clips of another program.
    """
    program = program_identity()[PROGRAM]
    done = {outcome.name: outcome for outcome in kept_lines(keep, ClipOutcome)}
    if any(outcome.program != program for outcome in done.values()):
        raise AppError(EvaluateFault.PROGRESS_OF_OTHERS, file=keep)
    made = {clip.name: done[clip.name] for clip in wanted if clip.name in done}
    for _ in made:
        step()
    interrupted = False
    try:
        for outcome in iterate_pool(pool, run_clip, [clip for clip in wanted if clip.name not in made], step):
            made[outcome.name] = outcome
            keep_line(structs.replace(outcome, program=program), keep)
    except KeyboardInterrupt:
        interrupted = True
    return collected(wanted, made, interrupted=interrupted)


def collected(wanted: Iterable[Clip], made: Mapping[str, ClipOutcome], *, interrupted: bool = False) -> ForeignResult:
    """The figures of those clips that were made."""
    result = ForeignResult(kinds={kind.value: KindResult() for kind in ForeignKind}, interrupted=interrupted)
    for clip, outcome in ((clip, made[clip.name]) for clip in wanted if clip.name in made):
        if clip.kind is not None:
            into = result.kinds[clip.kind.value]
            into.clips += 1
            for name in ("frames", "commands", "presses", "without", "refused"):
                setattr(into, name, getattr(into, name) + getattr(outcome, name))
            into.reasons = dict(Counter(into.reasons) + Counter(outcome.reasons))
        else:
            pushed = result.pushes.setdefault(clip.push.value, PushResult())
            pushed.pushes += 1
            pushed.right += bool(outcome.right)
    return result


def measure_costs(model: Path) -> dict[str, tuple[float, float]]:
    """CPU ms a frame of a tracker asked for one hand and for two, with one hand in view and with two."""
    scenes = [posed("5", person=person_of(1), position_m=(x, 0.02, 0.45)) for x in (-0.12, 0.12)]
    views = [render(scenes[0], 1).image_bgr, render(replace(scenes[0], second=scenes[1]), 1).image_bgr]
    return {name: (_cost_ms(model, asked, views[0]), _cost_ms(model, asked, views[1])) for name, asked in TRACKERS}


def _cost_ms(model: Path, asked: int, image: Image) -> float:
    with HandDetector(model, max_hands=asked) as detector:
        for number in range(2 * COST_FRAMES):
            if number == COST_FRAMES:
                began_s = time.process_time()  # of every thread: a busy machine does not change it much
            detector.infer(image, SECOND_NS + number * FRAME_NS)
    return 1000 * (time.process_time() - began_s) / COST_FRAMES


def costs_table(costs: dict[str, tuple[float, float]]) -> Table:
    """Of each tracker."""
    rows = [(tr(f"evaluate.foreign.{name}"), *(f"{one:.1f}" for one in ms)) for name, ms in costs.items()]
    return table("foreign.costs", "empty one_hand two_hands", rows)


def foreign_table(result: ForeignResult) -> Table:
    """Commands of foreign hands, a kind."""
    rows = [
        (tr(ForeignKind(name)), one.frames, one.commands, one.presses, one.without, f"{one.refused / one.frames:.0%}")
        for name, one in result.kinds.items()
        if one.frames
    ]
    return table("foreign", "empty frames commands presses without refused", rows)


def pushes_table(result: ForeignResult) -> Table:
    """The enrolled hand's pushes."""
    rows = [
        (tr(PushKind(name)), one.pushes, one.right, f"{one.right / one.pushes:.1%}")
        for name, one in result.pushes.items()
    ]
    return table("foreign.pushes", "empty pushes commanded percent", rows)
