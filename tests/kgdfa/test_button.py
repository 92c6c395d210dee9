from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.button import advance
from kgdfa.button_state import (
    APPROACH_M_S,
    GAP_FRAMES,
    HYSTERESIS,
    SHORTEST_PRESS_NS,
    STALE_NS,
    ButtonInput,
    ButtonMode,
    ButtonPlace,
    ButtonState,
    PressCancel,
    PressHint,
    is_approaching,
    is_near,
)
from kgdfa.gesture import SETTLING_NS, Gesture
from kgdfa.hand import Box
from kgdfa.recognition import FrameReading, Recognition, recognise

FRAME_NS = 33_333_333
PLACE = ButtonPlace(x_px=640, y_px=360, radius_px=40, threshold_m=0.20)
OVER = Box(left_px=500, top_px=200, right_px=800, bottom_px=500)
EDGE = Box(left_px=660, top_px=200, right_px=900, bottom_px=500)  # off the centre, within the button's radius
BESIDE = Box(left_px=900, top_px=200, right_px=1200, bottom_px=500)
FAR, BETWEEN, NEAR = 0.26, 0.22, 0.16
OUTSIDE_M = PLACE.threshold_m * (1 + HYSTERESIS)


@dataclass(frozen=True)
class Seen:
    distance_m: float | None
    gesture: Gesture | None = Gesture.FIVE
    box: Box | None = OVER


LOST = Seen(None, box=None)


def run(frames: Sequence[Seen], mode: ButtonMode = ButtonMode.ROBUST, state: ButtonState | None = None) -> ButtonState:
    state = state or ButtonState()
    for observed in frames:
        state = step(state, observed, mode)
    return state


def step(
    state: ButtonState, observed: Seen, mode: ButtonMode = ButtonMode.ROBUST, after_ns: int = FRAME_NS
) -> ButtonState:
    given_input = ButtonInput(
        captured_ns=state.last_captured_ns + after_ns,
        gesture=observed.gesture,
        recognised_ns=7 if observed.gesture else 0,
        distance_m=observed.distance_m,
        beside_px=None if observed.box is None else PLACE.beside_px(observed.box),
    )
    return advance(state, given_input, PLACE, mode)


def test_a_push_and_a_withdrawal_command_once() -> None:
    state = run([Seen(FAR), Seen(NEAR), Seen(NEAR)])
    assert (state.pressed, state.pressed_gesture, state.release_count) == (True, Gesture.FIVE, 0)
    state = run([Seen(BETWEEN), Seen(FAR), Seen(FAR)], state=state)
    assert (state.pressed, state.release_count, state.released_gesture) == (False, 1, Gesture.FIVE)
    assert state.released_ns == 5 * FRAME_NS
    assert state.released_recognised_ns == 7
    again = run([Seen(d, Gesture.SIX) for d in (FAR, NEAR, NEAR, FAR)], state=state)
    assert (again.release_count, again.released_gesture) == (2, Gesture.SIX)


@pytest.mark.parametrize(
    ("during", "reason"),
    [
        ([LOST] * (GAP_FRAMES + 1), PressCancel.HAND_LOST),
        ([Seen(None)] * (GAP_FRAMES + 1), PressCancel.DISTANCE_LOST),
        ([Seen(NEAR, Gesture.SIX)], PressCancel.GESTURE_CHANGED),
        ([Seen(FAR, Gesture.SIX)], PressCancel.GESTURE_CHANGED),
        ([Seen(NEAR, None)], PressCancel.GESTURE_CHANGED),
        ([Seen(NEAR, box=BESIDE)], PressCancel.LEFT_SIDEWAYS),
        ([Seen(FAR, box=BESIDE)], PressCancel.LEFT_SIDEWAYS),
    ],
)
def test_any_other_end_of_a_press_is_a_cancel_with_its_reason(during: list[Seen], reason: PressCancel) -> None:
    state = run([Seen(FAR), Seen(NEAR), Seen(NEAR), *during])
    assert (state.pressed, state.release_count, state.cancel_count) == (False, 0, 1)
    assert state.cancel_reason is reason
    assert not run([Seen(NEAR)], state=state).pressed


