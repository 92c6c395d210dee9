"""What perception tells control and the trail, from one pipeline report to the next."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.perception.reporting import Context, frames_per_second, records_between, to_message
from kgdfa.button import ButtonState, PressCancel
from kgdfa.distance import Distance
from kgdfa.gesture import Decision, Explanation, Gesture, Verdict
from kgdfa.hand import Hand, Side
from kgdfa.pipeline import Report
from kgdfa.press_zone import PressZone
from logs.reason import reason, reason_of
from logs.records import Cancel, GestureOnset, Press, Release

HAND = Hand(image_px=np.zeros((21, 2)), world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)
VERDICT = Verdict(
    gesture=Gesture.ONE,
    confidence=0.9,
    nearest=Gesture.ONE,
    explanation=Explanation(Decision.OVER, {"gesture": Gesture.ONE, "rival": Gesture.NINE}),
)
REPORT = Report(
    captured_ns=5,
    hand=HAND,
    verdict=VERDICT,
    gesture=Gesture.ONE,
    recognised_ns=4,
    votes=3,
    distance=Distance(shown_m=0.3, safe_m=0.31, sd_m=0.01),
    depth_distance=None,
    button=ButtonState(),
)
AROUND = Context(incarnation=1, sequence=2, sent_ns=9, camera="c", threshold_m=0.2, fps=30.0)


def test_no_report_is_said_as_no_hand_with_its_reason() -> None:
    message = to_message(None, replace(AROUND, camera_fault=reason_of(OSError("unplugged"))), captured_ns=3)
    assert (message.hand, message.gesture, message.pressed, message.release_count) == (False, None, False, 0)
    assert (message.camera_fault, message.captured_ns) == (reason_of(OSError("unplugged")), 3)


def test_message_carries_the_safe_distance_beside_the_shown_one() -> None:
    message = to_message(REPORT, AROUND, captured_ns=5)
    assert (message.distance_m, message.safe_distance_m, message.distance_sd_m) == (0.3, 0.31, 0.01)
    assert (message.gesture, message.recognised_ns, message.votes) == (Gesture.ONE, 4, 3)


def test_a_whole_press_leaves_its_three_records() -> None:
    pressed = replace(REPORT, button=ButtonState(pressed=True, pressed_gesture=Gesture.ONE))
    released = replace(REPORT, button=ButtonState(release_count=1, released_gesture=Gesture.ONE))
    reports = (None, REPORT, pressed, released)
    records = [record for before, now in pairwise(reports) if now for record in records_between(before, now, 0.2)]
    assert [type(record) for record in records] == [GestureOnset, Press, Release]
    assert isinstance(records[1], Press)
    assert records[1].threshold_m == 0.2


def test_a_cancelled_press_leaves_its_reason() -> None:
    cancelled = replace(REPORT, button=ButtonState(cancel_count=1, cancel_reason=PressCancel.HAND_LOST))
    (record,) = records_between(REPORT, cancelled, 0.2)
    assert isinstance(record, Cancel)
    assert record.reason == reason(PressCancel.HAND_LOST)


def test_nothing_new_leaves_no_record() -> None:
    assert list(records_between(REPORT, replace(REPORT, captured_ns=6), 0.2)) == []


@given(rate_hz=st.floats(1, 240), frames=st.integers(2, 60))
def test_rate_is_that_of_the_captures(rate_hz: float, frames: int) -> None:
    captures = [round(i * 1e9 / rate_hz) for i in range(frames)]
    assert abs(frames_per_second(captures) - rate_hz) < 1e-3 * rate_hz


def test_rate_of_too_few_frames_is_zero() -> None:
    assert frames_per_second([]) == frames_per_second([1]) == frames_per_second([1, 1]) == 0.0


def test_the_message_tells_where_a_press_works_with_a_hand_and_without() -> None:
    zone = PressZone(followed_from_m=0.13, whole_from_m=0.18, visible_to_m=1.6, threshold_m=0.2, rest_beyond_m=0.24)
    around = replace(AROUND, press_zone=zone)
    assert to_message(REPORT, around, captured_ns=5).press_zone == zone
    assert to_message(None, around, captured_ns=5).press_zone == zone
