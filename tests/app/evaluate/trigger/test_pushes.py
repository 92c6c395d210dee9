"""Quick pushes on hands whose keypoints are known: which command, and why the others do not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import cast

import numpy as np
import pytest
from rich.table import Table

from app.evaluate.detector_pool import PoolDetector
from app.evaluate.harness import FRAME_NS, EvaluateFault, click_range, seed_numbers
from app.evaluate.loop.response import APPROACH_M, THRESHOLD_M
from app.evaluate.trigger.chain import chain
from app.evaluate.trigger.push_results import ButtonPhase, Push, PushFault, PushRun, shown
from app.evaluate.trigger.pushes import (
    AFTER_FRAMES,
    BEGIN_NS,
    LEFT,
    Bout,
    Click,
    Stage,
    bouts,
    camera_of,
    pushed,
    tremor_of,
)
from app.system.errors import AppError
from hal.cameras.camera import Frame
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import TREMOR_HZ
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image
from logs.reason import reason
from tests.support.known_hands import known_hand

Blind = Callable[[float], bool]

PICTURE: Image = np.zeros((720, 1280, 3), np.uint8)


class PlainCamera(DigitalHandCamera):
    """Paints nothing, and remembers when it was asked to."""

    now_ns = 0

    def render(self, captured_ns: int, *, sequence: int = 0) -> Frame:
        self.now_ns = captured_ns
        return Frame(image_bgr=PICTURE, captured_ns=captured_ns, sequence=sequence, intrinsics=self.lens)


class Knowing:
    """A detector of ours that sees the camera's hand as it is, except where it is blind to the hand's distance."""

    def __init__(self, camera: PlainCamera, blind: Blind) -> None:
        self.camera, self.blind = camera, blind

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        del image_bgr, captured_ns
        scene = self.camera.scene(self.camera.now_ns)
        hand = known_hand(scene)
        if hand is None or scene.place is None or self.blind(scene.place.position_m[2]):
            return ()
        return (hand,)


def made(
    gesture: Gesture = Gesture.FIVE,
    *,
    click_s: float = 0.3,
    blind: Blind = lambda _: False,
    left_out: float = 0.0,
    tremor_m: float = 0.0,
) -> tuple[Push, ...]:
    camera = PlainCamera(seed=2, tremor=tremor_of(2, tremor_m), clock_ns=lambda: 0)
    camera.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
    knowing = Knowing(camera, blind)
    pipeline = chain("robust", camera.person, camera.lens, knowing, THRESHOLD_M)
    detector = PoolDetector(cast(HandDetector, knowing))
    clicks = tuple(Click(click_s, number * FRAME_NS // 3) for number in range(3))
    stage = Stage(camera, pipeline, detector, BEGIN_NS, left_out, np.random.default_rng(7))
    return pushed(stage, Bout(seed=2, gesture=gesture, clicks=clicks))


@pytest.mark.parametrize("click_s", [0.3, 0.6])
def test_every_push_of_a_hand_that_is_seen_commands_its_gesture(click_s: float) -> None:
    for push in made(click_s=click_s):
        assert push.commanded == (Gesture.FIVE,)
        assert (push.ok, push.fault, push.lost, push.unrequested) == (True, None, 0, 0)
        assert push.nearest_m < THRESHOLD_M


def test_a_hand_that_trembles_by_a_centimetre_commands_by_every_push_and_by_nothing_else() -> None:
    assert [push.commanded for push in made(tremor_m=0.01, click_s=0.6)] == [(Gesture.FIVE,)] * 3
    assert [push.commanded for push in made(tremor_m=0.01, click_s=0.6, blind=lambda away_m: away_m < 0.24)] == [()] * 3


def test_each_hand_has_a_tremor_of_its_own() -> None:
    assert tremor_of(1, 0.0) is None
    of = [tremor_of(seed, 0.02) for seed in range(8)]
    assert len({one.frequency_hz for one in of if one}) == 8
    assert all(one and TREMOR_HZ[0] <= one.frequency_hz <= TREMOR_HZ[1] for one in of)
    assert all(one and math.hypot(*one.axis) == pytest.approx(1.0) for one in of)


def test_frames_that_are_left_out_are_not_seen_and_cost_no_time() -> None:
    push = made(click_s=0.6, left_out=0.3, blind=lambda away_m: away_m < 0.24)[0]
    gaps = {round((b.at_ms - a.at_ms) * 30 / 1000) for a, b in pairwise(push.frames)}
    assert 1 in gaps
    assert max(gaps) > 1
    assert push.frames[-1].at_ms <= 600 + AFTER_FRAMES * FRAME_NS / 1e6


def test_a_hand_lost_near_the_button_counts_the_frames_it_was_lost_in() -> None:
    for push in made(blind=lambda away_m: away_m < 0.24):
        assert (push.ok, push.commanded, push.unrequested) == (False, (), 0)
        assert push.lost >= 3
        assert push.fault == reason(PushFault.NOT_NEAR)


def test_a_gesture_that_is_never_recognised_is_named_as_the_fault() -> None:
    push = made(blind=lambda _: True)[0]
    assert (push.ok, push.fault) == (False, reason(PushFault.NOT_RECOGNISED, explanation=EvaluateFault.NO_HAND))


def test_a_failed_push_is_listed_frame_by_frame() -> None:
    push = made(blind=lambda away_m: away_m < 0.24)[0]
    assert [frame.at_ms for frame in push.frames] == sorted(frame.at_ms for frame in push.frames)
    nearest = min(push.frames, key=lambda frame: frame.true_m)
    assert nearest.true_m < 0.16
    assert 0.1 < nearest.at_ms / 300 < 0.9, "the hand is nearest in the middle of the push"
    assert (nearest.shown_m, nearest.safe_m, nearest.verdict, nearest.voted) == (None, None, None, Gesture.FIVE)
    assert {frame.phase for frame in push.frames} == {ButtonPhase.READY, ButtonPhase.WAITING}
    assert len(push.as_json()["frames"]) == len(push.frames)
    listed = next(shown(PushRun(pushes=(push,), interrupted=False)))
    assert isinstance(listed, Table)
    assert set(map(str, listed.columns[-2].cells)) == {"ready", "waits for a hand outside"}


def test_a_push_that_commands_tells_when_and_how_it_pressed() -> None:
    push = made()[0]
    assert ButtonPhase.PRESSED in {frame.phase for frame in push.frames}
    assert push.command_s is not None
    assert 0.2 < push.command_s < 0.5
    assert push.as_json()["frames"] == []


def test_the_figures_count_what_commanded_and_what_nobody_requested() -> None:
    run = PushRun(pushes=(*made(), *made(blind=lambda away_m: away_m < 0.24)), interrupted=True)
    figures = run.as_json()
    assert (figures["trials"], figures["success"], figures["unintended"], figures["interrupted"]) == (6, 0.5, 0, True)
    tables = [part for part in shown(run) if not isinstance(part, str)]
    assert len(tables) == 3 + 3, "a table for each that failed, and three of all"
    assert PushRun(pushes=()).as_json()["success"] is None
    assert len(list(shown(PushRun(pushes=())))) == 3


def test_a_command_of_another_gesture_and_a_second_one_are_unrequested() -> None:
    push = made()[0]
    both = replace(push, gesture=Gesture.ONE, commanded=(Gesture.ONE, Gesture.TWO))
    assert (push.unrequested, both.unrequested, both.ok) == (0, 1, False)


def test_every_hand_makes_all_twelve_gestures_with_pushes_drawn_from_the_range() -> None:
    wanted = bouts([4, 5], attempts=3, click_s=(0.3, 0.8))
    assert {(bout.seed, bout.gesture) for bout in wanted} == {(seed, gesture) for seed in (4, 5) for gesture in Gesture}
    assert [len(bout.clicks) for bout in wanted] == [2] * 12 + [1] * 12
    drawn = [click for bout in wanted for click in bout.clicks]
    assert len({click.duration_s for click in drawn}) == 36
    assert all(0.3 <= click.duration_s <= 0.8 and 0 <= click.begins_ns < FRAME_NS for click in drawn)
    assert wanted == bouts([4, 5], attempts=3, click_s=(0.3, 0.8))
    assert [bout.seed for bout in bouts([4, 5], attempts=1, click_s=(0.3, 0.3))] == [4] * 12


def test_the_hand_asked_for_pushes() -> None:
    for used, wanted in LEFT.items():
        hands = [
            camera_of(bout).person.shape.left
            for bout in bouts([*range(8)], attempts=8, click_s=(0.3, 0.3), left=wanted)
        ]
        assert set(hands) == ({True, False} if wanted is None else {wanted}), used


@pytest.mark.parametrize(
    ("seeds", "numbers"), [("1,2,3", [1, 2, 3]), ("5000-5003", [5000, 5001, 5002, 5003]), ("7, 3-4,7", [7, 3, 4])]
)
def test_seeds_are_numbers_and_ranges(seeds: str, numbers: list[int]) -> None:
    assert seed_numbers(seeds) == numbers


@pytest.mark.parametrize("seeds", ["", "1,", "a", "-1", "1-", "4-3", "1.5", "0-1000000", "²", "9" * 5000])
def test_other_seeds_are_refused(seeds: str) -> None:
    with pytest.raises(AppError) as refused:
        seed_numbers(seeds)
    assert refused.value.code is EvaluateFault.SEEDS


@pytest.mark.parametrize(("click", "range_s"), [("0.3", (0.3, 0.3)), ("0.3-0.8", (0.3, 0.8)), ("1", (1.0, 1.0))])
def test_a_click_is_a_time_or_a_range(click: str, range_s: tuple[float, float]) -> None:
    assert click_range(click) == range_s


@pytest.mark.parametrize("click", ["", "0.1", "0.8-0.3", "nan", "inf", "0.3-", "-0.3", "4", "x"])
def test_other_clicks_are_refused(click: str) -> None:
    with pytest.raises(AppError) as refused:
        click_range(click)
    assert refused.value.code is EvaluateFault.CLICK
