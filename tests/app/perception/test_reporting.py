"""What perception tells control and the trail, from one pipeline report to the next."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from app.ipc.messages import TriggerReport
from app.perception.pipeline import rests_on_assumption
from app.perception.reporting import (
    MeasuredRate,
    Scale,
    frames_per_second,
    records_between,
    with_counts,
    with_report,
)
from app.text.catalogue import render
from kgdfa.button import advance
from kgdfa.button_state import (
    ButtonComparison,
    ButtonInput,
    ButtonMode,
    ButtonPlace,
    ButtonState,
    PressCancel,
    PressHint,
)
from kgdfa.distance import Distance
from kgdfa.gesture import Decision, Explanation, Gesture, HandRefusal, Verdict
from kgdfa.hand import Box, Hand, Side
from kgdfa.pipeline import Report
from kgdfa.press_zone import PressZone
from logs.reason import Reason, reason, reason_of
from logs.records import Body, Cancel, GestureOnset, Hint, Press, Release

HAND = Hand(image_px=np.zeros((21, 2)), world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)
VERDICT = Verdict(
    gesture=Gesture.ONE,
    confidence=0.9,
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
    vote_ns=(2, 3, 4),
)
SCALE = Scale(anchor_m=0.06, anchor_method="measured", focal_px=610.0, focal_source="assumed")
PLACE = ButtonPlace(x_px=320, y_px=240, radius_px=38, threshold_m=0.2)
OVER = Box(left_px=200, right_px=400, top_px=100, bottom_px=400)
FRAME_NS = 33_000_000


def compared() -> ButtonComparison:
    """Every value that a decision may compare."""
    return ButtonComparison(
        captured_ns=5,
        elapsed_ns=1,
        distance_m=0.19,
        previous_m=0.21,
        threshold_m=0.2,
        release_m=0.24,
        nearer_m=0.02,
        nearer_limit_m=0.1,
        beside_px=3.0,
        beside_limit_px=38.0,
        held_ns=2,
        gap_frames=1,
        approached_m=0.05,
        approach_limit_m=0.03,
        source_changed=True,
    )


def push(*moves: tuple[float, Gesture | None, Box | None]) -> tuple[list[Report], list[Body]]:
    """The live reports and the records of a hand at these safe distances, a frame each; shown 1 cm nearer."""
    button, reports = ButtonState(), list[Report]()
    bodies: list[Body] = []
    for count, (safe_m, gesture, box) in enumerate(moves, 1):
        now_ns = count * FRAME_NS
        beside_px = PLACE.beside_px(box) if box else None
        seen = ButtonInput(captured_ns=now_ns, gesture=gesture, recognised_ns=4, distance_m=safe_m, beside_px=beside_px)
        button = advance(button, seen, PLACE, ButtonMode.ROBUST)
        distance = Distance(shown_m=safe_m - 0.01, safe_m=safe_m, sd_m=0.01)
        report = replace(REPORT, captured_ns=now_ns, gesture=gesture, distance=distance, button=button)
        bodies += records_between(reports[-1] if reports else None, report, SCALE)
        reports.append(report)
    return reports, bodies


WITHOUT_HAND = TriggerReport(
    incarnation=1, sequence=2, captured_ns=3, sent_ns=9, hand=False, gesture=None, camera="c", threshold_m=0.2, fps=30.0
)


def test_no_report_is_reported_as_no_hand_with_its_reason() -> None:
    message = with_counts(structs.replace(WITHOUT_HAND, camera_fault=reason_of(OSError("unplugged"))), None)
    assert (message.hand, message.gesture, message.pressed, message.release_count) == (False, None, False, 0)
    assert (message.camera_fault, message.captured_ns) == (reason_of(OSError("unplugged")), 3)


def test_without_a_frame_the_counts_stay() -> None:
    pressed = ButtonState(
        pressed=True,
        release_count=2,
        released_gesture=Gesture.ONE,
        released_ns=7,
        released_recognised_ns=6,
        released_pressed_ns=5,
        cancel_count=1,
        hint=PressHint.KEEP_GESTURE,
    )
    last = replace(REPORT, button=pressed)
    seen, without = with_report(WITHOUT_HAND, last), with_counts(WITHOUT_HAND, last)
    moments = ("released_ns", "released_recognised_ns", "released_pressed_ns")
    counted = ("release_count", "released_gesture", "cancel_count", *moments)
    assert [getattr(without, name) for name in counted] == [getattr(seen, name) for name in counted]
    assert [getattr(seen, name) for name in moments] == [7, 6, 5]
    assert (seen.pressed, without.pressed, without.press_hint, without.hand) == (True, False, None, False)


def test_message_carries_the_safe_distance_beside_the_shown_one() -> None:
    message = with_report(WITHOUT_HAND, REPORT)
    assert (message.distance_m, message.safe_distance_m, message.distance_sd_m) == (0.3, 0.31, 0.01)
    assert (message.gesture, message.recognised_ns, message.votes) == (Gesture.ONE, 4, 3)


def test_a_whole_press_leaves_its_three_records() -> None:
    pressed = replace(REPORT, button=ButtonState(pressed=True, pressed_gesture=Gesture.ONE))
    released = replace(REPORT, button=ButtonState(release_count=1, released_gesture=Gesture.ONE))
    reports = (None, REPORT, pressed, released)
    records = [record for before, now in pairwise(reports) if now for record in records_between(before, now, SCALE)]
    assert [type(record) for record in records] == [GestureOnset, Press, Release]


def test_a_cancelled_press_leaves_its_reason() -> None:
    cancelled = replace(REPORT, button=ButtonState(cancel_count=1, cancel_reason=PressCancel.HAND_LOST))
    (record,) = records_between(REPORT, cancelled, SCALE)
    assert isinstance(record, Cancel)
    assert record.reason == reason(PressCancel.HAND_LOST)


ONE = Gesture.ONE


def assert_as_live(body: Press | Release | Cancel | Hint, report: Report) -> None:
    """Every number of the record is the one that the rule compared in that frame."""
    live = report.button.compared
    assert live is not None
    assert report.distance is not None
    assert (body.captured_ns, body.vote_ns) == (report.captured_ns, report.vote_ns)
    assert (body.distance_m, body.safe_distance_m) == (report.distance.shown_m, report.distance.safe_m)
    assert (body.safe_distance_m, body.previous_m) == (live.distance_m, live.previous_m)
    assert (body.threshold_m, body.release_m) == (live.threshold_m, live.release_m)
    assert (body.nearer_m, body.nearer_limit_m) == (live.nearer_m, live.nearer_limit_m)
    assert (body.approached_m, body.approach_limit_m) == (live.approached_m, live.approach_limit_m)
    assert (body.beside_px, body.beside_limit_px) == (live.beside_px, live.beside_limit_px)
    assert (body.elapsed_ns, body.held_ns, body.gap_frames) == (live.elapsed_ns, live.held_ns, live.gap_frames)
    assert (body.anchor_m, body.anchor_method) == (SCALE.anchor_m, SCALE.anchor_method)
    assert (body.focal_px, body.focal_source) == (SCALE.focal_px, SCALE.focal_source)


def test_press_and_release_record_what_the_button_compared() -> None:
    reports, bodies = push(
        (0.3, ONE, OVER), (0.22, ONE, OVER), (0.195, ONE, OVER), (0.19, ONE, OVER), (0.25, ONE, OVER)
    )
    (press,) = (body for body in bodies if isinstance(body, Press))
    (release,) = (body for body in bodies if isinstance(body, Release))
    assert_as_live(press, reports[2])
    assert_as_live(release, reports[4])
    assert (press.safe_distance_m, press.threshold_m) == (0.195, 0.2)
    assert press.release_m == pytest.approx(0.24)
    assert (release.pressed_ns, release.held_ns) == (press.captured_ns, 2 * FRAME_NS)


def test_a_shown_distance_under_the_threshold_presses_nothing() -> None:
    reports, bodies = push((0.3, ONE, OVER), (0.22, ONE, OVER), (0.205, ONE, OVER))
    assert reports[-1].distance is not None
    assert reports[-1].distance.shown_m < PLACE.threshold_m
    assert not any(isinstance(body, Press) for body in bodies)


def test_a_cancel_records_its_numbers() -> None:
    aside = replace(OVER, right_px=270)
    reports, bodies = push((0.3, ONE, OVER), (0.22, ONE, OVER), (0.195, ONE, OVER), (0.19, ONE, aside))
    (cancel,) = (body for body in bodies if isinstance(body, Cancel))
    assert_as_live(cancel, reports[3])
    assert (cancel.reason, cancel.beside_px, cancel.beside_limit_px) == (reason(PressCancel.LEFT_SIDEWAYS), 50, 38)
    assert (cancel.gesture, cancel.pressed_ns) == ("1", reports[2].captured_ns)


def test_a_hand_that_slips_near_leaves_a_hint_with_the_margin_it_missed() -> None:
    reports, bodies = push((0.4, ONE, OVER), (0.15, ONE, OVER), (0.15, ONE, OVER))
    (hint,) = (body for body in bodies if isinstance(body, Hint))
    assert_as_live(hint, reports[1])
    assert hint.reason == reason(PressHint.PUSH_STEADILY)
    assert hint.nearer_m == pytest.approx(0.25)
    assert hint.nearer_limit_m == pytest.approx(3.5 * 0.033)


def test_a_refused_hand_is_told_and_recorded_once() -> None:
    why = Explanation(
        HandRefusal.OTHER_SIDE, {"side": Side.LEFT, "enrolled": Side.RIGHT, "log_odds": -6.0, "limit": 4.0}
    )
    refused = replace(REPORT, hand=None, verdict=None, gesture=None, distance=None, refusal=why)
    assert with_report(WITHOUT_HAND, refused).hand_refusal == reason_of(why)
    (hint,) = [body for body in records_between(REPORT, refused, SCALE) if isinstance(body, Hint)]
    assert isinstance(hint.reason, Reason)
    assert (hint.reason.code, hint.reason.values["log_odds"]) == ("HandRefusal.OTHER_SIDE", -6.0)
    assert render(hint.reason) == "left hand; the right one commands"
    assert [*records_between(refused, replace(refused, captured_ns=9), SCALE)] == []


def test_the_measured_rate_is_that_of_all_captures() -> None:
    rate = MeasuredRate()
    for count in range(16):
        rate.add(1 + count * 50_000_000, 1)
    assert rate.frames == 16
    assert rate.hz == pytest.approx(20.0)
    assert MeasuredRate().hz is None


def test_a_camera_that_was_lost_for_a_minute_is_no_slow_one() -> None:
    rate = MeasuredRate()
    for opening, began_s in ((1, 0.0), (2, 61.0)):
        for count in range(31):
            rate.add(round((1 + began_s + count / 30) * 1e9), opening)
    assert (rate.frames, round(rate.lasts_ns / 1e9, 6)) == (62, 2.0)
    assert rate.hz == pytest.approx(30.0)


def test_nothing_new_leaves_no_record() -> None:
    assert list(records_between(REPORT, replace(REPORT, captured_ns=6), SCALE)) == []


@given(rate_hz=st.floats(1, 240), frames=st.integers(2, 60))
def test_rate_is_that_of_the_captures(rate_hz: float, frames: int) -> None:
    captures = [round(i * 1e9 / rate_hz) for i in range(frames)]
    assert abs(frames_per_second(captures) - rate_hz) < 1e-3 * rate_hz


def test_rate_of_too_few_frames_is_zero() -> None:
    assert frames_per_second([]) == frames_per_second([1]) == frames_per_second([1, 1]) == 0.0


def test_the_message_reports_where_a_press_works_with_a_hand_and_without() -> None:
    zone = PressZone(followed_from_m=0.13, whole_from_m=0.18, visible_to_m=1.6, threshold_m=0.2, rest_beyond_m=0.24)
    around = structs.replace(WITHOUT_HAND, press_zone=zone)
    assert with_report(around, REPORT).press_zone == zone
    assert with_counts(around, None).press_zone == zone


@pytest.mark.parametrize(
    ("focal", "anchor", "rests"),
    [("assumed", "estimated", True), ("assumed", "calibrated", False), ("given", "estimated", False)],
)
def test_distances_that_rest_on_an_assumed_focal_length_are_marked(focal: str, anchor: str, rests: bool) -> None:
    scale = replace(SCALE, focal_source=focal, anchor_method=anchor)
    assert rests_on_assumption(scale) is rests
    assert with_report(structs.replace(WITHOUT_HAND, focal_assumed=rests), REPORT).focal_assumed is rests
