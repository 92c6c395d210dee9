"""What a rehearsal measures of the feet, on movements whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest

from app.motion import kinematics
from app.motion.kinematics import Array
from app.motion.rehearsal_checks import least_clearance, most_slide, stride_m
from hal.joints.body import average_body
from hal.joints.scene import LEVEL_FLOOR, Block, BlockKind, Scene
from hal.joints.simulated.wearer import GroundTruth

BODY = average_body(1.7, 65.0)
LOADED_N, SWINGING_N = 300.0, 0.0


def truths(
    left_m: list[tuple[float, float]],
    left_n: list[float],
    *,
    right_m: list[tuple[float, float]] | None = None,
    right_n: list[float] | None = None,
    left_pitch_rad: Array | None = None,
) -> list[GroundTruth]:
    """Shanks upright; each ankle's place from where the sole is on the floor, at each moment."""
    on_floor = np.array([0.0, BODY.ankle_height_m])
    rights = right_m or [(0.0, 0.0)] * len(left_m)
    right_loads = right_n or [LOADED_N] * len(left_m)
    pitches = np.zeros(len(left_m)) if left_pitch_rad is None else left_pitch_rad
    return [
        GroundTruth(
            time_s=0.0,
            hip_x_m=0.0,
            hip_z_m=0.9,
            lean_rad=0.0,
            joints_rad=np.zeros(4),
            ankle_rad=np.array([pitch, 0.0]),
            ankle_m=np.array([left, right]) + on_floor,
            contact_n=np.array([left_load, right_load]),
            balance_nm=0.0,
            hold_n=0.0,
            deepest_m=0.0,
            struck=False,
        )
        for left, right, left_load, right_load, pitch in zip(left_m, rights, left_n, right_loads, pitches, strict=True)
    ]


def swing(travel_m: float, heights_m: list[float]) -> tuple[list[tuple[float, float]], list[float]]:
    """A foot on the floor, then through these heights at equal parts of its travel, then on the floor again."""
    xs = np.linspace(0.0, travel_m, len(heights_m))
    places = [(0.0, 0.0), *((float(x), z) for x, z in zip(xs, heights_m, strict=True)), (travel_m, 0.0)]
    return places, [LOADED_N, *[SWINGING_N] * len(heights_m), LOADED_N]


@pytest.mark.parametrize("travel_m", [0.5, -0.5, 0.041])
def test_clearance_is_the_least_height_in_the_middle_of_the_travel(travel_m: float) -> None:
    heights = [0.001, 0.002, 0.06, 0.05, 0.03, 0.05, 0.05, 0.04, 0.06, 0.002, 0.001]
    assert least_clearance(BODY, truths(*swing(travel_m, heights)), LEVEL_FLOOR) == pytest.approx(0.03)


def test_the_ends_of_a_travel_may_be_low() -> None:
    heights = [0.0, 0.001, 0.002, 0.05, 0.05, 0.05, 0.05, 0.05, 0.002, 0.001, 0.0]
    assert least_clearance(BODY, truths(*swing(0.5, heights)), LEVEL_FLOOR) == pytest.approx(0.05)


def test_clearance_is_above_what_was_staged_around_the_first_stance() -> None:
    """A step 0.15 m high, 0.1 to 1 m before the feet, which stand at 2 m."""
    step = Scene(blocks=(Block(kind=BlockKind.STEP, from_x_m=0.1, to_x_m=1.0, top_m=0.15),))
    left_m, left_n = swing(0.5, [0.19] * 11)
    apart = truths([(2.0 + x, z) for x, z in left_m], left_n, right_m=[(2.0, 0.0)] * len(left_m))
    assert least_clearance(BODY, apart, step) == pytest.approx(0.04)


def test_clearance_counts_the_lower_of_both_feet() -> None:
    left_m, left_n = swing(0.5, [0.05] * 11)
    right_m, right_n = swing(0.5, [0.04] * 11)
    both = truths(left_m, left_n, right_m=right_m, right_n=right_n)
    assert least_clearance(BODY, both, LEVEL_FLOOR) == pytest.approx(0.04)


def test_a_toe_that_hangs_is_what_has_the_clearance() -> None:
    left_m, left_n = swing(0.5, [0.08] * 11)
    hanging = truths(left_m, left_n, left_pitch_rad=np.full(len(left_m), -0.2))
    _, toe = kinematics.sole(BODY, np.array([-0.2]))
    expected = 0.08 + BODY.ankle_height_m + float(toe[0, 1])
    assert least_clearance(BODY, hanging, LEVEL_FLOOR) == pytest.approx(expected)


@pytest.mark.parametrize("load_n", [LOADED_N, 1.1])
def test_a_foot_that_keeps_its_load_does_not_swing(load_n: float) -> None:
    left_m, left_n = swing(0.5, [0.01] * 11)
    assert least_clearance(BODY, truths(left_m, [load_n] * len(left_n)), LEVEL_FLOOR) is None


def test_a_hop_in_place_is_no_swing() -> None:
    assert least_clearance(BODY, truths(*swing(0.039, [0.001] * 11)), LEVEL_FLOOR) is None


def test_slide_is_the_farthest_way_of_a_loaded_foot() -> None:
    places = [(0.0, 0.0), (0.01, 0.0), (0.015, 0.0), (-0.003, 0.0), (0.0, 0.0)]
    assert most_slide(BODY, truths(places, [LOADED_N] * 5)) == pytest.approx(0.018)
    assert most_slide(BODY, truths([(0.0, 0.0)] * 5, [0.0] * 5, right_m=places)) == pytest.approx(0.018)


def test_a_foot_without_load_does_not_slide() -> None:
    places = [(0.0, 0.0), (0.0, 0.0), (0.2, 0.0), (0.2, 0.0)]
    assert most_slide(BODY, truths(places, [LOADED_N, 59.0, 59.0, LOADED_N])) == 0.0
    assert most_slide(BODY, truths(places, [61.0] * 4)) == pytest.approx(0.2)


def test_a_foot_that_rolls_over_its_toe_does_not_slide() -> None:
    pitches = np.linspace(0.0, -0.5, 40)
    _, toe = kinematics.sole(BODY, pitches)
    from_start = toe[0] - toe
    places = [(float(x), float(z)) for x, z in from_start]
    assert most_slide(BODY, truths(places, [LOADED_N] * 40, left_pitch_rad=pitches)) < 1e-9


def test_a_stride_is_twice_the_usual_distance_of_two_landings() -> None:
    """The left foot lands at 0.3, 0.9 and 1.5 m, the right one at 0.6, 1.2 and, rebounding, 1.22 m."""
    left_m = [(x, 0.0) for x in (0.0, 0.3, 0.3, 0.9, 0.9, 1.5, 1.5, 1.5)]
    left_n = [0.0, 31.0, 0.0, 31.0, 0.0, 31.0, 31.0, 31.0]
    right_m = [(x, 0.0) for x in (0.0, 0.0, 0.6, 0.6, 1.2, 1.2, 1.22, 1.22)]
    right_n = [31.0, 0.0, 31.0, 0.0, 31.0, 29.0, 31.0, 31.0]
    assert stride_m(truths(left_m, left_n, right_m=right_m, right_n=right_n)) == pytest.approx(0.6)


def test_who_does_not_walk_has_no_stride() -> None:
    assert stride_m(truths([(0.0, 0.0)] * 3, [LOADED_N] * 3)) == 0.0
