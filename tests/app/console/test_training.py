"""The guided tour."""

from __future__ import annotations

import pytest

from app.console.screens.training import LESSONS, Lesson, advance, feedback
from app.console.widgets.drawing import differences, draw_hand
from app.ipc.messages import OperatorKind, TriggerReport
from kgdfa.gesture import FINGER_STATES, Finger, FingerState, Gesture
from tests.app.console.conftest import Opener


def report(**values: object) -> TriggerReport:
    return TriggerReport(
        incarnation=1,
        sequence=1,
        captured_ns=0,
        sent_ns=0,
        **({"hand": True, "gesture": None} | values),  # type: ignore[arg-type]
    )


def test_no_two_gestures_are_taught_alike() -> None:
    assert len(set(FINGER_STATES.values())) == len(Gesture)
    assert len({draw_hand(gesture, 30, 18) for gesture in Gesture}) == len(Gesture)


def test_a_released_push_of_the_right_gesture_ends_the_lesson() -> None:
    lesson = advance(Lesson(), report(release_count=4))
    assert lesson.done == 0
    wrong = advance(lesson, report(release_count=5, released_gesture=Gesture.FIVE))
    assert wrong.done == 0
    right = advance(wrong, report(release_count=6, released_gesture=Gesture.ZERO))
    assert right.target is Gesture.ONE
    assert advance(right, report(release_count=6, released_gesture=Gesture.ZERO)) == right


def test_a_camera_that_starts_anew_ends_no_lesson() -> None:
    lesson = advance(Lesson(), report(release_count=4))
    again = advance(lesson, report(release_count=0, released_gesture=Gesture.ZERO))
    assert again.done == 0


def test_all_twelve_come_to_an_end() -> None:
    lesson = advance(Lesson(), report(release_count=0))
    for index, gesture in enumerate(LESSONS):
        assert lesson.target is gesture
        lesson = advance(lesson, report(release_count=index + 1, released_gesture=gesture))
    assert lesson.target is None
    assert "twelve" in feedback(lesson, None)[0][0][0]


def test_the_wrong_finger_is_named() -> None:
    assert differences(Gesture.FOUR, Gesture.FIVE) == ((Finger.THUMB, FingerState.FOLDED),)
    lesson = Lesson(done=LESSONS.index(Gesture.FOUR))
    lines = feedback(lesson, report(raw_gesture=Gesture.FIVE))
    assert lines[0][0][0] == "✗ thumb: fold it in"


@pytest.mark.parametrize("gesture", LESSONS)
def test_the_right_hand_is_asked_to_push(gesture: Gesture) -> None:
    lesson = Lesson(done=LESSONS.index(gesture))
    lines = feedback(lesson, report(gesture=gesture, raw_gesture=gesture))
    assert "Push" in lines[0][0][0]


async def test_training_arms_and_moves_nothing(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("t")
        await open_console.shows("Training 0/12")
        await open_console.shows("Show gesture 0")
        await open_console.press("5")
        await open_console.shows("thumb: fold it in")
        await open_console.press("tab")
        await open_console.shows("Training 1/12")
        await open_console.press("e")
        await open_console.shows("Patients")
        assert {OperatorKind.ARM, OperatorKind.ACT} & set(open_console.host.kinds()) == set()
        assert open_console.host.closed
