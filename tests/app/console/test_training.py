"""The guided tour."""

from __future__ import annotations

import pytest

from app.console.lessons import LESSONS, Lesson, Score, advance, differences, wrong_fingers
from app.console.screens.training import feedback, score_lines
from app.console.session_index import Records, TrainingRecord
from app.console.widgets.hand import draw_hand
from app.console.widgets.panel import Lines, cells
from app.ipc.messages import OperatorKind, TriggerReport
from app.system.paths import Home
from app.text.catalogue import tr
from kgdfa.features import Measure
from kgdfa.gesture import FINGER_STATES, Decision, Explanation, Finger, FingerState, Gesture
from kgdfa.robust import Limit
from logs.reason import Reason, reason
from tests.app.console.conftest import Opener
from tests.app.console.test_sizes import text_of


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
    assert feedback(lesson, None)[0][0][0] == tr("training.finished")


def test_who_skipped_every_gesture_is_not_said_to_have_shown_them() -> None:
    lesson = Lesson()
    for _ in LESSONS:
        lesson = lesson.skipped()
    assert lesson.learnt == 0
    text = feedback(lesson, None)[0][0][0]
    assert "last gesture" in text
    assert "shown" not in text


def test_the_wrong_finger_is_named() -> None:
    assert differences(Gesture.FOUR, Gesture.FIVE) == ((Finger.THUMB, FingerState.OPEN),)
    lesson = Lesson(done=LESSONS.index(Gesture.FOUR))
    lines = feedback(lesson, report(raw_gesture=Gesture.FIVE))
    assert lines[0][0][0] == "✗ thumb: fold it in"


@pytest.mark.parametrize("gesture", LESSONS)
def test_the_right_hand_is_asked_to_push(gesture: Gesture) -> None:
    lesson = Lesson(done=LESSONS.index(gesture))
    lines = feedback(lesson, report(gesture=gesture, raw_gesture=gesture))
    assert "Push" in lines[0][0][0]


def not_(gesture: Gesture, finger: Finger) -> Reason:
    """What the robust rules say of a hand that is none, for one finger."""
    bend = Explanation(Measure.ON_IMAGE, {"measure": Explanation(Measure.MIDDLE_JOINT, {"finger": finger})})
    measure = Explanation(Limit.ABOVE_DEGREES, {"measure": bend, "value_deg": 60.0, "limit_deg": 30.0})
    return reason(Decision.NOT, gesture=gesture, measure=measure)


def test_the_finger_that_decided_is_wrong_where_no_gesture_is_shown() -> None:
    almost = report(explanation=not_(Gesture.FIVE, Finger.RING))
    assert wrong_fingers(Gesture.FIVE, almost) == ((Finger.RING, None),)
    assert feedback(Lesson(done=LESSONS.index(Gesture.FIVE)), almost)[0][0][0] == "✗ ring finger: stretch it"
    assert wrong_fingers(Gesture.FOUR, almost) == ()  # it says why the hand isn't another gesture


def test_no_finger_is_wrong_on_the_right_hand_on_none_and_on_a_refused_one() -> None:
    five = {"raw_gesture": Gesture.FIVE}
    assert wrong_fingers(Gesture.FOUR, report(**five)) == ((Finger.THUMB, FingerState.OPEN),)
    assert wrong_fingers(Gesture.FOUR, report(gesture=Gesture.FOUR, **five)) == ()
    assert wrong_fingers(Gesture.FOUR, report(hand=False, **five)) == ()
    assert wrong_fingers(Gesture.FOUR, report(hand_refusal=reason(Decision.NO_HAND), **five)) == ()


def test_every_wrong_finger_is_marked_on_the_drawing_and_by_more_than_colour() -> None:
    for target in Gesture:
        assert "✗" not in text_of(draw_hand(target, 30, 14))
        for shown in set(Gesture) - {target}:
            wrong = differences(target, shown)
            drawn = draw_hand(target, 30, 14, wrong)
            assert 1 <= text_of(drawn).count("✗") <= len(wrong)  # neighbours may share a cell
            assert "bold $warning" in {style for line in drawn for _, style in line}
    assert "✓" in text_of(draw_hand(Gesture.FIVE, 30, 14, right=True))


def test_a_left_hand_is_drawn_mirrored() -> None:
    right, left = (columns_of(draw_hand(Gesture.FIVE, 30, 14, left_hand=side)) for side in (False, True))
    assert right != left
    assert abs(sum(right) / len(right) + sum(left) / len(left) - 29) < 1.0


def columns_of(lines: Lines) -> list[int]:
    return [x for row in text_of(lines).splitlines() for x, cell in enumerate(row) if cell.strip()]


def test_the_row_grows_with_each_gesture_and_a_slip_begins_it_anew() -> None:
    lesson = advance(Lesson(score=Score(former=2)), report(release_count=0))
    for index in range(3):
        assert lesson.score.record is False
        lesson = advance(lesson, report(release_count=index + 1, released_gesture=LESSONS[index]))
    assert lesson.score == Score(row=3, best=3, former=2)
    assert lesson.score.record
    slipped = advance(lesson, report(release_count=4, released_gesture=Gesture.ROCK))
    assert slipped.score == Score(row=0, best=3, former=2)
    cancelled = advance(lesson, report(release_count=3, cancel_count=1))
    assert cancelled.score == Score(row=0, best=3, former=2)
    assert lesson.skipped().score == lesson.score


def test_after_twelve_the_row_goes_on_in_another_round() -> None:
    lesson = Lesson(done=len(LESSONS), score=Score(row=12, best=12))
    again = advance(lesson.skipped(), report(release_count=7))
    assert again.target is LESSONS[0]
    assert advance(again, report(release_count=8, released_gesture=LESSONS[0])).score.row == 13


@pytest.mark.parametrize("height", range(1, 9))
@pytest.mark.parametrize("width", [18, 34, 58])
def test_the_score_is_never_cut(width: int, height: int) -> None:
    lines = score_lines(Score(row=123, best=123, former=45), width, height)
    assert len(lines) <= max(3, height)
    assert all(sum(cells(text) for text, _ in line) <= width for line in lines)
    assert height < 3 or "123" in text_of(lines)


async def test_training_arms_and_moves_nothing(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("t")
        await open_console.shows("Training of demo 0/12")
        await open_console.shows("Show gesture 0")
        await open_console.press("5")
        await open_console.shows("✗ thumb: fold it in")
        await open_console.press("tab")
        await open_console.shows("Training of demo 1/12")
        await open_console.press("e")
        await open_console.shows("Patients")
        assert {OperatorKind.ARM, OperatorKind.ACT} & set(open_console.host.kinds()) == set()
        assert open_console.host.closed


async def test_the_best_row_is_kept_for_the_patient(console: Opener, home: Home) -> None:
    kept = Records(home.root / "trainings", TrainingRecord)
    kept.add(TrainingRecord(patient="demo", at="2026-11-20T10:00:00+00:00", best=1, learnt=1))
    async with console(profile=None) as open_console:
        await open_console.press("t")
        await open_console.shows("best before 1")
        open_console.host.message = report(raw_gesture=Gesture.FIVE)
        await open_console.shows("✗ thumb: fold it in")  # what a release is counted from
        for index, gesture in enumerate(LESSONS[:2], start=1):
            open_console.host.message = report(release_count=index, released_gesture=gesture)
            await open_console.shows(f"Training of demo {index}/12")
        await open_console.shows("new best 2")
        await open_console.press("e")
        await open_console.shows("Patients")
    assert [(record.best, record.learnt) for record in kept.of("demo")] == [(1, 1), (2, 2)]
