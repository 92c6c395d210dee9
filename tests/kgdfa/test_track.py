from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kgdfa import frame_time
from kgdfa.button_state import GAP_FRAMES
from kgdfa.commanding import EQUAL_CLAIM, STILL_NS, UNCLEAR_FRAMES, Tracks, update_tracks
from kgdfa.continuity import DOUBTFUL_FRAMES, Jump
from kgdfa.gesture import HandRefusal
from kgdfa.hand import Hand, Side
from kgdfa.track import CONTRARY_FRAMES, LOST_FRAMES, OVERLAP_REFERENCES, SURE_ENROLLED, Enrolment, arm_rad
from tests.kgdfa.hands import drawn_hand

HERE = drawn_hand("ooooo")
ELSEWHERE = drawn_hand("fffff", at_px=(900.0, 0.0), scale=1.5)
FRAME_NS = 33_000_000
RIGHT, LEFT = Enrolment(side=Side.RIGHT), Enrolment(side=Side.LEFT)


def after(
    frames: Iterable[tuple[Hand, ...]],
    enrolment: Enrolment | None = None,
    tracks: Tracks | None = None,
    period_ns: int = FRAME_NS,
) -> Tracks:
    """The tracks after these frames."""
    tracks = tracks or Tracks()
    for hands in frames:
        tracks = update_tracks(tracks, hands, tracks.captured_ns + period_ns, enrolment)
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


def mirrored(hand: Hand) -> Hand:
    """The other hand in the same place: its palm is no turned or moved one of this."""
    x = hand.palm_centre_px[0]
    return replace(hand, image_px=np.column_stack([2 * x - hand.image_px[:, 0], hand.image_px[:, 1]]))


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


@settings(max_examples=30)
@given(st.lists(st.integers(0, CONTRARY_FRAMES - 1), max_size=8))  # less than STILL_NS
def test_a_known_side_survives_frames_that_flip(flips: list[int]) -> None:
    """Fewer sure frames of the other side than a vote has, and as many of its own, change nothing."""
    tracks = after([(of(Side.RIGHT),)] * 12, RIGHT)
    for count in flips:
        tracks = after([*[(of(Side.LEFT),)] * count, *[(of(Side.RIGHT),)] * 4], RIGHT, tracks)
        assert (commanding(tracks) is not None, tracks.known, tracks.number) == (True, True, 1)


def test_frames_without_a_gesture_tell_no_side() -> None:
    tracks = Tracks()
    for number in range(20):
        tracks = update_tracks(tracks, (of(Side.LEFT, moved(HERE, number)),), number * FRAME_NS, RIGHT, [False])
    assert (tracks.known, commanding(tracks) is not None) == (False, True)


def test_a_hand_that_comes_back_is_judged_anew() -> None:
    lost = after([*[(HERE,)] * 10, *[()] * (LOST_FRAMES + 2)], RIGHT)
    again = after([(HERE,)] * 2, RIGHT, lost)
    assert (again.known, again.number) == (False, 2)
    assert after([(HERE,)], RIGHT, again).known


def test_a_hand_that_grows_at_once_is_another_hand() -> None:
    tracks = after([(HERE,)] * 5, RIGHT)
    points = HERE.palm_centre_px + 1.8 * (HERE.image_px - HERE.palm_centre_px)
    grown = (replace(HERE, image_px=points),)
    assert update_tracks(tracks, grown, 6 * FRAME_NS, RIGHT).made == 2
    assert len(update_tracks(tracks, grown, 8 * FRAME_NS, RIGHT).followed) == 1  # at 10 frames a second a push does so


def test_a_frame_in_which_the_tracker_slipped_leaves_the_hand_its_track() -> None:
    middle = HERE.palm_centre_px
    slipped, back = (
        moved(replace(HERE, image_px=middle + scale * (HERE.image_px - middle)), 20) for scale in (0.55, 0.8)
    )
    before = after([(HERE,)] * 5, RIGHT)
    tracks = rest_of(rest_of(before, slipped), back)
    assert tracks.commanding is not None
    assert (tracks.commanding.number, tracks.commanding.hand) == (before.number, back)


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


