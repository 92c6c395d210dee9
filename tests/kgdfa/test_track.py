from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.hand import Hand, Side
from kgdfa.track import (
    AMBIGUOUS,
    EQUAL_CLAIM,
    LOST_FRAMES,
    STILL_NS,
    Enrolment,
    HandRefusal,
    Tracks,
    arm_rad,
    update_tracks,
)
from tests.kgdfa.hands import drawn_hand

HERE = drawn_hand("ooooo")
ELSEWHERE = drawn_hand("fffff", at_px=(900.0, 0.0), scale=1.5)
FRAME_NS = 33_000_000
RIGHT, LEFT = Enrolment(side=Side.RIGHT), Enrolment(side=Side.LEFT)


def after(
    frames: Iterable[tuple[Hand, ...]], enrolment: Enrolment | None = None, tracks: Tracks | None = None
) -> Tracks:
    """The tracks after these frames."""
    tracks = tracks or Tracks()
    for number, hands in enumerate(frames, start=1):
        tracks = update_tracks(tracks, hands, number * FRAME_NS, enrolment)
    return tracks


def commanding(tracks: Tracks) -> Hand | None:
    return tracks.commanding.hand if tracks.commanding else None


def refusal(tracks: Tracks) -> object:
    return tracks.refusal.code if tracks.refusal else None


def rolled(hand: Hand, angle_rad: float) -> Hand:
    """The hand turned clockwise about its palm."""
    x, y = hand.palm_centre_px.tolist()
    turn = cv2.getRotationMatrix2D((x, y), -math.degrees(angle_rad), 1.0)
    return replace(hand, image_px=np.column_stack([hand.image_px, np.ones(21)]) @ turn.T)


def of(side: Side, hand: Hand = HERE, score: float = 0.95) -> Hand:
    return replace(hand, side=side, presence=score)


def moved(hand: Hand, x_px: float) -> Hand:
    return replace(hand, image_px=hand.image_px + np.array([x_px, 0.0]))


def test_the_largest_hand_commands() -> None:
    small = drawn_hand("ooooo", scale=EQUAL_CLAIM * 1.5 * 0.9, at_px=(-900.0, 0.0))
    tracks = after([(small, ELSEWHERE)])
    assert commanding(tracks) is ELSEWHERE
    assert refusal(tracks) is None


def test_two_equal_hands_command_nothing_until_one_goes() -> None:
    tracks = after([(HERE, drawn_hand("ooooo", at_px=(600.0, 0.0)))])
    assert (commanding(tracks), refusal(tracks)) == (None, HandRefusal.TWO_HANDS)
    assert commanding(after([(HERE,)], tracks=tracks)) is HERE


@given(st.lists(st.booleans(), min_size=1, max_size=30), st.sampled_from([None, RIGHT]))
def test_a_second_larger_hand_never_steals(second_is_there: list[bool], enrolment: Enrolment | None) -> None:
    tracks = after([(HERE,)] * 3, enrolment)
    for there in second_is_there:
        tracks = after([(ELSEWHERE, HERE) if there else (HERE,)], enrolment, tracks)
        assert commanding(tracks) is HERE
        assert tracks.number == 1


@given(st.integers(1, LOST_FRAMES))
def test_a_hand_lost_briefly_is_the_same_hand(gone: int) -> None:
    tracks = after([(HERE,)])
    for _ in range(gone):
        tracks = after([(ELSEWHERE,) if gone % 2 else ()], tracks=tracks)
        assert commanding(tracks) is None
    back = after([(HERE,)], tracks=tracks)
    assert commanding(back) is HERE
    assert back.number == 1


def test_a_hand_gone_for_good_makes_room_for_another() -> None:
    tracks = after([(HERE,), *[(ELSEWHERE,)] * (LOST_FRAMES + 1)])
    assert commanding(tracks) is ELSEWHERE
    assert tracks.number == 2


@pytest.mark.parametrize(("enrolment", "other"), [(RIGHT, Side.LEFT), (LEFT, Side.RIGHT)])
def test_the_other_side_is_refused_with_its_evidence(enrolment: Enrolment, other: Side) -> None:
    tracks = after([(of(other),)] * 3, enrolment)
    assert commanding(tracks) is None
    assert tracks.refusal is not None
    assert tracks.refusal.code is HandRefusal.OTHER_SIDE
    assert (tracks.refusal.values["side"], tracks.refusal.values["enrolled"]) == (other, enrolment.side)


def test_either_side_commands_where_the_profile_says_either() -> None:
    for side in Side:
        tracks = after([(of(side),)] * 3, Enrolment())
        assert tracks.known
        assert commanding(tracks) is not None


def test_nothing_is_known_before_a_vote_is() -> None:
    assert [after([(HERE,)] * frames, RIGHT).known for frames in (1, 2, 3)] == [False, False, True]


@given(st.lists(st.integers(0, 7), max_size=20))
def test_a_known_side_survives_frames_that_flip(flips: list[int]) -> None:
    """Seven sure frames of the other side, and as many of its own, do not turn it over."""
    tracks = after([(of(Side.RIGHT),)] * 12, RIGHT)
    for count in flips:
        tracks = after([*[(of(Side.LEFT),)] * count, *[(of(Side.RIGHT),)] * 4], RIGHT, tracks)
        assert commanding(tracks) is not None


def test_a_gesture_of_ambiguous_side_turns_nothing_over_at_once() -> None:
    tracks = after([(of(Side.RIGHT),)] * 30, RIGHT)
    for number in range(31, 61):
        tracks = update_tracks(tracks, (of(Side.LEFT),), number * FRAME_NS, RIGHT, [AMBIGUOUS])
    assert commanding(tracks) is not None


