"""Other views of a picture while there is no hand: when they are taken, kept and given up, and where a hand is then."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.glances import PATIENCE_FRAMES, PLAIN, SEARCH, Glance, Search, Searcher, after, glance_at
from kgdfa.hand import Hand, Side
from kgdfa.images import Image
from kgdfa.looks import on_picture

glances = st.builds(Glance, scale=st.floats(0.3, 1.0), turn_deg=st.floats(-90, 90))


def fold(seen: list[bool]) -> list[Search]:
    states = [Search()]
    for found in seen:
        states.append(after(states[-1], found=found))
    return states


@given(st.lists(st.booleans(), max_size=40))
def test_a_glance_changes_only_after_patience_without_a_hand(seen: list[bool]) -> None:
    states = fold(seen)
    for number, (before, now) in enumerate(pairwise(states)):
        if now.glance != before.glance:
            assert number + 1 >= PATIENCE_FRAMES
            assert not any(seen[number + 1 - PATIENCE_FRAMES : number + 1])


@given(st.lists(st.booleans(), max_size=40), st.integers(1, 30))
def test_what_found_a_hand_is_kept_while_it_is_found(before: list[bool], frames: int) -> None:
    start = fold(before)[-1]
    held = start
    for _ in range(frames):
        held = after(held, found=True)
    assert (held.glance, held.missing) == (start.glance, 0)


def test_an_empty_room_is_seen_in_every_way_and_plainly_again() -> None:
    states = fold([False] * (PATIENCE_FRAMES + 2 * len(SEARCH)))
    shown = [state.glance for state in states[PATIENCE_FRAMES:]]
    assert shown[: len(SEARCH)] == list(SEARCH)
    assert shown[len(SEARCH) : 2 * len(SEARCH)] == list(SEARCH)
    assert PLAIN in SEARCH


@given(glance=glances, x=st.floats(250, 390), y=st.floats(120, 240))
def test_a_hand_found_in_a_glance_is_told_where_the_picture_has_it(glance: Glance, x: float, y: float) -> None:
    _, transform = glance_at(np.zeros((360, 640, 3), np.uint8), glance)
    on_glance = np.tile((x, y), (21, 1)) @ transform[:, :2].T + transform[:, 2]
    hand = Hand(image_px=on_glance, world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)
    assert on_picture(hand, transform).image_px == pytest.approx(np.tile((x, y), (21, 1)), abs=1e-6)


@pytest.mark.parametrize("glance", SEARCH, ids=str)
def test_a_glance_shows_the_picture_where_its_map_says(glance: Glance) -> None:
    image = np.zeros((360, 640, 3), np.uint8)
    image[195:206, 345:356] = 255
    shown, transform = glance_at(image, glance)
    assert shown.shape == (image.shape if glance == PLAIN else (180, 320, 3))
    spot = np.argwhere(shown[..., 0] > 128).mean(axis=0)[::-1]
    assert spot == pytest.approx(transform[:, :2] @ (350, 200) + transform[:, 2], abs=0.6)


def test_a_turned_hand_is_turned_back_in_space() -> None:
    _, transform = glance_at(np.zeros((360, 640, 3), np.uint8), Glance(scale=0.5, turn_deg=90))
    world = np.zeros((21, 3))
    world[12] = (0.0, -0.08, 0.02)  # fingers up on the picture
    turned = Hand(
        image_px=np.zeros((21, 2)),
        world_m=world @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]),
        presence=1,
        side=Side.LEFT,
    )
    assert on_picture(turned, transform).world_m[12] == pytest.approx((0.0, -0.08, 0.02))


class Follower:
    """A tracker of ours: finds a hand as often as it is told to, and counts its looks."""

    def __init__(self, finds: list[bool]) -> None:
        self.finds = iter(finds)
        self.looks: list[tuple[tuple[int, ...], int]] = []

    def look(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        self.looks.append((image_bgr.shape, captured_ns))
        found = Hand(image_px=np.full((21, 2), 100.0), world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)
        return (found,) if next(self.finds) else ()


def watched(finds: list[bool], frames: int) -> tuple[list[bool], Follower]:
    """Whether each frame shows a hand, to a searcher whose looks find one as told."""
    follower = Follower(finds)
    searcher = Searcher(follower.look)
    picture = np.zeros((360, 640, 3), np.uint8)
    return [bool(searcher.detect(picture, frame)) for frame in range(frames)], follower


def test_the_frame_that_loses_a_hand_is_looked_at_once_more() -> None:
    shown, follower = watched([True, False, True, True], 3)
    assert shown == [True, True, True]
    assert [frame for _, frame in follower.looks] == [0, 1, 1, 2]


def test_a_hand_that_is_gone_costs_one_look_more_and_an_empty_room_none() -> None:
    shown, follower = watched([False, True, False, False, False], 4)
    assert shown == [False, True, False, False]
    assert [frame for _, frame in follower.looks] == [0, 1, 2, 2, 3]


def test_a_hand_found_by_a_glance_is_followed_in_that_view() -> None:
    finds = [False] * (PATIENCE_FRAMES + 1) + [True, True]
    _, follower = watched(finds, len(finds))
    shapes = [shape for shape, _ in follower.looks]
    assert shapes == [(360, 640, 3)] * (PATIENCE_FRAMES + 1) + [(180, 320, 3)] * 2
