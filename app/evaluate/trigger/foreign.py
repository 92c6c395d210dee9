"""A second person's hand before the camera: it must command nothing, and cost the enrolled hand nothing.

Two digital hands in one scene, rendered and detected. The foreign hand is a therapist's: it reaches in, takes a gesture
and pushes, alone, beside the enrolled hand or across it. The same detected hands go through a chain without enrolment
as well, which says how many commands would have come of them. Then the enrolled hand pushes, alone and with a foreign
hand in view. Each clip is drawn before any is run, so that a run that was ended goes on where it was.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from msgspec import structs
from rich.table import Table

from app.evaluate.detector_pool import iterate_pool
from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, keep_line, kept_lines, table
from app.evaluate.trigger.foreign_clips import SECOND_NS, Clip, ForeignKind, PushKind
from app.evaluate.trigger.foreign_stage import ClipOutcome, run_clip
from app.system.errors import AppError
from app.system.program import PROGRAM, program_identity
from app.text.catalogue import tr
from hal.cameras.digital_hand.render import person_of, posed, render
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image

COST_FRAMES = 30
TRACKERS = (("tracker_of_one", 1), ("tracker_of_two", 2))


@dataclass(slots=True)
class KindResult:
    """Clips of one kind, their frames with a foreign hand in the image, and what came of them."""

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
        (
            tr(ForeignKind(name)),
            one.clips,
            one.frames,
            one.commands,
            one.presses,
            one.without,
            f"{one.refused / one.frames:.0%}",
        )
        for name, one in result.kinds.items()
        if one.frames
    ]
    return table("foreign", "empty clips frames commands presses without refused", rows)


def pushes_table(result: ForeignResult) -> Table:
    """The enrolled hand's pushes."""
    rows = [
        (tr(PushKind(name)), one.pushes, one.right, f"{one.right / one.pushes:.1%}")
        for name, one in result.pushes.items()
    ]
    return table("foreign.pushes", "empty pushes commanded percent", rows)
