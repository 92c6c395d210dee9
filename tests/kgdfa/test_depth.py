from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.depth import (
    AGREEMENT,
    MOST_RATIO,
    ChosenDistance,
    DepthFault,
    DepthMap,
    DepthRange,
    choose_distance,
    sample_palm,
)
from kgdfa.distance import CONFIRM_FRAMES, HALF_PALM_M, Distance, DistanceChoice, DistanceSource
from kgdfa.errors import KgdfaError
from kgdfa.hand import Hand, Side

FRAME_NS = 33_333_333
MONOCULAR = Distance(shown_m=0.31, safe_m=0.34, sd_m=0.01)


def hand(x: float = 320.0, y: float = 240.0) -> Hand:
    image = np.full((21, 2), (x, y))
    image[5], image[17] = (x + 40, y), (x - 40, y)
    return Hand(image_px=image, world_m=np.zeros((21, 3)), presence=0.9, side=Side.RIGHT)


def depth_map(value: float) -> DepthMap:
    return np.full((480, 640), value, np.float32)


def measure(reader: DepthRange, value: float, frame: int) -> Distance | None:
    return reader.measure(depth_map(value), hand(), frame * FRAME_NS)


def test_the_rest_of_the_palm_outvotes_holes_in_it() -> None:
    holed = depth_map(0.40)
    holed[235:245, 312:328] = 0.0
    assert sample_palm(hand(), holed).depth_m == pytest.approx(0.40)


@pytest.mark.parametrize(
    ("value", "fault"),
    [
        (0.0, DepthFault.ZERO),
        (math.nan, DepthFault.NOT_FINITE),
        (math.inf, DepthFault.NOT_FINITE),
        (-0.3, DepthFault.NEGATIVE),
        (65.535, DepthFault.SATURATED),
    ],
)
def test_what_is_no_depth_is_no_measurement_and_named(value: float, fault: DepthFault) -> None:
    reader = DepthRange(mode="robust")
    assert measure(reader, value, 1) is None
    assert reader.fault is fault


@pytest.mark.parametrize(("x", "y"), [(-5, 240), (320, 481), (700, 240), (math.inf, 240), (math.nan, math.nan)])
def test_a_palm_off_the_map_is_no_measurement(x: float, y: float) -> None:
    assert sample_palm(hand(x, y), depth_map(0.4)).fault is DepthFault.OUTSIDE


@pytest.mark.parametrize(("x", "y"), [(0, 0), (639.4, 479.4)])
def test_a_palm_in_the_map_s_corner_is_measured(x: float, y: float) -> None:
    assert sample_palm(hand(x, y), depth_map(0.4)).depth_m == pytest.approx(0.4)


def test_an_edge_through_the_palm_is_refused() -> None:
    edge = depth_map(0.40)
    edge[:, 320:] = 0.80
    assert sample_palm(hand(), edge).fault is DepthFault.EDGE


def test_a_jump_is_held_back_until_it_stays() -> None:
    reader = DepthRange(mode="robust")
    measure(reader, 0.60, 1)
    for frame in range(2, 2 + CONFIRM_FRAMES - 1):
        assert measure(reader, 0.20, frame) is None
        assert reader.fault is DepthFault.JUMP
    stayed = measure(reader, 0.20, 1 + CONFIRM_FRAMES)
    assert stayed is not None
    assert (stayed.source, round(stayed.shown_m - HALF_PALM_M, 3)) == (DistanceSource.DEPTH, 0.20)


def test_a_single_near_reading_never_gets_through() -> None:
    reader = DepthRange(mode="robust")
    for frame in range(1, 30):
        distance = measure(reader, 0.12 if frame % 5 == 0 else 0.60, frame)
        assert distance is None or distance.shown_m == pytest.approx(0.60 + HALF_PALM_M)


@pytest.mark.parametrize("slipped_m", [0.22, 0.25, 0.27, 0.29])
def test_a_map_that_comes_again_confirms_no_jump(slipped_m: float) -> None:
    """As of a camera whose depth comes slower than its colour."""
    reader = DepthRange(mode="robust")
    measure(reader, 0.40, 1)
    for _ in range(6):
        assert measure(reader, slipped_m, 2) is None
    back = measure(reader, 0.40, 8)
    assert back is not None
    assert back.shown_m == pytest.approx(0.40 + HALF_PALM_M)


def test_a_jump_is_believed_by_maps_and_not_by_images() -> None:
    """Each map comes with two images, 15 a second."""
    reader = DepthRange(mode="robust")
    measure(reader, 0.60, 1)
    read = [measure(reader, 0.20, 1 + 2 * number) for number in range(1, CONFIRM_FRAMES + 1) for _ in range(2)]
    assert [one is not None for one in read] == [False] * 2 * (CONFIRM_FRAMES - 1) + [True] * 2


