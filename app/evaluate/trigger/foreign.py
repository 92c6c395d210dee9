"""A second person's hand before the camera: it must command nothing, and cost the enrolled hand nothing.

Two digital hands in one scene, rendered and detected. The foreign hand is a therapist's: it reaches in, takes a gesture
and pushes, alone, beside the enrolled hand or across it. The same detected hands go through a chain without enrolment
as well, which says how many commands would have come of them. Then the enrolled hand pushes, alone and with a foreign
hand in view.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from app.evaluate.harness import FRAME_NS, Step, table
from app.evaluate.loop.response import APPROACH_M, THRESHOLD_M
from app.evaluate.trigger.table6 import Replay, chain
from app.text.catalogue import tr
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import SETTLED
from hal.cameras.digital_hand.render import Scene, person_of, posed, render
from kgdfa.gesture import Gesture
from kgdfa.hand import Side
from kgdfa.keypoints import HandDetector
from kgdfa.pipeline import PipelineInput, Report
from kgdfa.preprocess import Image
from kgdfa.track import Enrolment, HandRefusal

CLIP_FRAMES = 105
SECOND_NS = 1_000_000_000
IN_NS, SIGN_NS, PUSH_NS, AGAIN_NS = (round(s * SECOND_NS) for s in (0.4, 0.5, 1.2, 2.2))  # of a clip
CLICK_S = 0.6
OUTSIDE_M = 0.55  # along the arm, out of the image
BESIDE_M = 0.19  # the enrolled hand stands aside by it
FIRST_FOREIGN = 700_000  # nobody else's seed
GAP_NS = 2_000_000_000
BLANK_FRAMES = 2
COST_FRAMES = 30
TRACKERS = (("tracker_of_one", 1), ("tracker_of_two", 2))
GESTURES = tuple(Gesture)
# MediaPipe takes a rendered 3 for either side (docs/decisions.md), so it can't show what a foreign side commands;
# on photos it tells the 3's side as it tells others': `evaluate side`.
TELLING = tuple(gesture for gesture in Gesture if gesture is not Gesture.THREE)


class ForeignKind(Enum):
    """What the foreign hand does. Sides: of the enrolled hand."""

    OTHER_SIDE = "other side alone"  # from below, as the enrolled hand would come
    SAME_SIDE = "same side alone"  # its arm from the side or from above
    BESIDE = "beside"  # the enrolled hand rests in view; other side
    ACROSS_OTHER = "across, other side"  # before the enrolled hand, which shows a gesture
    ACROSS_SAME = "across, same side"


_ACROSS = (ForeignKind.ACROSS_OTHER, ForeignKind.ACROSS_SAME)
_SAME = (ForeignKind.SAME_SIDE, ForeignKind.ACROSS_SAME)


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
class ForeignResult:
    """Of the frames with a foreign hand, and of the enrolled hand's own pushes, alone and beside one."""

    kinds: dict[str, KindResult]
    pushes: int = 0
    alone: int = 0
    beside: int = 0
    interrupted: bool = False

    @property
    def frames(self) -> int:
        """With a foreign hand that signs and pushes."""
        return sum(kind.frames for kind in self.kinds.values())

    @property
    def commands(self) -> int:
        """Of foreign hands; there must be none."""
        return sum(kind.commands for kind in self.kinds.values())


