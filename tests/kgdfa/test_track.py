from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from kgdfa.pipeline import EQUAL_CLAIM, LOST_FRAMES, Track, update_track
from tests.kgdfa.hands import drawn_hand

HERE = drawn_hand("ooooo")
ELSEWHERE = drawn_hand("fffff", at_px=(900.0, 0.0), scale=1.5)


def test_the_largest_hand_commands() -> None:
    small = drawn_hand("ooooo", scale=EQUAL_CLAIM * 1.5 * 0.9, at_px=(-900.0, 0.0))
    track = update_track(Track(), (small, ELSEWHERE))
    assert track.hand is ELSEWHERE
    assert not track.contested


def test_two_equal_hands_command_nothing_until_one_goes() -> None:
    track = update_track(Track(), (HERE, drawn_hand("ooooo", at_px=(600.0, 0.0))))
    assert track.hand is None
    assert track.contested
    assert update_track(track, (HERE,)).hand is HERE


@given(st.lists(st.booleans(), min_size=1, max_size=30))
def test_a_second_hand_never_steals(second_is_there: list[bool]) -> None:
    track = update_track(Track(), (HERE,))
    for there in second_is_there:
        track = update_track(track, (ELSEWHERE, HERE) if there else (HERE,))
        assert track.hand is HERE
        assert track.number == 1


@given(st.integers(1, LOST_FRAMES))
def test_a_hand_lost_briefly_is_the_same_hand(gone: int) -> None:
    track = update_track(Track(), (HERE,))
    for _ in range(gone):
        track = update_track(track, (ELSEWHERE,) if gone % 2 else ())
        assert track.hand is None
    back = update_track(track, (HERE,))
    assert back.hand is HERE
    assert back.number == 1


def test_a_hand_gone_for_good_makes_room_for_another() -> None:
    track = update_track(Track(), (HERE,))
    for _ in range(LOST_FRAMES + 1):
        track = update_track(track, (ELSEWHERE,))
    assert track.hand is ELSEWHERE
    assert track.number == 2