@pytest.mark.parametrize("gap", [LOST, Seen(None), Seen(float("nan")), Seen(0.0), Seen(-0.1), Seen(float("inf"))])
def test_a_short_gap_ends_no_press_and_is_no_distance(gap: Seen) -> None:
    state = run([Seen(FAR), Seen(NEAR), Seen(NEAR), *[gap] * GAP_FRAMES])
    assert state.pressed
    assert run([Seen(NEAR), Seen(FAR)], state=state).release_count == 1
    assert not run([Seen(FAR), gap]).pressed


def test_a_hand_that_is_outside_after_a_gap_commands_once_it_is_seen_there_twice() -> None:
    state = run([Seen(FAR), Seen(NEAR), Seen(NEAR), Seen(NEAR), LOST, Seen(FAR)])
    assert (state.pressed, state.release_count, state.cancel_count) == (True, 0, 0)
    assert run([Seen(FAR)], state=state).release_count == 1
    assert run([LOST, Seen(FAR), Seen(NEAR)], state=state).release_count == 0, "keypoints that slipped slip back"
    lost = run([LOST] * (GAP_FRAMES + 1), state=state)
    assert (lost.pressed, lost.release_count, lost.cancel_reason) == (False, 0, PressCancel.HAND_LOST)


@pytest.mark.parametrize("rate_hz", [30, 45, 60, 90, 120])
def test_a_fast_camera_loses_a_hand_no_sooner_than_one_of_30_hz(rate_hz: int) -> None:
    state = run([Seen(FAR), Seen(NEAR), Seen(NEAR)])
    measured_ns = state.last_captured_ns
    while state.pressed:
        state = step(state, LOST, after_ns=round(1e9 / rate_hz))
    assert state.cancel_reason is PressCancel.HAND_LOST
    assert state.compared is not None
    assert state.compared.gap_frames == state.compared.gap_limit_frames
    assert (GAP_FRAMES + 0.5) * FRAME_NS <= state.last_captured_ns - measured_ns < (GAP_FRAMES + 1.5) * FRAME_NS


@pytest.mark.parametrize("after_ns", [STALE_NS + 1, -FRAME_NS])
def test_a_camera_that_pauses_or_jumps_in_time_cancels(after_ns: int) -> None:
    pressed = run([Seen(FAR), Seen(NEAR), Seen(NEAR)])
    state = step(pressed, Seen(FAR), after_ns=after_ns)
    assert (state.pressed, state.release_count, state.cancel_count) == (False, 0, 1)
    assert state.cancel_reason is PressCancel.CAMERA_PAUSED


def test_a_frame_given_twice_changes_nothing() -> None:
    state = run([Seen(FAR), Seen(NEAR), Seen(NEAR)])
    assert step(state, Seen(FAR), after_ns=0) is state


@pytest.mark.parametrize(
    ("frames", "hint"),
    [
        ([Seen(NEAR)] * 9, PressHint.WITHDRAW_FIRST),
        ([Seen(FAR), *[LOST] * 3, Seen(NEAR)], PressHint.WITHDRAW_FIRST),
        ([Seen(FAR, None), Seen(NEAR, None), Seen(NEAR)], PressHint.GESTURE_FIRST),
        ([Seen(FAR), Seen(NEAR, box=BESIDE), Seen(NEAR)], PressHint.OVER_BUTTON),
    ],
    ids=["appeared near", "appeared near after a loss", "gesture made near", "slid in sideways"],
)
def test_what_was_no_push_from_outside_does_not_press_and_reports_why(frames: list[Seen], hint: PressHint) -> None:
    state = run(frames)
    assert not state.pressed
    assert state.hint is hint
    assert run([Seen(FAR), Seen(NEAR), Seen(NEAR)], state=state).pressed


