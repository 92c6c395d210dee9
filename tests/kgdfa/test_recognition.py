"""Vote and button together: what another hand inherits, how long a press lasts, at which rates a push commands."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import replace

import pytest

from kgdfa.button_state import (
    LONGEST_PRESS_NS,
    SHORTEST_PRESS_NS,
    ButtonMode,
    ButtonPlace,
    ButtonState,
    PressCancel,
    PressHint,
)
from kgdfa.distance import OutlierState, accept_distance
from kgdfa.frame_time import FRAME_NS
from kgdfa.gesture import Gesture
from kgdfa.recognition import FrameReading, Recognition, recognise

PLACE = ButtonPlace.in_the_middle(1280, 720, 0.25)
FIVE = FrameReading(captured_ns=0, hand=1, gesture=Gesture.FIVE, cut_off=False, distance_m=0.36, beside_px=0.0)
PUSH_M, WITHDRAWAL_M = (0.33, 0.29, 0.245, 0.22, 0.22), (0.26, 0.32, 0.36)


def after(
    readings: Iterable[FrameReading],
    now: Recognition | None = None,
    *,
    period_ns: int = FRAME_NS,
    mode: ButtonMode = ButtonMode.ROBUST,
) -> Recognition:
    """Frames one after the other."""
    now = now or Recognition()
    for reading in readings:
        captured_ns = now.button.last_captured_ns + period_ns
        now = recognise(now, replace(reading, captured_ns=captured_ns), PLACE, mode)
    return now


def at(*distances_m: float, hand: int = 1, gesture: Gesture | None = Gesture.FIVE) -> list[FrameReading]:
    return [replace(FIVE, distance_m=distance_m, hand=hand, gesture=gesture) for distance_m in distances_m]


def test_another_hand_that_was_never_outside_does_not_press() -> None:
    first = after(at(*[0.36] * 5))
    assert first.button.ready
    second = after(at(*[0.29] * 10, *PUSH_M[2:], hand=2), first)
    assert (second.button.pressed, second.button.hint) == (False, PressHint.WITHDRAW_FIRST)
    assert after(at(*WITHDRAWAL_M, *PUSH_M, *WITHDRAWAL_M, hand=2), second).button.release_count == 1


NINE_READ_AS_0 = [*at(*[0.36] * 20, gesture=Gesture.NINE), *at(*[0.36] * 7, gesture=None)]


@pytest.mark.parametrize("seen_before_push", [3, 4, 5])
def test_a_hand_misread_after_a_pause_just_before_its_push_does_not_press(seen_before_push: int) -> None:
    misread = after([*NINE_READ_AS_0, *at(*[0.36] * seen_before_push, gesture=Gesture.ZERO)])
    assert misread.vote.gesture is Gesture.ZERO
    pushed = after(at(*PUSH_M, gesture=None), misread)
    assert (pushed.button.pressed, pushed.button.hint) == (False, PressHint.KEEP_GESTURE)
    assert after(at(*WITHDRAWAL_M, gesture=None), pushed).button.release_count == 0


def test_a_hand_that_is_read_as_another_gesture_where_it_would_press_does_not_press() -> None:
    ready = after(at(*[0.36] * 10, 0.33, 0.29))
    contrary = after(at(0.26, 0.245, gesture=Gesture.FOUR), ready)
    assert (contrary.vote.gesture, contrary.button.pressed) == (Gesture.FIVE, False)
    assert contrary.button.hint is PressHint.KEEP_GESTURE
    slipped = after(at(0.245, gesture=Gesture.FOUR), after(at(0.26), ready))
    assert (slipped.vote.gesture, slipped.button.pressed) == (Gesture.FIVE, True)


def test_another_hand_inherits_no_approach() -> None:
    """At 60 Hz its vote is made within what an approach lasts; it only drifts across the threshold."""
    first = after(at(*[0.36] * 8), period_ns=FRAME_NS // 2)
    drifts = after(at(0.301, *[0.255] * 6, 0.249, 0.249, hand=2), first, period_ns=FRAME_NS // 2)
    assert not drifts.button.pressed
    assert len(drifts.button.approach) == 9


def test_another_hand_seen_outside_is_ready_at_once_and_commands_with_its_own_vote() -> None:
    first = after(at(*[0.36] * 5))
    second = after(at(0.36, hand=2), first)
    assert (second.button.ready, second.button.far_gesture) == (True, None)
    six = after(at(*[0.36] * 3, *PUSH_M, *WITHDRAWAL_M, hand=2, gesture=Gesture.SIX), second)
    assert (six.button.release_count, six.button.released_gesture) == (1, Gesture.SIX)


@pytest.mark.parametrize("distance_m", [0.22, 0.36])
def test_another_hand_ends_a_press_without_a_command(distance_m: float) -> None:
    pressed = after(at(*[0.36] * 5, *PUSH_M))
    assert pressed.button.pressed
    ended = after(at(distance_m, hand=2), pressed).button
    assert (ended.pressed, ended.release_count, ended.cancel_reason) == (False, 0, PressCancel.GESTURE_CHANGED)


def test_published_takes_another_hand_for_the_same() -> None:
    pressed = after(at(*[0.36] * 5, *PUSH_M), mode=ButtonMode.PUBLISHED)
    released = after(at(*WITHDRAWAL_M, hand=2), pressed, mode=ButtonMode.PUBLISHED).button
    assert (released.release_count, released.released_gesture) == (1, Gesture.FIVE)


@pytest.mark.parametrize("cut_off", [True, False])
@pytest.mark.parametrize(("longer_ns", "reason"), [(0, None), (2 * FRAME_NS, PressCancel.TOO_LONG)])
def test_a_press_commands_for_some_seconds_only(cut_off: bool, longer_ns: int, reason: PressCancel | None) -> None:
    pressed = after(at(*[0.36] * 5, *PUSH_M))
    held = replace(FIVE, distance_m=0.18, cut_off=cut_off)
    end_ns = pressed.button.pressed_captured_ns + LONGEST_PRESS_NS + longer_ns - len(WITHDRAWAL_M) * FRAME_NS
    while pressed.button.last_captured_ns <= end_ns - FRAME_NS:
        pressed = after([held], pressed)
    withdrawn = after(at(*WITHDRAWAL_M), pressed).button
    assert (withdrawn.release_count, withdrawn.cancel_reason) == (0 if reason else 1, reason)


def push_m(at_s: float) -> float:
    """From 36 to 18 cm in 0.25 s, held for 0.8 s and back."""
    return 0.36 - 0.18 * min(max((at_s - 0.5) / 0.25, 0.0), 1.0) + 0.18 * min(max((at_s - 1.55) / 0.25, 0.0), 1.0)


@pytest.mark.parametrize("rate_hz", [15, 30, 60, 90, 120])
@pytest.mark.parametrize(("misread", "for_s"), [(None, 0.3), (Gesture.FOUR, 0.1)])
def test_a_push_commands_at_every_frame_rate(rate_hz: int, misread: Gesture | None, for_s: float) -> None:
    period_ns = round(1e9 / rate_hz)
    times_s = [number / rate_hz for number in range(2 * rate_hz)]
    readings = [
        at(push_m(at_s), gesture=misread if 0.9 <= at_s < 0.9 + for_s - 1e-6 else Gesture.FIVE)[0] for at_s in times_s
    ]
    button = after(readings, period_ns=period_ns).button
    assert (button.release_count, button.released_gesture, button.cancel_count) == (1, Gesture.FIVE, 0)


@pytest.mark.parametrize("rate_hz", [15, 30, 60, 90, 120])
@pytest.mark.parametrize(
    ("misread", "before_s", "after_s"),
    [(None, 0.1, 0.15), (None, 0.2, 0.2), (Gesture.FOUR, 0.05, 0.05), (Gesture.FOUR, 0.06, 0.06)],
)
def test_what_is_misread_on_both_sides_of_a_cut_lasts_without_it(
    rate_hz: int, misread: Gesture | None, before_s: float, after_s: float
) -> None:
    """The hand is pushed out of the image for a second."""
    button = cut_off(rate_hz, misread, before_s, after_s)
    assert (button.release_count, button.released_gesture, button.cancel_count) == (1, Gesture.FIVE, 0)


@pytest.mark.parametrize("rate_hz", [30, 60, 90, 120])
@pytest.mark.parametrize(("misread", "before_s", "after_s"), [(None, 0.3, 0.3), (Gesture.FOUR, 0.15, 0.15)])
def test_a_cut_hides_nothing_of_what_was_misread_on_both_sides(
    rate_hz: int, misread: Gesture | None, before_s: float, after_s: float
) -> None:
    button = cut_off(rate_hz, misread, before_s, after_s)
    assert (button.release_count, button.cancel_reason) == (0, PressCancel.GESTURE_CHANGED)


def cut_off(rate_hz: int, misread: Gesture | None, before_s: float, after_s: float) -> ButtonState:
    """The button after a push whose hand is misread, cut off by the image's edge for a second, and misread again."""
    readings = []
    for number in range(4 * rate_hz):
        at_s = number / rate_hz
        distance_m = max(0.36 - 0.18 * max(at_s - 0.5, 0.0) / 0.25, 0.18) + 0.18 * max(at_s - 2.5, 0.0) / 0.25
        wrong = 1.0 - before_s - 1e-6 <= at_s < 2.0 + after_s - 1e-6
        reading = replace(FIVE, distance_m=min(distance_m, 0.36), gesture=misread if wrong else Gesture.FIVE)
        readings.append(replace(reading, cut_off=1.0 - 1e-6 <= at_s < 2.0 - 1e-6))
    return after(readings, period_ns=round(1e9 / rate_hz)).button