def rest_of(tracks: Tracks, *hands: Hand) -> Tracks:
    """With one more frame."""
    return after([hands], RIGHT, tracks)


def begun(frames: int = 12) -> Tracks:
    return after([(HERE,)] * frames, RIGHT)


@pytest.mark.parametrize("slipped", [moved(HERE, 150), mirrored(HERE)], ids=["place", "shape"])
def test_a_hand_that_leaps_is_doubted_then_judged_anew_without_its_votes(slipped: Hand) -> None:
    known = []
    tracks = begun()
    for _ in range(DOUBTFUL_FRAMES):
        tracks = rest_of(tracks, slipped)
        known.append((tracks.known, tracks.number))
    assert known == [(False, 1)] * DOUBTFUL_FRAMES
    for _ in range(GAP_FRAMES):
        tracks = rest_of(tracks, slipped)
        assert (commanding(tracks), tracks.number) == (None, 1)
    tracks = rest_of(tracks, slipped)
    assert (tracks.known, tracks.number, refusal(tracks)) == (False, 2, HandRefusal.JUMPED)
    assert after([(slipped,)] * 3, RIGHT, tracks).known


@pytest.mark.parametrize("leapt", [moved(HERE, 150), mirrored(HERE)], ids=["place", "shape"])
def test_without_an_enrolment_no_hand_is_doubted(leapt: Hand) -> None:
    tracks = after([(HERE,)] * 3)
    for _ in range(DOUBTFUL_FRAMES + GAP_FRAMES + 1):
        tracks = after([(leapt,)], None, tracks)
        assert commanding(tracks) is leapt
        assert (tracks.known, tracks.number) == (True, 1)


@pytest.mark.parametrize("frames", range(1, DOUBTFUL_FRAMES + GAP_FRAMES + 1))
def test_a_hand_that_slips_back_is_the_same(frames: int) -> None:
    tracks = begun()
    for _ in range(4):
        tracks = rest_of(after([(mirrored(HERE),)] * frames, RIGHT, tracks), HERE)
        assert (tracks.known, tracks.number, refusal(tracks)) == (True, 1, None)


@pytest.mark.parametrize("rate_hz", [45, 60, 90, 120])
def test_a_fast_camera_judges_anew_no_sooner_than_one_of_30_hz(rate_hz: int) -> None:
    """A hand that leapt, one that was lost, and sure frames of the other side."""
    period_ns, begin = round(1e9 / rate_hz), begun()

    def until_anew(*hands: Hand) -> int:
        tracks = begin
        while tracks.number == begin.number and tracks.followed:
            tracks = after([hands], RIGHT, tracks, period_ns)
        return tracks.captured_ns - begin.captured_ns

    assert until_anew(mirrored(HERE)) >= (DOUBTFUL_FRAMES + GAP_FRAMES + 0.5) * frame_time.FRAME_NS
    assert until_anew() >= (LOST_FRAMES + 0.5) * frame_time.FRAME_NS
    assert until_anew(of(Side.LEFT)) >= (CONTRARY_FRAMES - 1.5) * frame_time.FRAME_NS
    for frames in range(rate_hz):
        lost = after([()] * frames, RIGHT, begin, period_ns)
        back = after([(HERE,)], RIGHT, lost, period_ns)
        survives = lost.captured_ns - begin.captured_ns < (GAP_FRAMES + 0.5) * frame_time.FRAME_NS
        assert back.number == (1 if survives else 2)


def test_sure_frames_of_the_other_side_judge_anew_and_refuse() -> None:
    tracks = after([(of(Side.LEFT),)] * CONTRARY_FRAMES, RIGHT, begun())
    assert (tracks.known, tracks.number, refusal(tracks)) == (False, 2, HandRefusal.JUMPED)
    assert tracks.refusal is not None
    assert tracks.refusal.values["jump"] is Jump.SIDE
    assert refusal(after([(of(Side.LEFT),)] * 2, RIGHT, tracks)) is HandRefusal.OTHER_SIDE