@pytest.mark.parametrize("gap", [LOST, Seen(None)])
def test_a_hint_does_not_outlive_the_hand_that_it_was_for(gap: Seen) -> None:
    hinted = run([Seen(FAR), Seen(NEAR, box=BESIDE), *[gap] * GAP_FRAMES])
    assert hinted.hint is PressHint.OVER_BUTTON
    gone = step(hinted, gap)
    assert gone.hint is None
    assert step(gone, Seen(NEAR)).hint is PressHint.WITHDRAW_FIRST


def test_a_hint_does_not_outlive_a_pause_of_the_camera() -> None:
    hinted = run([Seen(FAR), Seen(NEAR, box=BESIDE)])
    assert step(hinted, LOST, after_ns=STALE_NS + 1).hint is None
    assert step(hinted, Seen(NEAR), after_ns=STALE_NS + 1).hint is PressHint.WITHDRAW_FIRST


TURNED_BACK = [Seen(0.33), Seen(0.29), Seen(0.25), Seen(BETWEEN), Seen(0.26)]


def test_a_push_that_turns_back_before_the_threshold_presses_nothing_and_reports_why() -> None:
    assert run(TURNED_BACK[:-1]).hint is None
    turned = run(TURNED_BACK)
    assert (turned.pressed, turned.cancel_count, turned.hint) == (False, 0, PressHint.PUSH_NEARER)
    assert run([Seen(0.28)] * 6, state=turned).hint is None
    assert run([Seen(0.22), Seen(0.18)], state=turned).pressed


@pytest.mark.parametrize("frames", [
    [Seen(one.distance_m, None) for one in TURNED_BACK],  # no gesture
    [*TURNED_BACK[:3], Seen(0.242), Seen(0.28)],  # not within the hysteresis
    [Seen(BETWEEN), *[Seen(BETWEEN + 0.005 * step) for step in range(6)]],  # drifts away
    [*TURNED_BACK[:3], *[Seen(NEAR)] * 3, Seen(0.26), Seen(0.30), Seen(0.33)],  # a press that was released
    [*TURNED_BACK[:3], *[Seen(NEAR, Gesture.SIX)] * 2, Seen(0.26), Seen(0.30)],  # refused, with its own hint
    [*TURNED_BACK[:4], LOST, LOST, LOST, Seen(0.26), Seen(0.30)],  # lost: what it did meanwhile, nobody saw
])  # fmt: skip
def test_what_was_no_such_push_is_not_told_to_come_nearer(frames: list[Seen]) -> None:
    state = ButtonState()
    for observed in frames:
        state = step(state, observed)
        assert state.hint is not PressHint.PUSH_NEARER, observed


def test_the_hysteresis_holds_at_its_boundaries() -> None:
    assert not run([Seen(OUTSIDE_M), Seen(NEAR), Seen(NEAR)]).pressed
    assert not run([Seen(FAR), *[Seen(PLACE.threshold_m)] * 2]).pressed
    pressed = run([Seen(OUTSIDE_M + 1e-9), *[Seen(PLACE.threshold_m - 1e-9)] * 2])
    assert pressed.pressed
    held = run([Seen(OUTSIDE_M)], state=pressed)
    assert held.pressed
    assert run([Seen(OUTSIDE_M + 1e-9)], state=held).release_count == 1


@pytest.mark.parametrize("rate_hz", [6, 8, 10, 15, 20, 24, 30])
@pytest.mark.parametrize("hidden", [0, 1, GAP_FRAMES])
def test_a_hand_measured_near_in_a_single_frame_is_a_slip_and_commands_nothing(rate_hz: int, hidden: int) -> None:
    """hidden: of the frames after it."""
    state = ButtonState()
    for observed in [Seen(FAR), Seen(NEAR), *[LOST] * hidden, *[Seen(FAR)] * 3]:
        state = step(state, observed, after_ns=round(1e9 / rate_hz))
    assert (state.pressed, state.release_count, state.cancel_count) == (False, 0, 1)
    assert state.cancel_reason is PressCancel.TOO_SHORT or (hidden + 1) / rate_hz > STALE_NS / 1e9