class Stage:
    """Two hands before one detector, whose frames go through the enrolled person's chain."""

    def __init__(self, detector: HandDetector, seed: int, now_ns: int) -> None:
        self._detector = detector
        self._now_ns = now_ns + GAP_NS
        for _ in range(BLANK_FRAMES):
            self._now_ns += FRAME_NS
            detector.detect(np.zeros((72, 128, 3), np.uint8), self._now_ns)
        detector.follow(None, False)
        self.own = DigitalHandCamera(seed=seed, person=person_of(seed), clock_ns=lambda: 0)
        self.own.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
        person = self.own.person
        side = Side.LEFT if person.shape.left else Side.RIGHT
        self.chain = chain(
            "robust", person, self.own.lens, self, THRESHOLD_M, enrolment=Enrolment(side=side), follow=detector.follow
        )
        self._replay = Replay()
        self._open_chain = chain("robust", person, self.own.lens, self._replay, THRESHOLD_M)
        self.without = 0  # commands that an open chain would have given
        self.clip_ns = 0

    @property
    def now_ns(self) -> int:
        """The detector's time."""
        return self._now_ns

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Any, ...]:
        """The hands in one image, kept for the chain without enrolment."""
        self._replay.hands = self._detector.detect(image_bgr, captured_ns)
        return self._replay.hands

    def next(self, scene: Scene) -> Report:
        """One more frame, of that scene."""
        self.clip_ns += FRAME_NS
        self._now_ns += FRAME_NS
        source = PipelineInput(image_bgr=render(scene, self.clip_ns // 1_000_000).image_bgr, captured_ns=self._now_ns)
        report = self.chain.process(source)
        self.without = self._open_chain.process(source).button.release_count
        return report


def turned(scene: Scene, roll_rad: float, shift_m: tuple[float, float], away: float) -> Scene:
    """The hand turned clockwise about the image's middle, shifted, and away along its arm: 1 is out of the image."""
    if scene.place is None:
        return scene
    (x, y, z), (pitch, yaw, roll) = scene.place.position_m, scene.place.turn_rad
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    y += away * OUTSIDE_M
    position = (float(c * x - s * y + shift_m[0]), float(s * x + c * y + shift_m[1]), z)
    return replace(scene, place=replace(scene.place, position_m=position, turn_rad=(pitch, yaw, roll + roll_rad)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Foreigner:
    """A therapist's hand: it reaches in, signs, pushes, signs another gesture and pushes again."""

    camera: DigitalHandCamera
    roll_rad: float
    shift_m: tuple[float, float]

    def scene(self, clip_ns: int) -> Scene:
        """Its scene at a moment of the clip."""
        away = max(0.0, 1 - clip_ns / IN_NS)
        return turned(self.camera.scene(clip_ns), self.roll_rad, self.shift_m, away)


def foreigner(draw: np.random.Generator, kind: ForeignKind, own_left: bool) -> Foreigner:
    """A person drawn at random, with the side and the arm of that kind."""
    seed = FIRST_FOREIGN + int(draw.integers(100_000))
    left = own_left if kind in _SAME else not own_left
    camera = DigitalHandCamera(seed=seed, person=person_of(seed, left=left), clock_ns=lambda: 0)
    camera.command(move_m=(0.0, 0.0, -float(draw.uniform(0.04, 0.10))), at_ns=0)
    shown = GESTURES if kind in _SAME else TELLING
    first, second = draw.choice(len(shown), 2, replace=False)
    for sign_ns, number in ((SIGN_NS, first), (AGAIN_NS - SECOND_NS // 5, second)):
        camera.command(gesture=shown[number].value, at_ns=sign_ns)
    for push_ns in (PUSH_NS, AGAIN_NS + SECOND_NS // 3):
        camera.command(click_s=CLICK_S, at_ns=push_ns)
    # From the left, the right or above (π), each spread by 10°; of the other side also from below.
    roll = float(draw.choice([np.pi / 2, -np.pi / 2, np.pi])) + float(draw.normal(0, np.radians(5)))
    if kind in {ForeignKind.OTHER_SIDE, ForeignKind.BESIDE, ForeignKind.ACROSS_OTHER}:
        roll = float(draw.choice([0.0, roll])) + float(draw.normal(0, np.radians(10)))
    shift = (BESIDE_M / 2, 0.0) if kind is ForeignKind.BESIDE else (0.0, 0.0)
    return Foreigner(camera=camera, roll_rad=roll, shift_m=shift)


def run_clip(stage: Stage, draw: np.random.Generator, kind: ForeignKind, into: KindResult) -> None:
    """One clip of that kind, added to its figures."""
    own = stage.own
    other = foreigner(draw, kind, own.person.shape.left)
    alone = kind in {ForeignKind.OTHER_SIDE, ForeignKind.SAME_SIDE}
    if kind in _ACROSS:
        own.command(gesture=GESTURES[int(draw.integers(len(GESTURES)))].value, at_ns=0)
        for _ in range(30):  # recognised, before the other hand comes
            stage.next(own.scene(stage.clip_ns))
    begin_ns, was_pressed, released = stage.clip_ns, False, 0
    for _ in range(CLIP_FRAMES):
        mine = own.scene(stage.clip_ns)
        if alone:
            mine = replace(mine, place=None)
        elif kind is ForeignKind.BESIDE:
            mine = turned(mine, 0.0, (-BESIDE_M, 0.0), 0.0)
        report = stage.next(replace(mine, second=other.scene(stage.clip_ns - begin_ns)))
        into.presses += report.button.pressed and not was_pressed
        was_pressed, released = report.button.pressed, report.button.release_count
        if report.refusal is not None:
            into.refused += 1
            assert isinstance(report.refusal.code, HandRefusal)
            name = report.refusal.code.name
            into.reasons[name] = into.reasons.get(name, 0) + 1
    into.clips += 1
    into.frames += CLIP_FRAMES
    into.commands += released
    into.without += stage.without


def own_push(stage: Stage, gesture: Gesture, other: Foreigner | None) -> bool:
    """Whether a push of the enrolled hand commands exactly its gesture. other: in view from its recognition on."""
    own, released = stage.own, 0
    own.command(gesture=gesture.value, at_ns=stage.clip_ns)
    begin_ns = None
    report: Report | None = None
    for _ in range(CLIP_FRAMES):
        scene = own.scene(stage.clip_ns)
        if begin_ns is not None and other is not None:
            scene = replace(scene, second=other.scene(stage.clip_ns - begin_ns))
        report = stage.next(scene)
        if begin_ns is None and report.gesture is gesture:
            begin_ns = stage.clip_ns
            own.command(click_s=CLICK_S, at_ns=begin_ns + 2 * IN_NS)
        released = report.button.release_count
    return released == 1 and report is not None and report.button.released_gesture is gesture


def evaluate_foreign(detector: HandDetector, *, frames: int, pushes: int, seed: int, step: Step) -> ForeignResult:
    """At least so many frames with a foreign hand, and so many pushes of the enrolled one, alone and beside one.

    `step` is called after each clip, see `steps`. An interrupt ends it with what there is.
    """
    result = ForeignResult(kinds={kind.value: KindResult() for kind in ForeignKind})
    try:
        for _ in _work(detector, result, frames, pushes, seed):
            step()
    except KeyboardInterrupt:
        result.interrupted = True
    return result


def steps(frames: int, pushes: int) -> int:
    """How many clips that is."""
    return -(-frames // CLIP_FRAMES) + 2 * pushes


def _work(detector: HandDetector, result: ForeignResult, frames: int, pushes: int, seed: int) -> Iterator[None]:
    draw, now_ns = np.random.default_rng([seed, 0x666F_7265]), SECOND_NS
    kinds = tuple(ForeignKind)
    for number in range(steps(frames, 0)):
        kind = kinds[number % len(kinds)]
        stage = Stage(detector, seed=FIRST_FOREIGN - 1 - number, now_ns=now_ns)
        run_clip(stage, draw, kind, result.kinds[kind.value])
        now_ns = stage.now_ns
        yield
    for number in range(pushes):
        gesture = GESTURES[number % len(GESTURES)]
        for beside in (False, True):
            stage = Stage(detector, seed=FIRST_FOREIGN // 2 + number, now_ns=now_ns)
            other = foreigner(draw, ForeignKind.OTHER_SIDE, stage.own.person.shape.left) if beside else None
            shifted = replace(other, shift_m=(float(draw.choice([-1, 1])) * BESIDE_M, 0.0)) if other else None
            for shape in (Gesture.ZERO.value, SETTLED):  # it has commanded before, as in a session
                stage.own.command(gesture=shape, at_ns=stage.clip_ns)
                for _ in range(15):
                    stage.next(stage.own.scene(stage.clip_ns))
            right = own_push(stage, gesture, shifted)
            result.alone += right and not beside
            result.beside += right and beside
            now_ns = stage.now_ns
            yield
        result.pushes += 1


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


def summary(result: ForeignResult) -> str:
    """The enrolled hand's pushes in a sentence."""
    return tr("evaluate.foreign.summary", pushes=result.pushes, alone=result.alone, beside=result.beside)
