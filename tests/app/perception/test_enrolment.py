"""The hand that the profile names is the one that commands, and the one that the digital person shows."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from app.console.lessons import Lesson
from app.console.screens.training import feedback
from app.console.state import SessionState
from app.console.widgets.gesture import gesture_lines
from app.console.widgets.panel import Lines
from app.ipc.messages import TriggerReport
from app.ipc.states import Action
from app.ipc.streams import LinkDirectory
from app.perception.pipeline import camera_records, enrolment_of, make_camera
from app.system.config import CameraConfig, CameraKind, Config, SessionSetup
from app.text.catalogue import tr, use_language
from hal.cameras.digital_hand.driver import DigitalHandCamera
from kgdfa.gesture import Gesture, HandRefusal
from kgdfa.hand import Side
from logs.reason import reason
from profiles.schema import DEMO_PATIENT, GestureUsed, HandUsed
from tests.app.perception.test_camera_supervisor import Fragile


def setup_for(hand: HandUsed, camera: CameraConfig | None = None) -> SessionSetup:
    profile = msgspec.structs.replace(DEMO_PATIENT, hand=hand)
    config = Config(camera=camera or CameraConfig())
    return SessionSetup(
        session="s",
        home=Path(),
        links=LinkDirectory(path=Path(), public=b"", secret=b""),
        config=config,
        profile=profile,
        operator="ann",
    )


@pytest.mark.parametrize(
    ("hand", "side"), [(HandUsed.LEFT, Side.LEFT), (HandUsed.RIGHT, Side.RIGHT), (HandUsed.EITHER, None)]
)
def test_the_profiles_hand_is_enrolled_and_shown(hand: HandUsed, side: Side | None) -> None:
    setup = setup_for(hand)
    assert enrolment_of(setup).side is side
    camera = make_camera(setup)
    assert isinstance(camera, DigitalHandCamera)
    drawn = DigitalHandCamera(seed=setup.config.camera.seed).person.shape.left
    assert camera.person.shape.left is (drawn if side is None else side is Side.LEFT)


@pytest.mark.parametrize(
    ("kind", "turned"), [("webcam", True), ("recording", True), ("realsense", False), ("digital-hand", False)]
)
def test_the_trail_calls_only_images_mirrored_that_are_turned_back(kind: CameraKind, turned: bool) -> None:
    frame = Fragile().read(0.0)
    assert frame is not None
    for mirrored in (True, False):
        setup = setup_for(HandUsed.RIGHT, CameraConfig(kind=kind, mirrored=mirrored))
        assert camera_records(setup, "cam", frame)[0].mirrored is (mirrored and turned)


def test_the_digital_person_shows_the_wrong_hand_where_asked() -> None:
    camera = make_camera(setup_for(HandUsed.RIGHT, CameraConfig(hand="left")))
    assert isinstance(camera, DigitalHandCamera)
    assert camera.person.shape.left


def test_the_arm_comes_from_where_the_camera_sees_it() -> None:
    angles = {arm: enrolment_of(setup_for(HandUsed.RIGHT, CameraConfig(arm=arm))).arm_rad for arm in ("below", "left")}
    assert angles == {"below": 0.0, "left": pytest.approx(math.pi / 2)}
    assert enrolment_of(setup_for(HandUsed.RIGHT, CameraConfig(arm="anywhere"))).arm_rad is None


@pytest.mark.parametrize(
    ("language", "told"), [("en", "left hand; the right one commands"), ("zh", "这是左手；由右手发出命令")]
)
def test_the_wrong_hand_is_told_in_both_languages(language: str, told: str) -> None:
    use_language(language)
    try:
        state = SessionState(setup=setup_for(HandUsed.RIGHT), started_ns=0, now_ns=2, report=wrong_hand())
        assert told in shown(gesture_lines(state, 60))
        assert told in shown(feedback(Lesson(), wrong_hand()))
    finally:
        use_language("en")


def wrong_hand() -> TriggerReport:
    refusal = reason(HandRefusal.OTHER_SIDE, side=Side.LEFT, enrolled=Side.RIGHT, log_odds=-8.0, limit=4.0)
    return TriggerReport(
        incarnation=1, sequence=1, captured_ns=1, sent_ns=1, hand=False, gesture=None, hand_refusal=refusal
    )


def shown(lines: Lines) -> str:
    return " ".join(text for line in lines for text, _ in line)


@pytest.mark.parametrize(
    ("language", "told"), [("en", "not in this patient's vocabulary"), ("zh", "不在该患者的手势表中")]
)
def test_a_gesture_that_this_patient_does_not_use_is_told_before_it_is_pushed(language: str, told: str) -> None:
    setup = setup_for(HandUsed.RIGHT)
    profile = msgspec.structs.replace(setup.profile, vocabulary=(GestureUsed.ZERO, GestureUsed.ONE))
    shows = msgspec.structs.replace(wrong_hand(), hand=True, hand_refusal=None, gesture=Gesture.TWO)
    state = SessionState(setup=msgspec.structs.replace(setup, profile=profile), started_ns=0, now_ns=2, report=shows)
    use_language(language)
    try:
        assert told in shown(gesture_lines(state, 60))
        assert tr(Action.STEP_LEFT) not in shown(gesture_lines(state, 60))
        one = replace(state, report=msgspec.structs.replace(shows, gesture=Gesture.ONE))
        assert tr(Action.STEP_RIGHT_FIRST) in shown(gesture_lines(one, 60))
        assert told not in shown(gesture_lines(one, 60))
    finally:
        use_language("en")
