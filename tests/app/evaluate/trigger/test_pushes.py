"""Quick pushes on hands whose keypoints are known: which command, and why the others do not."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
import pytest

from app.evaluate.digital import PoolDetector
from app.evaluate.harness import EvaluateFault
from app.evaluate.loop.response import APPROACH_M, THRESHOLD_M
from app.evaluate.trigger.pushes import BEGIN_NS, Bout, Push, PushFault, Stage, bouts, pushed
from app.evaluate.trigger.table6 import chain
from hal.cameras.camera import Frame
from hal.cameras.digital_hand.driver import DigitalHandCamera
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image
from logs.reason import reason
from tests.app.evaluate.known_hands import known_hand

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


def made(gesture: Gesture = Gesture.FIVE, *, click_s: float = 0.3, blind: Blind = lambda _: False) -> tuple[Push, ...]:
    camera = PlainCamera(seed=2, clock_ns=lambda: 0)
    camera.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
    knowing = Knowing(camera, blind)
    pipeline = chain("robust", camera.person, camera.lens, knowing, THRESHOLD_M)
    detector = PoolDetector(cast(HandDetector, knowing))
    return pushed(Stage(camera, pipeline, detector, BEGIN_NS), Bout(seed=2, gesture=gesture, pushes=3, click_s=click_s))


@pytest.mark.parametrize("click_s", [0.3, 0.6])
def test_every_push_of_a_hand_that_is_seen_commands_its_gesture(click_s: float) -> None:
    for push in made(click_s=click_s):
        assert push.commanded == (Gesture.FIVE,)
        assert (push.ok, push.fault, push.lost, push.unrequested) == (True, None, 0, 0)
        assert push.nearest_m < THRESHOLD_M


def test_a_hand_lost_near_the_button_counts_the_frames_it_was_lost_in() -> None:
    for push in made(blind=lambda away_m: away_m < 0.24):
        assert (push.ok, push.commanded, push.unrequested) == (False, (), 0)
        assert push.lost >= 3
        assert push.fault == reason(PushFault.NOT_NEAR)


def test_a_gesture_that_is_never_recognised_is_named_as_the_fault() -> None:
    push = made(blind=lambda _: True)[0]
    assert (push.ok, push.fault) == (False, reason(PushFault.NOT_RECOGNISED, explanation=EvaluateFault.NO_HAND))


def test_a_command_of_another_gesture_and_a_second_one_are_unrequested() -> None:
    push = made()[0]
    both = Push(
        seed=1, gesture=Gesture.ONE, commanded=(Gesture.ONE, Gesture.TWO), fault=None, lost=0, refused=0, nearest_m=0.2
    )
    assert (push.unrequested, both.unrequested, both.ok) == (0, 1, False)


def test_every_hand_makes_all_twelve_gestures() -> None:
    wanted = bouts([4, 5], pushes=2, click_s=0.3)
    assert {(bout.seed, bout.gesture) for bout in wanted} == {(seed, gesture) for seed in (4, 5) for gesture in Gesture}