@pytest.mark.parametrize("near", [NEAR, BETWEEN])
def test_a_hand_measured_near_in_a_second_frame_commands(near: float) -> None:
    for rate_hz in (8, 15, 30):
        state = ButtonState()
        for observed in (Seen(FAR), Seen(NEAR), Seen(near), Seen(FAR)):
            state = step(state, observed, after_ns=round(1e9 / rate_hz))
        assert state.release_count == 1
        assert (state.released_pressed_ns, state.released_ns) == (2 * round(1e9 / rate_hz), 4 * round(1e9 / rate_hz))


def test_a_gesture_made_meanwhile_is_not_what_the_push_began_with() -> None:
    state = run([Seen(FAR), Seen(BETWEEN, Gesture.SIX), Seen(NEAR, Gesture.SIX), Seen(NEAR, Gesture.SIX)])
    assert not state.pressed
    assert state.hint is PressHint.KEEP_GESTURE


@pytest.mark.parametrize(("replaced", "in_force_ns", "presses"), [
    (True, SETTLING_NS - 1, False), (True, SETTLING_NS, True), (False, 0, True),
])  # fmt: skip
def test_a_gesture_that_just_took_anothers_place_does_not_press(
    replaced: bool, in_force_ns: int, presses: bool
) -> None:
    outside = run([Seen(FAR)] * 10)
    captured_ns = outside.last_captured_ns + FRAME_NS
    pushed = ButtonInput(
        captured_ns=captured_ns,
        gesture=Gesture.FIVE,
        recognised_ns=captured_ns - in_force_ns,
        replaced=replaced,
        distance_m=NEAR,
        beside_px=0.0,
    )
    state = advance(outside, pushed, PLACE, ButtonMode.ROBUST)
    assert state.pressed == presses
    assert (state.hint is PressHint.KEEP_GESTURE) == (not presses)


def test_a_hand_that_comes_faster_than_a_hand_can_is_no_push_and_reported() -> None:
    leap = run([Seen(FAR + 0.5), Seen(NEAR), Seen(NEAR)])
    assert not leap.pressed
    assert leap.hint is PressHint.PUSH_STEADILY


@pytest.mark.parametrize("lost", range(1, GAP_FRAMES + 2))
def test_an_approach_goes_on_over_a_short_gap_no_farther_than_in_one_frame(lost: int) -> None:
    gap = [LOST] * lost
    assert run([Seen(FAR), *gap, Seen(NEAR)]).pressed is (lost <= GAP_FRAMES)
    leap = run([Seen(NEAR + APPROACH_M_S * FRAME_NS / 1e9 + 0.01), *gap, Seen(NEAR), Seen(NEAR)])
    assert not leap.pressed
    assert leap.hint is (PressHint.PUSH_STEADILY if lost <= GAP_FRAMES else PressHint.WITHDRAW_FIRST)


@pytest.mark.parametrize("rate_hz", [30, 48, 60, 90, 120])
def test_a_hole_at_the_threshold_hides_as_much_of_a_push_at_every_rate(rate_hz: int) -> None:
    """In about a frame of 30 Hz a hand comes as near as at 30 Hz, and no nearer."""
    for outside_m, presses in ((NEAR + 0.11, True), (NEAR + 0.12, False)):
        state = ButtonState()
        for observed in [*[Seen(outside_m)] * 3, *[LOST] * (math.ceil(rate_hz / 30) - 1), Seen(NEAR)]:
            state = step(state, observed, after_ns=round(1e9 / rate_hz))
        assert (state.pressed, state.hint) == (presses, None if presses else PressHint.PUSH_STEADILY)