@pytest.mark.parametrize("rate_hz", [15, 30, 60, 90, 120])
def test_slips_before_a_push_are_no_changes_at_any_frame_rate(rate_hz: int) -> None:
    slips = [(at_s, at_s + 0.033 - 1e-6) for at_s in (0.2, 0.4)]
    readings = [
        at(push_m(at_s), gesture=Gesture.FOUR if any(begin <= at_s < end for begin, end in slips) else Gesture.FIVE)[0]
        for at_s in (number / rate_hz for number in range(2 * rate_hz))
    ]
    assert after(readings, period_ns=round(1e9 / rate_hz)).button.release_count == 1


def test_only_a_press_that_was_too_long_is_compared_with_the_longest() -> None:
    held = [replace(FIVE, distance_m=0.22)] * round(11e9 / FRAME_NS)
    pressed = after(at(*[0.36] * 5, *PUSH_M))
    longest = after(held, pressed)
    assert longest.button.cancel_reason is PressCancel.TOO_LONG
    now = pressed
    while not now.button.cancel_count:
        now = after(held[:1], now)
    assert now.button.compared is not None
    assert now.button.compared.held_limit_ns == LONGEST_PRESS_NS
    published = after([*at(*[0.36] * 5, *PUSH_M), *held, *at(*WITHDRAWAL_M)], mode=ButtonMode.PUBLISHED).button
    assert (published.release_count, published.compared and published.compared.held_limit_ns) == (1, SHORTEST_PRESS_NS)


