"""Quick pushes on hands whose keypoints are known: which command, and what is told of the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
import pytest

from app.evaluate.pushes import BEGIN_NS, Bout, Push, Stage, bouts, pushed
from app.evaluate.response import APPROACH_M, THRESHOLD_M
from app.evaluate.trigger import chain
from app.evaluate.watcher import Watcher
from hal.cameras.camera import Frame
from hal.cameras.digital_hand.driver import DigitalHandCamera
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image
from tests.app.evaluate.seen_hands import seen_hand

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
        hand = seen_hand(scene)
        if hand is None or scene.place is None or self.blind(scene.place.position_m[2]):
            return ()
        return (hand,)


def made(gesture: Gesture = Gesture.FIVE, *, click_s: float = 0.3, blind: Blind = lambda _: False) -> tuple[Push, ...]:
    camera = PlainCamera(seed=2, clock_ns=lambda: 0)
    camera.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
    knowing = Knowing(camera, blind)
    pipeline = chain("robust", camera.person, camera.lens, knowing, THRESHOLD_M)
    watcher = Watcher(cast(HandDetector, knowing))
    return pushed(Stage(camera, pipeline, watcher, BEGIN_NS), Bout(seed=2, gesture=gesture, pushes=3, click_s=click_s))


@pytest.mark.parametrize("click_s", [0.3, 0.6])
def test_every_push_of_a_hand_that_is_seen_commands_its_gesture(click_s: float) -> None:
    for push in made(click_s=click_s):
        assert push.commanded == (Gesture.FIVE,)
        assert (push.ok, push.reason, push.lost, push.unasked) == (True, "", 0, 0)
        assert push.nearest_m < THRESHOLD_M


def test_a_hand_lost_near_the_button_is_told_with_the_frames_it_was_lost_in() -> None:
    for push in made(blind=lambda away_m: away_m < 0.24):
        assert (push.ok, push.commanded, push.unasked) == (False, (), 0)
        assert push.lost >= 3
        assert push.reason == "not seen near enough"


def test_a_gesture_that_is_never_recognised_is_told_so() -> None:
    push = made(blind=lambda _: True)[0]
    assert (push.ok, push.reason) == (False, "not recognised: no hand")


def test_a_command_of_another_gesture_and_a_second_one_are_unasked() -> None:
    push = made()[0]
    both = Push(
        seed=1, gesture=Gesture.ONE, commanded=(Gesture.ONE, Gesture.TWO), reason="", lost=0, refused=0, nearest_m=0.2
    )
    assert (push.unasked, both.unasked, both.ok) == (0, 1, False)


def test_every_hand_makes_all_twelve_gestures() -> None:
    wanted = bouts([4, 5], pushes=2, click_s=0.3)
    assert {(bout.seed, bout.gesture) for bout in wanted} == {(seed, gesture) for seed in (4, 5) for gesture in Gesture}