@pytest.mark.parametrize(("fall_m", "presses"), [(0.004, False), (0.005, False), (0.009, True), (0.02, True)])
def test_a_hand_that_drifts_across_the_threshold_is_no_push_and_reported(fall_m: float, presses: bool) -> None:
    distances = [FAR - fall_m * frame for frame in range(int((FAR - NEAR) / fall_m))]
    state = run([Seen(distance) for distance in distances])
    assert state.pressed is presses
    assert state.hint is (None if presses else PressHint.APPROACH_FIRST)
    assert run([Seen(FAR), Seen(NEAR), Seen(NEAR)], state=run([Seen(FAR)], state=state)).pressed


@pytest.mark.parametrize(("rate_hz", "hint"), [(5.0, PressHint.MORE_IMAGES), (6.0, None)])
def test_a_push_of_which_too_few_images_come_does_not_press_and_is_reported(
    rate_hz: float, hint: PressHint | None
) -> None:
    state = ButtonState()
    for distance_m in (0.30, 0.30, 0.25, NEAR, NEAR):
        state = step(state, Seen(distance_m), after_ns=round(1e9 / rate_hz))
    assert (state.pressed, state.hint) == (hint is None, hint)


def test_a_hand_that_hovers_about_the_threshold_never_presses() -> None:
    state = ButtonState()
    for frame in range(600):
        state = step(state, Seen(BETWEEN + 0.04 * math.cos(2 * math.pi * 0.3 * frame / 30)))
        assert not state.pressed
    assert state.hint is PressHint.APPROACH_FIRST or state.ready


@pytest.mark.parametrize(
    ("fall_m", "approaching"), [(-0.010, False), (0.0, False), (0.002, False), (0.004, True), (0.010, True)]
)
def test_a_hand_approaches_when_it_came_nearer_by_half_of_what_a_press_needs(fall_m: float, approaching: bool) -> None:
    state = run([Seen(0.35 - fall_m * frame) for frame in range(6)])  # 166 ms: five times the fall
    assert is_approaching(state, PLACE) is approaching
    assert is_approaching(step(state, LOST), PLACE) is approaching
    assert not is_approaching(run([LOST] * (GAP_FRAMES + 1), state=state), PLACE)


@pytest.mark.parametrize(
    ("distances_m", "near"),
    [
        ([FAR], False),
        ([PLACE.release_m + 0.001], False),
        ([PLACE.release_m], True),
        ([NEAR], True),
    ],
)
def test_a_hand_within_the_release_distance_holds_its_gesture_as_in_a_press(
    distances_m: list[float], near: bool
) -> None:
    state = run([Seen(distance_m) for distance_m in distances_m])
    assert not state.pressed
    assert is_near(state, PLACE) is near


@pytest.mark.parametrize(("still_frames", "commands"), [(0, 1), (5, 0)])
def test_a_gesture_misread_for_eight_frames_is_kept_only_while_the_hand_comes_nearer(
    still_frames: int, commands: int
) -> None:
    approach_m = [0.33 + (NEAR - 0.33) * share for share in (0.02, 0.10, 0.22, 0.36, 0.52, 0.68, 0.84, 1.0)]
    path = [
        *((0.33, Gesture.ZERO) for _ in range(5)),
        *((0.33, None) for _ in range(still_frames)),
        *((distance_m, None) for distance_m in approach_m),
        *((distance_m, Gesture.ZERO) for distance_m in (NEAR, NEAR, NEAR, 0.20, FAR, 0.33)),
    ]
    now = Recognition()
    for frame, (distance_m, gesture) in enumerate(path, 1):
        reading = FrameReading(
            captured_ns=frame * FRAME_NS,
            hand=1,
            gesture=gesture,
            cut_off=False,
            distance_m=distance_m,
            beside_px=0.0,
        )
        now = recognise(now, reading, PLACE, ButtonMode.ROBUST)
    assert now.button.release_count == commands


def test_a_press_needs_the_centre_and_keeps_within_the_radius() -> None:
    assert not run([Seen(FAR), *[Seen(NEAR, box=EDGE)] * 2]).pressed
    assert run([Seen(FAR), Seen(NEAR), Seen(NEAR), Seen(NEAR, box=EDGE)]).pressed