def test_another_hand_is_measured_in_a_map_that_comes_again() -> None:
    reader = DepthRange(mode="robust")
    measure(reader, 0.60, 1)
    assert measure(reader, 0.30, 2) is None
    reader.reset()
    assert measure(reader, 0.30, 2) is not None


def test_a_hand_pushed_fast_is_followed() -> None:
    reader = DepthRange(mode="robust")
    for frame in range(10):
        z = 0.60 - 0.05 * frame  # 1.5 m/s
        distance = measure(reader, z, frame + 1)
        assert distance is not None
        assert distance.shown_m == pytest.approx(z + HALF_PALM_M, abs=1e-6)


def test_another_hand_may_be_anywhere() -> None:
    reader = DepthRange(mode="robust")
    measure(reader, 0.60, 1)
    reader.reset()
    distance = measure(reader, 0.20, 2)
    assert distance is not None
    assert distance.source is DistanceSource.DEPTH


@given(st.floats(allow_nan=True, allow_infinity=True, width=32))
def test_robust_never_reads_nearer_than_the_map_reads(value: float) -> None:
    distance = measure(DepthRange(mode="robust"), value, 1)
    assert distance is None or distance.safe_m >= value > 0


@pytest.mark.parametrize("value", [0.0, 0.4])
def test_published_takes_the_map_as_exact(value: float) -> None:
    distance = measure(DepthRange(mode="published"), value, 1)
    assert distance is not None
    assert distance.safe_m == pytest.approx(value)


def test_published_takes_the_edge_for_zero() -> None:
    distance = DepthRange(mode="published").measure(depth_map(0.4), hand(-5.0), FRAME_NS)
    assert distance is not None
    assert distance.safe_m == 0.0


def test_a_mode_that_does_not_exist_is_refused() -> None:
    with pytest.raises(KgdfaError, match="DEPTH_MODE"):
        DepthRange(mode="best")


DEPTH = Distance(shown_m=0.30, safe_m=0.303, sd_m=0.003, source=DistanceSource.DEPTH)
NOTHING = ChosenDistance()


@pytest.mark.parametrize("monocular", [None, MONOCULAR])
@pytest.mark.parametrize("depth", [None, DEPTH])
def test_one_source_alone_never_takes_the_other(monocular: Distance | None, depth: Distance | None) -> None:
    assert choose_distance(NOTHING, DistanceChoice.MONOCULAR, monocular, depth).distance is monocular
    assert choose_distance(NOTHING, DistanceChoice.DEPTH, monocular, depth).distance is depth


def test_depth_decides_where_it_measures_and_the_keypoints_bridge_its_holes() -> None:
    both = choose_distance(NOTHING, DistanceChoice.BOTH, MONOCULAR, DEPTH)
    assert (both.distance, both.bridge_m) == (DEPTH, MONOCULAR.safe_m)
    hole = choose_distance(both, DistanceChoice.BOTH, MONOCULAR, None)
    assert (hole.distance, hole.bridge_m) == (MONOCULAR, None)
    assert choose_distance(hole, DistanceChoice.BOTH, None, DEPTH).distance is DEPTH
    assert choose_distance(hole, DistanceChoice.BOTH, None, None).distance is None


@given(st.floats(0.1, 2.0), st.floats(0.1, 2.0), st.floats(0.1, 2.0))
def test_a_bridge_reads_far_never_near(before_m: float, depth_m: float, after_m: float) -> None:
    """It takes over how much farther depth read, never how much nearer."""

    def keypoints(metres: float) -> Distance:
        return Distance(shown_m=metres, safe_m=metres, sd_m=0.0)

    depth = Distance(shown_m=depth_m, safe_m=depth_m, sd_m=0.0, source=DistanceSource.DEPTH)
    chosen = choose_distance(NOTHING, DistanceChoice.BOTH, keypoints(before_m), depth)
    bridged = choose_distance(chosen, DistanceChoice.BOTH, keypoints(after_m), None).distance
    assert bridged is not None
    assert after_m <= bridged.safe_m <= MOST_RATIO * after_m


def test_depth_much_nearer_than_the_hand_is_seen_is_no_measurement() -> None:
    near = Distance(shown_m=0.1, safe_m=0.99 * AGREEMENT * MONOCULAR.shown_m, sd_m=0.0, source=DistanceSource.DEPTH)
    chosen = choose_distance(NOTHING, DistanceChoice.BOTH, MONOCULAR, near)
    assert (chosen.distance, chosen.fault) == (MONOCULAR, DepthFault.DISAGREEMENT)