def test_frames_without_a_gesture_tell_no_side() -> None:
    tracks = Tracks()
    for number in range(20):
        tracks = update_tracks(tracks, (of(Side.LEFT, moved(HERE, number)),), number * FRAME_NS, RIGHT, [0.0])
    assert (tracks.known, commanding(tracks) is not None) == (False, True)


def test_a_hand_that_comes_back_soon_is_still_known() -> None:
    lost = after([*[(HERE,)] * 10, *[()] * (LOST_FRAMES + 2)], RIGHT)
    again = update_tracks(lost, (of(Side.LEFT),), 19 * FRAME_NS, RIGHT)
    assert again.followed[0].side is Side.RIGHT
    late = update_tracks(lost, (of(Side.LEFT),), 60 * FRAME_NS, RIGHT)
    assert late.followed[0].side is None


def test_a_hand_that_grows_at_once_is_another_hand() -> None:
    tracks = after([(HERE,)] * 5, RIGHT)
    points = HERE.palm_centre_px + 1.8 * (HERE.image_px - HERE.palm_centre_px)
    grown = (replace(HERE, image_px=points),)
    assert update_tracks(tracks, grown, 6 * FRAME_NS, RIGHT).made == 2
    assert update_tracks(tracks, grown, 8 * FRAME_NS, RIGHT).made == 1  # at 10 frames a second a push does so


def test_a_known_hand_displaces_one_that_is_not_known() -> None:
    resting = of(Side.LEFT, ELSEWHERE, 0.5)
    tracks = after([*[(resting,)] * 5, *[(resting, HERE)] * 4], RIGHT)
    assert commanding(tracks) is HERE


def test_a_hand_that_stays_the_other_side_is_another_hand() -> None:
    tracks = after([(of(Side.RIGHT),)] * 30, RIGHT)
    assert refusal(after([(of(Side.LEFT),)] * 10, RIGHT, tracks)) is HandRefusal.OTHER_SIDE


def test_an_unclear_side_commands_nothing_and_says_so() -> None:
    tracks = after([(of(Side.RIGHT, moved(HERE, 40 * (k % 2)), 0.51),) for k in range(30)], RIGHT)
    assert not tracks.known
    assert refusal(tracks) is HandRefusal.SIDE_UNCLEAR


@pytest.mark.parametrize("degrees", [-180, -120, -90, -45, 0, 45, 90, 150])
def test_the_arm_is_where_the_hand_is_turned_from(degrees: int) -> None:
    upright = arm_rad(HERE)
    turned = arm_rad(rolled(HERE, math.radians(degrees)))
    assert upright is not None
    assert turned is not None
    assert math.remainder(turned - upright - math.radians(degrees), math.tau) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("degrees", "refused"), [(0, False), (50, False), (-50, False), (95, True), (-95, True)])
def test_an_arm_from_elsewhere_is_refused(degrees: int, refused: bool) -> None:
    tracks = after([(rolled(HERE, math.radians(degrees)),)] * 3, RIGHT)
    assert (refusal(tracks) is HandRefusal.OTHER_ARM) is refused


def test_an_arm_that_came_from_below_may_turn_later() -> None:
    turning = [(rolled(HERE, math.radians(min(100, max(0, 10 * (k - 10))))),) for k in range(40)]
    assert commanding(after(turning, RIGHT)) is not None


def test_a_hand_that_turns_at_once_is_another_hand() -> None:
    """As when the tracker slips from one hand to one that crosses it."""
    tracks = after([(HERE,)] * 12, RIGHT)
    slipped = after([(rolled(HERE, math.radians(-95)),)] * (LOST_FRAMES + 1), RIGHT, tracks)
    assert slipped.made == 2
    assert refusal(slipped) is HandRefusal.OTHER_ARM


def test_the_enrolled_hand_commands_beside_a_larger_refused_one() -> None:
    other = of(Side.LEFT, ELSEWHERE)
    tracks = after([*[(other,)] * 5, *[(other, HERE)] * 4], RIGHT)
    assert commanding(tracks) is HERE
    assert refusal(tracks) is None


def test_a_picture_of_a_hand_is_refused_until_it_moves() -> None:
    frames = STILL_NS // FRAME_NS + 3
    noise = np.random.default_rng(1)
    picture = [(replace(HERE, image_px=HERE.image_px + noise.normal(0, 1.0, (21, 2))),) for _ in range(frames)]
    tracks = after(picture, RIGHT)
    assert (commanding(tracks), refusal(tracks)) == (None, HandRefusal.STILL)
    assert commanding(after([(moved(HERE, 40),)], RIGHT, tracks)) is not None
    assert commanding(after([*picture, *[(moved(HERE, 40),)] * 2], RIGHT)) is not None


def test_a_wrist_guessed_out_of_the_image_makes_no_other_hand_but_a_larger_palm_does() -> None:
    guessed_px = HERE.image_px.copy()
    guessed_px[0] = HERE.palm_centre_px + 2 * (guessed_px[0] - HERE.palm_centre_px)
    guessed = replace(HERE, image_px=guessed_px)
    assert guessed.palm_px > 1.7 * HERE.palm_px
    tracks = after([(HERE,), (guessed,), (HERE,)])
    assert (tracks.made, commanding(tracks)) == (1, HERE)
    middle = HERE.image_px.mean(axis=0)
    larger = replace(HERE, image_px=middle + 1.8 * (HERE.image_px - middle))
    assert after([(HERE,), (larger,)]).made == 2
