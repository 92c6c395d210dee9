"""One clip of a foreign hand before the camera, rendered frame by frame, and what comes of it (`foreign`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

from msgspec import Struct

from app.evaluate.detector_pool import PoolDetector
from app.evaluate.digital import side_of
from app.evaluate.harness import FRAME_NS
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
from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import SETTLED
from hal.cameras.digital_hand.raycast import project_px
from hal.cameras.digital_hand.render import Scene, keypoints_m, person_of, render
from kgdfa.gesture import Gesture
from kgdfa.pipeline import PipelineInput, Report
from kgdfa.preprocess import Image
from kgdfa.track import Enrolment

# Of the enrolled hand's push, from its gesture's recognition on: when it begins, later after a hand that crossed and
# is back by then, and how long until it has commanded or does not.
PUSH_BEGIN_NS, CROSSED_BEGIN_NS = 2 * IN_NS, 3 * IN_NS
PUSH_TIME_NS = round(CLICK_S * SECOND_NS) + 10 * FRAME_NS


class ClipOutcome(Struct, frozen=True, kw_only=True):
    """What came of one clip; a line of the file that keeps them. right: of the enrolled hand's own push.

    frames: those whose image holds a keypoint of the foreign hand; refused and reasons: of these.

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
        self.frames = 0  # with a foreign hand
        self.reasons = Counter[str]()  # shown in them
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
        if scene.second is not None and is_in_view(scene.second, scene.lens):
            self.frames += 1
            if report.refusal is not None:
                self.reasons[report.refusal.code.name] += 1
        return report


def is_in_view(hand: Scene, lens: Intrinsics) -> bool:
    """Whether the image holds a keypoint of the hand, which may be behind the other one."""
    if (joints := keypoints_m(hand)) is None:
        return False
    x, y = project_px(joints, lens).T
    return bool(((x >= 0) & (x < lens.width_px) & (y >= 0) & (y < lens.height_px)).any())


def run_clip(detector: PoolDetector, clip: Clip) -> ClipOutcome:
    """What comes of one clip."""
    stage, right = Stage(detector, clip.own_seed), None
    if clip.kind is None:
        begin(stage)
        reports, right = own_push(stage, clip)
    else:
        reports = list(foreign_frames(stage, clip))
    pressed = [False, *(report.button.pressed for report in reports)]
    return ClipOutcome(
        name=clip.name,
        frames=stage.frames,
        commands=reports[-1].button.release_count,
        presses=sum(now and not was for was, now in pairwise(pressed)),
        without=stage.without,
        refused=stage.reasons.total(),
        reasons=dict(stage.reasons),
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
