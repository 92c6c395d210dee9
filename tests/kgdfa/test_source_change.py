"""The button while depth and the keypoints that bridge its holes take turns: a change of source presses nothing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.button import advance
from kgdfa.button_state import ButtonInput, ButtonMode, ButtonPlace, ButtonState, PressHint
from kgdfa.depth import ChosenDistance, choose_distance
from kgdfa.distance import Distance, DistanceChoice, DistanceSource
from kgdfa.gesture import Gesture

FRAME_NS = 33_333_333
PLACE = ButtonPlace(x_px=640, y_px=360, radius_px=40, threshold_m=0.20)
SHARES = st.floats(0.75, 1.30)


def states(true_m: Sequence[float], holes: Iterable[bool], far: Iterable[float]) -> list[ButtonState]:
    """The button over a hand at these distances, by both. holes: of the map; far: the keypoints' share of the truth."""
    chosen, state, found = ChosenDistance(), ButtonState(), []
    for number, (metres, hole, share) in enumerate(zip(true_m, holes, far, strict=False), 1):
        keypoints = Distance(shown_m=metres * share, safe_m=metres * share, sd_m=0.0)
        depth = None if hole else Distance(shown_m=metres, safe_m=metres, sd_m=0.0, source=DistanceSource.DEPTH)
        chosen = choose_distance(chosen, DistanceChoice.BOTH, keypoints, depth)
        assert chosen.distance is not None
        frame = ButtonInput(
            captured_ns=number * FRAME_NS,
            gesture=Gesture.FIVE,
            recognised_ns=7,
            distance_m=chosen.distance.safe_m,
            beside_px=0.0,
            source=chosen.distance.source,
            bridge_m=chosen.bridge_m,
        )
        state = advance(state, frame, PLACE, ButtonMode.ROBUST)
        found.append(state)
    return found


@given(
    st.lists(st.tuples(st.floats(0.08, 0.5), st.booleans(), SHARES), min_size=2, max_size=40),
)
def test_nothing_is_pressed_or_released_where_the_source_changes(
    frames: list[tuple[float, bool, float]],
) -> None:
    before = ButtonState()
    for after in states(*zip(*frames, strict=True)):
        assert after.compared is not None
        if after.compared.source_changed:
            assert (after.pressed and not before.pressed, after.release_count) == (False, before.release_count)
            assert not after.ready or before.ready
        before = after


@given(
    st.floats(0.08, 0.40),
    st.lists(st.tuples(st.booleans(), st.floats(-0.004, 0.004)), min_size=30, max_size=60),
    SHARES,
)
def test_a_hand_that_stays_where_it_is_never_presses(
    place_m: float, frames: list[tuple[bool, float]], share: float
) -> None:
    """However far the two sources are apart, and whichever measures."""
    outside = [(0.5, False)] * 3 if place_m > PLACE.threshold_m else []  # seen outside before, and ready
    held = [(place_m + shake_m, hole) for hole, shake_m in frames]
    true_m, holes = zip(*outside, *[(held[0][0], False)] * 8, *held, strict=True)
    assert not any(state.pressed for state in states(true_m, holes, [share] * len(true_m))[len(outside) + 8 :])


def test_a_push_through_the_least_distance_of_depth_commands() -> None:
    """Depth to 25 cm, the keypoints from there on, which read 6 % far: as with a D435i before a threshold of 20 cm."""
    there = [0.36, 0.36, 0.36, 0.36, 0.34, 0.31, 0.27, 0.23, 0.19, 0.165, 0.15]
    push = [*there, *reversed(there)]
    last = states(push, [metres < 0.25 for metres in push], [1.06] * len(push))[-1]
    assert (last.release_count, last.released_gesture) == (1, Gesture.FIVE)


def test_pushes_command_through_holes_in_four_frames_of_ten() -> None:
    there = [0.36] * 6 + [0.355, 0.34, 0.315, 0.28, 0.24, 0.205, 0.175, 0.155, 0.145, 0.145]
    push = [*there, *reversed(there)]
    pattern = [False, True, True, False, False, True, False, False, True, False]
    holes = [pattern[(3 * number + number // 10) % 10] for number in range(len(push))]
    commands = [
        states(push, [*holes[shift:], *holes[:shift]], [1.05] * len(push))[-1].release_count
        for shift in range(len(push))
    ]
    assert set(commands) <= {0, 1}
    assert sum(commands) > 0.8 * len(commands)


@pytest.mark.parametrize("images", [1, 2, 3, 4])
@pytest.mark.parametrize("again", [True, False])
def test_a_depth_map_that_comes_with_several_images_is_one_measurement(images: int, again: bool) -> None:
    """again: one map that slipped near; else several that agree, which are a push."""
    state = ButtonState()
    for number, metres in enumerate([*[0.26] * 15, *[0.193] * images, *[0.26] * 15], 1):
        frame = ButtonInput(
            captured_ns=number * FRAME_NS,
            gesture=Gesture.FIVE,
            recognised_ns=7,
            distance_m=metres,
            beside_px=0.0,
            source=DistanceSource.DEPTH,
            bridge_m=None,
            repeated=again and 16 < number <= 15 + images,
        )
        state = advance(state, frame, PLACE, ButtonMode.ROBUST)
    assert state.release_count == (0 if again or images == 1 else 1)


def test_who_only_the_keypoints_saw_outside_has_not_withdrawn() -> None:
    """They read a tilted palm a quarter too far: outside at 19.5 cm, until depth measures it again."""
    held = [0.195] * 12
    found = states(held, [True] * 8 + [False] * 4, [1.3] * 12)
    assert found[7].ready
    assert (found[8].ready, found[8].hint) == (False, PressHint.WITHDRAW_FIRST)
    assert not found[-1].pressed