def test_published_takes_a_zero_for_a_press_and_a_loss_for_a_release() -> None:
    assert run([Seen(0.0)], ButtonMode.PUBLISHED).pressed
    state = run([Seen(NEAR, Gesture.SEVEN), LOST], ButtonMode.PUBLISHED)
    assert (state.release_count, state.released_gesture) == (1, Gesture.FIVE)
    silent = run([Seen(NEAR, None), Seen(FAR, None)], ButtonMode.PUBLISHED)
    assert (silent.pressed, silent.release_count) == (False, 0)


def is_command(path: Sequence[Seen]) -> bool:
    """The rule in other words: whether the last frame of a path withdraws a push that began outside.

    The path begins after the newest cancel: what led to it, and the frame itself, count for nothing.
    """
    last = path[-1]
    if not (last.distance_m is not None and last.distance_m > OUTSIDE_M and last.box is OVER and last.gesture):
        return False
    if len(path) < 2 or path[-2].distance_m is None:
        return False
    gap = 0
    for index in range(len(path) - 2, 0, -1):
        observed = path[index]
        gap = gap + 1 if observed.distance_m is None else 0
        if gap > GAP_FRAMES:
            return False
        if observed.distance_m is None:
            continue
        seen_withdrawing = observed.distance_m > OUTSIDE_M and path[index - 1].distance_m is not None
        if seen_withdrawing or observed.gesture is not last.gesture or observed.box is not OVER:
            return False
        if is_push(path, index):
            measured_near = any(
                one.distance_m is not None and one.distance_m <= OUTSIDE_M for one in path[index + 1 : -1]
            )
            return measured_near and (len(path) - 1 - index) * FRAME_NS >= SHORTEST_PRESS_NS
    return False


def near(observed: Seen) -> bool:
    return observed.distance_m is not None and observed.distance_m < PLACE.threshold_m


def is_push(path: Sequence[Seen], index: int) -> bool:
    """Whether the press is this frame: near, over the button, and the first such since the outside, over short gaps."""
    observed = path[index]
    if index < 1 or not (near(observed) and observed.gesture and observed.box is OVER):
        return False
    gap = 0
    for earlier in range(index - 1, -1, -1):
        before = path[earlier]
        gap = gap + 1 if before.distance_m is None else 0
        if before.distance_m is not None and before.distance_m > OUTSIDE_M:
            return before.gesture is observed.gesture
        if gap > GAP_FRAMES or near(before):
            return False
    return False


ALPHABET = (
    *(Seen(d, g, b) for d, g, b in itertools.product((FAR, NEAR), (Gesture.FIVE, None), (OVER, BESIDE))),
    Seen(FAR, Gesture.SIX),
    Seen(NEAR, Gesture.SIX),
    Seen(BETWEEN),
    LOST,
)


def test_every_short_sequence_commands_exactly_when_the_rule_requires() -> None:
    commands = 0
    fronts: list[tuple[tuple[Seen, ...], ButtonState]] = [((), ButtonState())]
    for _ in range(5):
        grown = []
        for path, state in fronts:
            for observed in ALPHABET:
                after = step(state, observed)
                longer = (*path, observed)
                assert (after.release_count > state.release_count) == is_command(longer), longer
                commands += after.release_count - state.release_count
                grown.append((() if after.cancel_count > state.cancel_count else longer, after))
        fronts = grown
    assert commands > 40


@given(st.lists(st.sampled_from(ALPHABET), max_size=60))
def test_long_sequences_command_exactly_when_the_rule_requires(frames: list[Seen]) -> None:
    state, path = ButtonState(), list[Seen]()
    for observed in frames:
        after = step(state, observed)
        path.append(observed)
        assert (after.release_count > state.release_count) == is_command(path)
        ended = state.pressed and not after.pressed
        assert ended == (after.release_count + after.cancel_count > state.release_count + state.cancel_count)
        if after.cancel_count > state.cancel_count:
            path.clear()
        state = after
