from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.frame_time import FRAME_NS
from kgdfa.gesture import (
    ALTERNATING_NS,
    END_FRAMES,
    LONGEST_UNSEEN_NS,
    PRESS_CHANGE_FRAMES,
    PRESS_END_FRAMES,
    VOTE_FRAMES,
    Gesture,
    Vote,
    update_vote,
)

ONE, TWO = Gesture.ONE, Gesture.TWO
spoken = st.lists(st.sampled_from([None, Gesture.ONE, Gesture.TWO, Gesture.FIVE]), max_size=60)


def votes(gestures: list[Gesture | None]) -> list[Vote]:
    vote, out = Vote(), []
    for number, gesture in enumerate(gestures):
        vote = update_vote(vote, gesture, number * FRAME_NS)
        out.append(vote)
    return out


def test_the_third_frame_in_a_row_makes_a_gesture() -> None:
    assert [vote.gesture for vote in votes([ONE, ONE, ONE, ONE])] == [None, None, ONE, ONE]


@given(spoken)
def test_a_gesture_begins_only_after_three_frames_in_a_row(gestures: list[Gesture | None]) -> None:
    before: Gesture | None = None
    for number, vote in enumerate(votes(gestures)):
        if vote.gesture is not None and vote.gesture is not before:
            assert gestures[number - VOTE_FRAMES + 1 : number + 1] == [vote.gesture] * VOTE_FRAMES
            assert vote.recognised_ns == number * FRAME_NS
        before = vote.gesture


@given(spoken, st.sampled_from([ONE, TWO]))
def test_a_new_gesture_is_never_late(past: list[Gesture | None], new: Gesture) -> None:
    assert votes([*past, *[new] * VOTE_FRAMES])[-1].gesture is new


@given(spoken, st.lists(st.sampled_from([None, TWO]), max_size=VOTE_FRAMES - 1))
def test_two_odd_frames_never_end_a_held_gesture(past: list[Gesture | None], odd: list[Gesture | None]) -> None:
    held = [*past, *[ONE] * VOTE_FRAMES, *odd]
    assert votes(held)[-1].gesture is ONE


@given(spoken)
def test_timeouts_end_everything_in_time(past: list[Gesture | None]) -> None:
    after = votes([*past, *[None] * END_FRAMES])
    assert after[-1].gesture is None if after else True
    assert all(vote.gesture is not None or vote.recognised_ns == 0 for vote in after)


@given(spoken)
def test_flicker_between_two_gestures_never_starts_one(past: list[Gesture | None]) -> None:
    flicker: list[Gesture | None] = [ONE, TWO] * 10
    ends = votes([*past, *[None] * END_FRAMES, *flicker])
    assert ends[-1].gesture is None


@given(spoken, st.booleans())
def test_a_gesture_that_comes_nearer_ends_as_late_as_in_a_press_and_gives_way_as_early_as_ever(
    past: list[Gesture | None], approaching: bool
) -> None:
    vote = votes([*past, *[ONE] * VOTE_FRAMES])[-1]
    end = PRESS_END_FRAMES if approaching else END_FRAMES
    for number in range(1, end + 1):
        assert vote.gesture is ONE
        vote = update_vote(vote, None, (1000 + number) * FRAME_NS, approaching=approaching)
    assert vote.gesture is None
    for number in range(VOTE_FRAMES):
        vote = update_vote(vote, TWO, (2000 + number) * FRAME_NS, approaching=approaching)
    assert vote.gesture is TWO


@pytest.mark.parametrize(("nothing", "then", "replaced"), [
    (0, TWO, True), (END_FRAMES, TWO, True), (END_FRAMES + 3, TWO, True), (END_FRAMES + 4, TWO, False),
    (END_FRAMES, ONE, False), (END_FRAMES + 3, ONE, False),
])  # fmt: skip
def test_a_gesture_replaces_another_that_was_in_force_less_than_a_fifth_of_a_second_before(
    nothing: int, then: Gesture, replaced: bool
) -> None:
    assert not votes([ONE] * VOTE_FRAMES)[-1].replaced
    vote = votes([*[ONE] * VOTE_FRAMES, *[None] * nothing, *[then] * VOTE_FRAMES])[-1]
    assert (vote.gesture, vote.replaced) == (then, replaced)


@pytest.mark.parametrize(("newest", "contradicted"), [
    ([ONE], False), ([TWO], False), ([TWO, TWO], True), ([TWO, None], False), ([TWO, ONE], False), ([None] * 2, False),
])  # fmt: skip
def test_two_frames_in_a_row_of_another_gesture_contradict_the_one_in_force(
    newest: list[Gesture | None], contradicted: bool
) -> None:
    vote = votes([*[ONE] * VOTE_FRAMES, *newest])[-1]
    assert (vote.gesture, vote.contradicted) == (ONE, contradicted)


@pytest.mark.parametrize("rate_hz", [15, 30, 45, 60, 90, 120])
@pytest.mark.parametrize(
    ("frames", "pressing", "shown"),
    [
        (VOTE_FRAMES, False, TWO),
        (END_FRAMES, False, None),
        (PRESS_CHANGE_FRAMES, True, TWO),
        (PRESS_END_FRAMES, True, None),
    ],
)
def test_a_fast_camera_shows_a_change_as_long_as_one_of_30_hz(
    rate_hz: int, frames: int, pressing: bool, shown: Gesture | None
) -> None:
    vote, period_ns = votes([ONE] * VOTE_FRAMES)[-1], round(1e9 / rate_hz)
    now_ns, count = vote.recognised_ns, 0
    while vote.gesture is ONE:
        count, now_ns = count + 1, now_ns + period_ns
        vote = update_vote(vote, shown, now_ns, pressing=pressing)
    assert vote.gesture is shown
    assert count == max(frames, 1 + math.ceil((frames - 1.2) * FRAME_NS / period_ns))


