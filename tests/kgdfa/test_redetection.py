"""Other views of an image while there is no hand: when they are taken, kept and given up, and where a hand is then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.augmentation import to_image
from kgdfa.hand import FloatArray, Hand, Side
from kgdfa.preprocess import Image
from kgdfa.redetection import (
    LARGEST_PALM,
    LOOK_FRAMES,
    LOOK_LAG_FRAMES,
    MOST_GROWTH,
    MOST_QUICKER,
    PATIENCE_FRAMES,
    RETRY_FRAMES,
    SOUGHT_PALM,
    Detection,
    PalmGrowth,
    RedetectionState,
    Redetector,
    next_state,
)
from kgdfa.views import FULL_VIEW, NEAR_VIEWS, REDETECTION_VIEWS, View, render_view

PICTURE: Image = np.broadcast_to((np.arange(640) // 3).astype(np.uint8)[None, :, None], (360, 640, 3))
NEAR: Image = np.zeros((200, 640, 3), np.uint8)  # in which `palm` is a near hand's, and just not shown smaller


def fold(observed: list[bool]) -> list[RedetectionState]:
    states = [RedetectionState()]
    for found in observed:
        states.append(next_state(states[-1], found=found))
    return states


@given(st.lists(st.booleans(), max_size=40))
def test_a_redetection_changes_only_after_patience_without_a_hand(observed: list[bool]) -> None:
    states = fold(observed)
    for number, (before, now) in enumerate(pairwise(states)):
        if now.view != before.view:
            assert number + 1 >= PATIENCE_FRAMES
            assert not any(observed[number + 1 - PATIENCE_FRAMES : number + 1])


@given(st.lists(st.booleans(), max_size=40), st.integers(1, 30))
def test_what_found_a_hand_is_kept_while_it_is_found(before: list[bool], frames: int) -> None:
    start = fold(before)[-1]
    held = start
    for _ in range(frames):
        held = next_state(held, found=True)
    assert (held.view, held.missing) == (start.view, 0)


def test_an_empty_room_is_seen_in_every_view_and_plainly_again() -> None:
    states = fold([False] * (PATIENCE_FRAMES + 2 * len(REDETECTION_VIEWS)))
    shown = [state.view for state in states[PATIENCE_FRAMES:]]
    assert shown[: len(REDETECTION_VIEWS)] == list(REDETECTION_VIEWS)
    assert shown[len(REDETECTION_VIEWS) : 2 * len(REDETECTION_VIEWS)] == list(REDETECTION_VIEWS)
    assert FULL_VIEW in REDETECTION_VIEWS


class Follower:
    """A tracker of ours: finds a hand as often as it is told to, and counts its looks."""

    def __init__(self, finds: list[bool]) -> None:
        self.finds = iter(finds)
        self.looks: list[tuple[Image, int]] = []

    def look(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        self.looks.append((image_bgr, captured_ns))
        found = Hand(image_px=np.full((21, 2), 100.0), world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)
        return (found,) if next(self.finds) else ()

    @property
    def frames(self) -> list[int]:
        return [frame for _, frame in self.looks]


def watched(finds: list[bool], frames: int) -> tuple[list[bool], Follower]:
    """Whether each frame shows a hand, to a searcher whose looks find one as told."""
    follower = Follower(finds)
    searcher = Redetector(follower.look)
    return [bool(searcher.detect(PICTURE, frame)) for frame in range(frames)], follower


def test_the_frame_that_loses_a_hand_is_looked_at_once_more() -> None:
    shown, follower = watched([True, False, True, True], 3)
    assert shown == [True, True, True]
    assert follower.frames == [0, 1, 1, 2]


def test_a_hand_not_found_everywhere_is_looked_for_in_a_turned_view_and_kept_in_it() -> None:
    shown, follower = watched([True, False, False, True, True], 3)
    assert shown == [True, True, True]
    assert follower.frames == [0, 1, 1, 1, 2]
    assert [image is PICTURE for image, _ in follower.looks] == [True, True, True, False, False]


def test_a_hand_that_is_gone_costs_four_detections_more_and_an_empty_room_none() -> None:
    shown, follower = watched([False, True] + [False] * 8, 6)
    assert shown == [False, True] + [False] * 4
    assert follower.frames == [0, 1, 2, 2, 2, 3, 3, 4, 4, 5]


def test_a_hand_just_lost_is_shown_in_each_of_the_near_views_in_turn() -> None:
    _, follower = watched([True] + [False] * 7, 4)
    shown = [render_view(PICTURE, view)[0] for view in (*NEAR_VIEWS, FULL_VIEW)]
    # Per frame: the view kept from the frame before, then the next near one; the first frame in half its pixels too.
    for place, view in ((3, 0), (4, 0), (5, 1), (6, 3), (7, 2)):
        assert [np.array_equal(follower.looks[place][0], one) for one in shown] == [k == view for k in range(4)]


def test_a_hand_found_by_a_redetection_is_followed_in_that_view() -> None:
    finds = [False] * (PATIENCE_FRAMES + 1) + [True, True]
    _, follower = watched(finds, len(finds))
    assert [image is PICTURE for image, _ in follower.looks] == [True] * (PATIENCE_FRAMES + 1) + [False] * 2


class DiscTracker:
    """A tracker of ours for white discs: follows one while its size stays about what it was, and finds no large one."""

    REACH = 0.2  # how much larger or smaller the disc may be from one look to the next
    LARGEST = 0.3  # of the image's height: the radius that is found anew

    def __init__(self) -> None:
        self.radius_px: float | None = None

    def look(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        del captured_ns
        white = np.argwhere(image_bgr[..., 0] > 128)
        radius_px = float(np.sqrt(len(white) / np.pi))
        if self.radius_px is None:
            observed = 0 < radius_px < self.LARGEST * image_bgr.shape[0]
        else:
            observed = abs(radius_px / self.radius_px - 1) < self.REACH
        self.radius_px = radius_px if observed else None
        return (disc_hand(white.mean(axis=0)[::-1], radius_px),) if observed else ()


def disc_hand(middle_px: FloatArray, radius_px: float) -> Hand:
    """Keypoints around the disc, the palm about as long as it is wide."""
    angles = np.arange(21) * (2 * np.pi / 30)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    image_px = middle_px + radius_px * circle
    return Hand(image_px=image_px, world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)


def pushed_discs() -> list[tuple[float, Image]]:
    """Radius and image while a hand comes from 30 to 15 cm and withdraws, as a push of 0.3 s does."""
    shares = [0.0] * 3 + [0.04, 0.32, 0.68, 0.96, 1.0, 0.9, 0.55, 0.2, 0.02] + [0.0] * 3
    radii = [40 * 0.30 / (0.30 - 0.15 * share) for share in shares]
    return [(radius, disc(radius)) for radius in radii]


def disc(radius_px: float) -> Image:
    black = np.zeros((240, 426, 3), np.uint8)
    return np.asarray(cv2.circle(black, (213, 120), round(radius_px), (255, 255, 255), -1), np.uint8)


def test_the_size_of_a_pushed_hand_outruns_a_tracker_that_sees_the_plain_image() -> None:
    tracker = DiscTracker()
    assert not all(tracker.look(picture, frame) for frame, (_, picture) in enumerate(pushed_discs()))


def test_a_near_hand_that_pushes_is_shown_smaller_and_reported_where_and_how_large_it_is() -> None:
    tracker = DiscTracker()
    searcher = Redetector(tracker.look)
    for frame, (radius, picture) in enumerate(pushed_discs()):
        hands = searcher.detect(picture, frame)
        assert hands, f"lost in frame {frame}"
        assert hands[0].image_px == pytest.approx(disc_hand(np.array([213.0, 120.0]), radius).image_px, abs=2.5)
        assert tracker.radius_px is not None
        assert 2 * tracker.radius_px < 1.3 * LARGEST_PALM * picture.shape[0]


def test_a_hand_that_is_not_near_is_shown_as_it_is() -> None:
    follower = DiscTracker()
    observed: list[Image] = []

    def look(image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        observed.append(image_bgr)
        return follower.look(image_bgr, captured_ns)

    searcher = Redetector(look)
    picture = disc(30)
    for frame in range(4):
        searcher.detect(picture, frame)
    assert all(image.shape == picture.shape and (image == picture).all() for image in observed)


@pytest.mark.parametrize(("palm_px", "heights"), [(150.0, [720, 360, 360]), (149.0, [720, 720, 720])])
def test_a_long_palm_is_shown_in_half_the_pixels_and_stays_where_it_is(palm_px: float, heights: list[int]) -> None:
    image_px = np.column_stack([np.full(21, 640.0), np.linspace(300.0, 300.0 + palm_px, 21)])
    image_px[9] = image_px[20]  # at the knuckle of the middle finger the palm has its whole length
    observed: list[int] = []

    def track(shown: Image, _captured_ns: int) -> tuple[Hand, ...]:
        observed.append(shown.shape[0])
        return (
            Hand(image_px=image_px * shown.shape[0] / 720, world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT),
        )

    redetector = Redetector(track)
    for frame in range(3):
        (hand,) = redetector.detect(np.zeros((720, 1280, 3), np.uint8), frame)
        assert hand.image_px == pytest.approx(image_px)
    assert observed == heights


def palm(breadth_px: float, *, at_px: float = 100.0) -> Hand:
    """Keypoints on a line, but for 5-17, which is so broad."""
    image_px = np.column_stack([np.full(21, at_px), np.linspace(40.0, 160.0, 21)])
    image_px[[5, 17], 0] += (-breadth_px / 2, breadth_px / 2)
    image_px[[5, 17], 1] = 100.0
    return Hand(image_px=image_px, world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)


@pytest.mark.parametrize(
    ("tracked_px", "anew", "reported_px", "looks"),
    [
        ((20, 20, 18), (), 18, 0),
        ((20, 20, 10), (palm(19),), 19, 1),
        ((20, 20, 10), (palm(11),), 10, 1),
        ((20, 20, 10), (palm(19, at_px=400.0),), 10, 1),
        ((20, 20, 10), (), 10, 1),
        ((20, 20, 10, 20, 10), (palm(19),), 10, 1),
        ((20, 20, 10, *[20] * (LOOK_FRAMES - 1), 10), (palm(19),), 19, 2),
    ],
    ids=["a hand that turns", "a slip", "narrow all the same", "another place", "not found", "at once", "later"],
)
def test_a_near_palm_that_narrows_as_no_hand_can_is_detected_anew(
    tracked_px: tuple[float, ...], anew: tuple[Hand, ...], reported_px: float, looks: int
) -> None:
    reported, looked = followed_px(tracked_px, anew, NEAR)
    assert reported == pytest.approx(reported_px, abs=0.1)
    assert looked == looks


def test_a_far_palm_that_narrows_is_left_to_the_tracker() -> None:
    reported, looked = followed_px((20, 20, 10), (palm(19),), PICTURE)
    assert reported == pytest.approx(10, abs=0.1)
    assert looked == 0


def followed_px(tracked_px: tuple[float, ...], anew: tuple[Hand, ...], image: Image) -> tuple[float, int]:
    """The breadth that the last frame reports, and how often the palm was detected anew."""
    tracked, looked = iter(tracked_px), list[Image]()

    def begin_look(shown: Image) -> Detection:
        looked.append(shown)
        view = View(scale=SOUGHT_PALM * image.shape[0] / palm(tracked_px[0]).palm_px)
        onto_view = np.asarray(cv2.invertAffineTransform(render_view(image, view)[1]), dtype=np.float64)
        return lambda: tuple(to_image(hand, onto_view) for hand in anew)

    searcher = Redetector(lambda _, __: (palm(next(tracked)),), begin_look=begin_look)
    reported = [searcher.detect(image, frame) for frame in range(len(tracked_px))]
    return reported[-1][0].reference_px, len(looked)


def with_fingertips(off_px: float) -> Hand:
    """The same palm with its fingertips that far aside."""
    image_px = palm(20).image_px.copy()
    image_px[4::4, 0] += off_px
    return replace(palm(20), image_px=image_px)


SURE, LATER = (False,) * LOOK_LAG_FRAMES, (False,) * (LOOK_FRAMES - 1)


@pytest.mark.parametrize(
    ("doubted", "anew", "shows", "forgotten"),
    [
        ((False, True, *SURE), with_fingertips(40.0), True, [1 + LOOK_LAG_FRAMES]),
        ((True, *LATER, True, *SURE), with_fingertips(40.0), True, [LOOK_LAG_FRAMES, LOOK_FRAMES + LOOK_LAG_FRAMES]),
        ((True, True, *SURE), with_fingertips(40.0), True, [LOOK_LAG_FRAMES]),
        ((False, True, *SURE), with_fingertips(10.0), True, []),
        ((False, True, *SURE), palm(20, at_px=400.0), True, []),
        ((False, True, *SURE), None, True, []),
        ((False, False, *SURE), with_fingertips(40.0), True, []),
        ((False, True, *SURE), with_fingertips(40.0), False, []),
    ],
    ids=["slipped", "later", "at once", "as tracked", "another place", "not found", "not doubted", "another gesture"],
)
def test_a_tracker_that_follows_a_shape_the_hand_has_not_is_made_to_forget(
    doubted: tuple[bool, ...], anew: Hand | None, shows: bool, forgotten: list[int]
) -> None:
    forgets: list[int] = []
    redetector = Redetector(
        lambda _, __: (palm(20),), begin_look=lambda _: lambda: (anew,) if anew else (), forget=forgets.append
    )
    for frame, doubt in enumerate(doubted):
        redetector.sought = (lambda _: shows) if doubt else None
        assert (redetector.detect(PICTURE, frame)[0].image_px == palm(20).image_px).all()
    assert forgets == forgotten


@pytest.mark.parametrize("then", [(palm(20), NEAR), (None, PICTURE)], ids=["near", "lost"])
def test_a_look_at_a_hand_that_has_come_near_or_is_lost_is_left_unused(then: tuple[Hand | None, Image]) -> None:
    frames = [(palm(20), PICTURE), (palm(20), PICTURE), then, (palm(20), PICTURE), (palm(20), PICTURE)]
    forgets: list[int] = []
    hands = iter([hand for hand, picture in frames for _ in range(1 if hand else 3)])
    redetector = Redetector(
        lambda _, __: tuple(hand for hand in (next(hands),) if hand),
        begin_look=lambda _: lambda: (with_fingertips(40.0),),
        forget=forgets.append,
    )
    for frame, (_, picture) in enumerate(frames):
        redetector.sought = (lambda _: True) if frame == 1 else None
        redetector.detect(picture, frame)
    assert not forgets


def test_a_near_hand_that_is_doubted_is_left_to_the_tracker() -> None:
    looked: list[Image] = []

    def begin_look(shown: Image) -> Detection:
        looked.append(shown)
        return lambda: ()

    redetector = Redetector(lambda _, __: (palm(20),), begin_look=begin_look)
    redetector.sought = lambda _: True
    for frame in range(2 * LOOK_FRAMES):
        redetector.detect(NEAR, frame)
    assert not looked


GREY: Image = np.full((360, 640, 3), 64, np.uint8)
DOUBTED = (True, *[False] * (LOOK_FRAMES - 1))


def light_of(image: Image) -> str:
    """Whether GREY is shown brighter."""
    return "b" if image[image.shape[0] // 2, image.shape[1] // 2, 0] > 64 else "p"


def looks_in_light(shows_in: str, doubted: Sequence[bool]) -> tuple[str, str]:
    """In which light each untracked detection and each frame was: "b" for brighter, "p" as it is.

    In each look the hand shows what is sought in the light that `shows_in` has for it; the tracker never has it.
    """
    looks, frames = list[str](), list[str]()

    def observed(hand: Hand, shown: Image) -> tuple[Hand, ...]:
        return (replace(hand, image_px=hand.image_px * shown.shape[0] / GREY.shape[0]),)

    def track(shown: Image, _captured_ns: int) -> tuple[Hand, ...]:
        frames.append(light_of(shown))
        return observed(palm(20), shown)

    def begin_look(shown: Image) -> Detection:
        looks.append(light_of(shown))
        seen = observed(with_fingertips(40.0 if looks[-1] == shows_in[len(looks) - 1] else 10.0), shown)
        return lambda: seen

    redetector = Redetector(track, begin_look=begin_look)
    for frame, doubt in enumerate(doubted):
        redetector.sought = (lambda _: True) if doubt else None
        redetector.detect(GREY, frame)
    return "".join(looks), "".join(frames)


def test_looks_in_vain_take_turns_in_either_light() -> None:
    looks, frames = looks_in_light("----", DOUBTED * 4)
    assert looks == "pbpb"
    assert frames == "p" * 4 * LOOK_FRAMES


def test_the_light_that_shows_what_is_sought_is_tracked_in_until_the_other_shows_it() -> None:
    looks, frames = looks_in_light("bbpp", DOUBTED * 4)
    assert looks == "pbbp"
    before = LOOK_FRAMES + LOOK_LAG_FRAMES + 1
    assert frames == "p" * before + "b" * 2 * LOOK_FRAMES + "p" * (2 * LOOK_FRAMES - before)


def test_a_look_long_after_one_in_vain_is_in_the_light_that_is_tracked_in() -> None:
    assert looks_in_light("--", (True, *[False] * RETRY_FRAMES, True))[0] == "pp"


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        ((1.0,), 1.0),
        ((1.0, 1.0, 1.0), 1.0),
        ((1.0, 1.02), 1.02),
        ((1.0, 1.1), 1.1 * 1.1),
        ((1.0, 1.16), 1.16 * MOST_QUICKER),
        ((1.0, 1.1, 1.1 * 1.2), 1.2),
        ((1.0, 1.2, 1.2 * 1.1), 1.1),
        ((1.0, 0.9), 0.9),
        ((1.0, 2.0), MOST_GROWTH),
        ((1.0, 0.5), 1 / MOST_GROWTH),
    ],
    ids=[
        "just come",
        "still",
        "too little to count",
        "begins to come",
        "comes quickly",
        "as expected",
        "slows down",
        "withdraws",
        "leaps near",
        "leaps away",
    ],
)
def test_a_hand_that_comes_quicker_and_quicker_is_expected_to_go_on_so(
    sizes: tuple[float, ...], expected: float
) -> None:
    growth = None
    for size in sizes:
        growth = PalmGrowth.of(replace(palm(20), image_px=palm(20).image_px * size), growth)
    assert growth is not None
    assert growth.growth == pytest.approx(expected)