def test_a_refused_hand_is_judged_anew_by_surer_frames_than_one_that_commands() -> None:
    unsure, sure = SURE_ENROLLED - 0.01, SURE_ENROLLED
    refused = after([(of(Side.LEFT),)] * 10, RIGHT)
    assert refusal(after([(of(Side.RIGHT, score=unsure),)] * 60, RIGHT, refused)) is HandRefusal.OTHER_SIDE
    anew = after([(of(Side.RIGHT, score=sure),)] * (2 * CONTRARY_FRAMES), RIGHT, refused)
    assert (anew.known, refusal(anew)) == (True, None)
    assert not after([(of(Side.LEFT, score=unsure),)] * CONTRARY_FRAMES, RIGHT, begun()).known


def test_a_hand_unseen_for_longer_than_a_press_survives_is_judged_anew() -> None:
    for frames in range(LOST_FRAMES + 1):
        back = rest_of(after([()] * frames, RIGHT, begun()), HERE)
        assert (back.known, back.number) == ((True, 1) if frames <= GAP_FRAMES else (False, 2))


def test_nothing_commands_while_two_hands_overlap_nor_before_side_and_arm_are_known_again() -> None:
    tracks, frames = begun(), []
    for x_px in (*range(600, 100, -40), *range(100, 600, 40)):
        tracks = rest_of(tracks, HERE, of(Side.LEFT, moved(HERE, x_px)))
        near = 2 * x_px / (2 * HERE.reference_px) <= OVERLAP_REFERENCES
        frames.append((near, tracks.known, refusal(tracks)))
    overlapping = [number for number, (near, _, _) in enumerate(frames) if near]
    first, last = overlapping[0], overlapping[-1]
    assert all(one == (True, False, HandRefusal.OVERLAP) for one in frames[first : last + 1])
    assert [known for _, known, _ in frames[:first]] == [True] * first
    assert [known for _, known, _ in frames[last + 1 :]] == [False] * 2 + [True] * (len(frames) - last - 3)
    assert tracks.number > 1


def test_a_second_hand_seen_for_one_frame_within_reach_is_none_and_one_of_two_frames_is() -> None:
    beside = of(Side.LEFT, moved(HERE, 0.8 * OVERLAP_REFERENCES * HERE.reference_px))
    tracks = after([(HERE, beside), (HERE,), (HERE, beside), (HERE,)], RIGHT, begun())
    assert (tracks.known, tracks.number, refusal(tracks)) == (True, 1, None)
    tracks = after([(HERE, beside)] * 2, RIGHT, tracks)
    assert (tracks.known, refusal(tracks)) == (False, HandRefusal.OVERLAP)


def test_one_hand_found_twice_is_one() -> None:
    tracks = after([(HERE, moved(HERE, 5))] * 4, RIGHT)
    assert (len(tracks.followed), tracks.known) == (1, True)


@settings(max_examples=40)
@given(st.integers(0, 400), st.integers(0, 2))
def test_whoever_takes_over_a_track_has_its_own_vote(x_px: int, side_flips: int) -> None:
    """Wherever a hand of the other side appears in place of the enrolled one, it does not command."""
    foreign = mirrored(moved(HERE, x_px))
    frames = [(of(Side.RIGHT if number < side_flips else Side.LEFT, foreign),) for number in range(12)]
    tracks = begun()
    for frame in frames:
        tracks = after([frame], RIGHT, tracks)
        assert not tracks.known or commanding(tracks) is None
    assert refusal(tracks) is HandRefusal.OTHER_SIDE


def test_an_unclear_side_is_told_after_as_many_frames_with_a_gesture_and_not_before() -> None:
    frames = [(of(Side.RIGHT, moved(HERE, 40 * (k % 2)), 0.51),) for k in range(30)]
    begun = Tracks(captured_ns=10_000_000_000)
    told = [refusal(after(frames[:count], RIGHT, begun)) for count in range(1, 31)]
    first = told.index(HandRefusal.SIDE_UNCLEAR)
    assert first + 1 == UNCLEAR_FRAMES
    assert told == [None] * first + [HandRefusal.SIDE_UNCLEAR] * (30 - first)