@pytest.mark.parametrize("rate_hz", [60, 90, 120])
def test_misreadings_of_two_frames_at_30_hz_make_no_vote_at_a_faster_rate(rate_hz: int) -> None:
    vote = Vote()
    for number in range(2 * rate_hz // 30):
        vote = update_vote(vote, ONE, 1_000_000_000 + number * round(1e9 / rate_hz))
    assert vote.gesture is None
    assert vote.votes < VOTE_FRAMES


@pytest.mark.parametrize("rate_hz", [7.5, 10, 15, 30])
def test_what_is_timed_ends_after_half_a_second_at_every_frame_rate(rate_hz: float) -> None:
    vote, period_ns = votes([ONE] * VOTE_FRAMES)[-1], round(1e9 / rate_hz)
    now_ns = first_ns = vote.recognised_ns + period_ns
    while (vote := update_vote(vote, None, now_ns, approaching=True, timed=True)).gesture is ONE:
        now_ns += period_ns
    assert LONGEST_UNSEEN_NS <= now_ns - first_ns < LONGEST_UNSEEN_NS + period_ns


def test_a_gesture_held_for_long_keeps_few_captures() -> None:
    vote = Vote()
    for number in range(600):
        vote = update_vote(vote, ONE, number * FRAME_NS // 4)
    assert vote.candidate_ns[-1] - vote.candidate_ns[0] < PRESS_CHANGE_FRAMES * FRAME_NS


def read(gestures: list[Gesture | None]) -> list[Vote]:
    """As before a camera, where gestures read in turn are refused."""
    vote, out = Vote(), []
    for number, gesture in enumerate(gestures):
        vote = update_vote(vote, gesture, number * FRAME_NS, refuse_alternating=True)
        out.append(vote)
    return out


@given(st.lists(st.sampled_from([[TWO] * 2, [TWO] * 5, [TWO, None, TWO, TWO]]), min_size=3, max_size=6))
def test_of_two_gestures_read_in_turn_neither_is_in_force(runs: list[list[Gesture | None]]) -> None:
    flicker = [gesture for run in runs for gesture in (*[ONE] * VOTE_FRAMES, *run)]
    (*_, last) = read([*[ONE] * VOTE_FRAMES, *flicker])
    assert last.gesture is None
    assert {last.read, last.read_before} == {ONE, TWO}


def test_an_alternating_gesture_is_in_force_again_once_it_was_read_alone_for_two_seconds() -> None:
    flicker: list[Gesture | None] = [*[ONE] * 3, *[TWO] * 3] * 3
    frames = read([*flicker, *[ONE] * (ALTERNATING_NS // FRAME_NS + VOTE_FRAMES)])
    assert frames[len(flicker) + VOTE_FRAMES].gesture is None
    assert frames[-1].gesture is ONE


@given(st.permutations([*Gesture]), st.integers(VOTE_FRAMES, 12))
def test_gestures_one_after_the_other_never_alternate(shown: list[Gesture], frames: int) -> None:
    for number, vote in enumerate(read([gesture for gesture in shown for _ in range(frames)])):
        assert not vote.alternates(number * FRAME_NS)


@given(spoken)
def test_single_frames_of_another_gesture_change_nothing(odd: list[Gesture | None]) -> None:
    held = [gesture for one in odd for gesture in (ONE, ONE, one)]
    assert all(vote.gesture is ONE for vote in read([*[ONE] * VOTE_FRAMES, *held])[VOTE_FRAMES:])


def test_gestures_that_alternate_in_a_press_leave_it_its_gesture() -> None:
    vote = read([ONE] * VOTE_FRAMES)[-1]
    for number, gesture in enumerate([*[TWO] * 2, *[ONE] * 2] * 5, start=VOTE_FRAMES):
        vote = update_vote(vote, gesture, number * FRAME_NS, pressing=True, refuse_alternating=True)
        assert vote.gesture is ONE


def test_gestures_that_alternated_in_a_press_are_no_reason_to_refuse_one_after_it() -> None:
    vote = read([ONE] * VOTE_FRAMES)[-1]
    pressed = [*[TWO] * 2, *[ONE] * 2] * 5
    for number, gesture in enumerate([*pressed, *[ONE] * 5], start=VOTE_FRAMES):
        pressing = number < VOTE_FRAMES + len(pressed)
        vote = update_vote(vote, gesture, number * FRAME_NS, pressing=pressing, refuse_alternating=True)
    assert vote.gesture is ONE


def test_what_alternated_before_an_approach_takes_no_gesture_in_it() -> None:
    flicker: list[Gesture | None] = [*[ONE] * 3, *[TWO] * 3] * 3
    vote = read(flicker)[-1]
    for number in range(len(flicker), len(flicker) + 10):
        vote = update_vote(vote, TWO, number * FRAME_NS, approaching=True, refuse_alternating=True)
        assert vote.gesture is None