@pytest.mark.parametrize("rate_hz", [6, 8, 10, 12, 15, 20, 24, 30, 48, 60])
def test_a_slip_to_near_whose_return_is_refused_as_a_jump_commands_nothing(rate_hz: int) -> None:
    """Near in one frame; the distance comes back farther than a hand can withdraw in one, and has none there."""
    now = measured_at(rate_hz, [*[0.36] * max(rate_hz, 8), 0.29, 0.235, *[0.36] * rate_hz])
    assert (now.button.release_count, now.button.cancel_reason) == (0, PressCancel.TOO_SHORT)


@pytest.mark.parametrize("rate_hz", [6, 7, 8, 9, 10, 11, 12, 15, 30, 60, 120])
@pytest.mark.parametrize("seed", range(20))
def test_a_jump_to_afar_that_stays_is_no_withdrawal(rate_hz: int, seed: int) -> None:
    """The captures scatter by 0.1 ms: what ends the press and what believes the jump must not meet in one frame."""
    afar = [0.75] * max(rate_hz, 8)
    measured_m = [*[0.36] * max(rate_hz, 8), *approach_m(rate_hz), *[0.20] * 20, *afar]
    now = measured_at(rate_hz, measured_m, random.Random(seed))
    assert (now.button.release_count, now.button.cancel_reason) == (0, PressCancel.DISTANCE_LOST)


def measured_at(rate_hz: int, distances_m: Iterable[float], scatter: random.Random | None = None) -> Recognition:
    """Frames whose distances must be believed first; scatter: of their captures."""
    state, now = OutlierState(), Recognition()
    for number, measured_m in enumerate(distances_m):
        captured_ns = round((number + 1) * 1e9 / rate_hz) + (scatter.randint(-100_000, 100_000) if scatter else 0)
        state, believed = accept_distance(state, measured_m, captured_ns)
        reading = replace(FIVE, captured_ns=captured_ns, distance_m=measured_m if believed else None)
        now = recognise(now, reading, PLACE, ButtonMode.ROBUST)
    return now


def approach_m(rate_hz: int) -> list[float]:
    """From 36 to 20 cm in 0.25 s."""
    return [0.36 - 0.16 * number / (0.25 * rate_hz) for number in range(1, max(2, rate_hz // 4))]


@pytest.mark.parametrize("lost", [False, True])
def test_a_gesture_not_shown_for_half_a_second_ends_while_the_hand_comes_though_frames_are_lost(lost: bool) -> None:
    """Every second group of three frames is lost; one more misreading near the camera must not press."""
    now, ended_ns, last_ns = Recognition(), 0, 0
    for number in range(1, 64):
        if lost and number > 10 and number // 3 % 2:
            continue
        captured_ns = number * FRAME_NS
        shows = number <= 10 or number in {37, 38, 39}
        reading = at(0.55 - 0.0118 * max(number - 10, 0), gesture=Gesture.ZERO if shows else None)[0]
        now = recognise(now, replace(reading, captured_ns=captured_ns), PLACE, ButtonMode.ROBUST)
        if number <= 10:
            last_ns = captured_ns
        elif now.vote.gesture is None:
            ended_ns = ended_ns or captured_ns
        assert not now.button.pressed
    assert 15 * FRAME_NS <= ended_ns - last_ns < 19 * FRAME_NS


@pytest.mark.parametrize("mode", list(ButtonMode))
def test_what_was_pressed_keeps_its_gesture_over_lost_frames(mode: ButtonMode) -> None:
    """Fourteen frames of nothing, six times further apart: the robust rule as before, and the paper's at any time."""
    pressed = after(at(*[0.36] * 5, *PUSH_M), mode=mode)
    unread = after(at(*[0.22] * 14, gesture=None), pressed, period_ns=6 * FRAME_NS, mode=mode)
    assert unread.vote.gesture is Gesture.FIVE
