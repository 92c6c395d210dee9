from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.minimum_jerk import minimum_jerk
from kgdfa.button_state import GAP_FRAMES
from kgdfa.distance import CONFIRM_FRAMES, HALF_PALM_M, Distance, OutlierState, PublishedRange, accept_distance
from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.hand import FloatArray, Hand, Side
from kgdfa.palm_shape import RIGID, SHAPE, view_palm
from kgdfa.robust_distance import REFERENCE_HOLDS_M, RobustRange

FOCAL_PX = 900.0
CENTRE_PX = (640.0, 360.0)
REFERENCE_M = 0.06
FRAME_NS = 33_333_333


def palm_m(left: bool = False) -> FloatArray:
    """(21, 3): a flat palm about keypoint 21, fingers straight up, facing the camera."""
    flat = np.zeros((21, 3))
    for finger, first in enumerate((5, 9, 13, 17)):
        base = SHAPE[1 + finger]
        for joint in range(4):
            flat[first + joint, :2] = np.add(base, (0.0, -0.4 * joint))
    flat[0, :2] = SHAPE[0]
    for joint in range(1, 5):
        flat[joint, :2] = (0.4 + 0.15 * joint, 1.2 - 0.25 * joint)
    return flat * (-REFERENCE_M if left else REFERENCE_M, REFERENCE_M, REFERENCE_M)


def turned(pitch: float, yaw: float, roll: float) -> FloatArray:
    def about(axis: int, angle: float) -> FloatArray:
        rotation = np.eye(3)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        rotation[first, first] = rotation[second, second] = math.cos(angle)
        rotation[first, second], rotation[second, first] = -math.sin(angle), math.sin(angle)
        return rotation

    return about(2, roll) @ about(0, pitch) @ about(1, yaw)


def observed(
    distance_m: float,
    *,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    aside_m: tuple[float, float] = (0.0, 0.0),
    left: bool = False,
    noise_px: FloatArray | None = None,
) -> Hand:
    """The palm as an exact detector would give it: pinhole image, world landmarks along the hand's own ray."""
    placed = palm_m(left) @ turned(*turn).T
    in_space = np.add(placed, (*aside_m, distance_m))
    image = in_space[:, :2] / in_space[:, 2:] * FOCAL_PX + CENTRE_PX
    x, y = aside_m[0] / distance_m, aside_m[1] / distance_m
    ray = np.array([x, y, 1.0]) / math.sqrt(x * x + y * y + 1)
    right = np.cross([0.0, 1.0, 0.0], ray) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], ray))
    along_ray = placed @ np.array([right, np.cross(ray, right), ray]).T
    return Hand(
        image_px=image + (0 if noise_px is None else noise_px),
        world_m=along_ray - along_ray.mean(axis=0),
        presence=0.9,
        side=Side.LEFT if left else Side.RIGHT,
    )


def robust(reference_m: float = REFERENCE_M) -> RobustRange:
    return RobustRange(focal_px=FOCAL_PX, reference_m=reference_m, centre_px=CENTRE_PX)


def measured(finder: RobustRange | PublishedRange, hand: Hand, at_ns: int = FRAME_NS) -> Distance:
    distance = finder.measure(hand, at_ns)
    assert distance is not None
    return distance


def skin_m(joints_m: float) -> float:
    """Where an anchor that holds at ANCHOR_HOLDS_M sees the skin of a palm whose joints are that far."""
    return (joints_m - HALF_PALM_M) / (1 - HALF_PALM_M / REFERENCE_HOLDS_M)


@given(distance_m=st.floats(0.1, 1.0))
def test_a_facing_palm_is_measured_by_both(distance_m: float) -> None:
    published = PublishedRange(focal_px=FOCAL_PX, reference_m=REFERENCE_M)
    assert measured(published, observed(distance_m)).shown_m == pytest.approx(distance_m, rel=0.02)
    assert measured(robust(), observed(skin_m(distance_m))).shown_m == pytest.approx(distance_m, rel=0.02)


@given(
    distance_m=st.floats(0.25, 0.8), pitch=st.floats(-0.7, 0.7), yaw=st.floats(-0.7, 0.7), roll=st.floats(-3, 3),
    left=st.booleans(),
)  # fmt: skip
def test_tilt_costs_the_robust_distance_little_and_its_safe_side_nothing(
    distance_m: float, pitch: float, yaw: float, roll: float, left: bool
) -> None:
    distance = measured(robust(), observed(skin_m(distance_m), turn=(pitch, yaw, roll), left=left))
    # An affine view overlooks perspective: near and tilted diagonally that costs a tenth.
    assert distance.shown_m == pytest.approx(distance_m, rel=0.14)
    assert distance.safe_m > 0.97 * distance_m


@given(distance_m=st.floats(0.14, 0.25), pitch=st.floats(-0.7, 0.7), yaw=st.floats(-0.7, 0.7))
def test_a_tilted_palm_so_near_that_its_wrist_is_out_reads_far_rather_than_near(
    distance_m: float, pitch: float, yaw: float
) -> None:
    distance = measured(robust(), observed(skin_m(distance_m), turn=(pitch, yaw, 0.0)))
    assert 0.80 * distance_m < distance.shown_m < 1.25 * distance_m
    assert distance.safe_m > 0.97 * distance_m


@given(pitch=st.floats(-0.6, 0.6), x=st.floats(-0.15, 0.15), y=st.floats(-0.1, 0.1))
def test_a_hand_off_the_axis_is_measured_along_its_ray(pitch: float, x: float, y: float) -> None:
    distance = measured(robust(), observed(skin_m(0.4), turn=(pitch, 0.0, 0.0), aside_m=(x, y)))
    assert distance.shown_m == pytest.approx(0.4, rel=0.10)
    assert distance.safe_m > 0.97 * 0.4


def test_published_reads_a_tilted_hand_far_as_in_the_paper() -> None:
    published = PublishedRange(focal_px=FOCAL_PX, reference_m=REFERENCE_M)
    near_cosine = measured(published, observed(0.4, turn=(0.0, math.radians(40), 0.0)))
    assert near_cosine.shown_m == pytest.approx(0.4 / math.cos(math.radians(40)), rel=0.02)


def test_a_tilt_that_the_landmarks_miss_is_still_seen_by_the_palm_s_shape() -> None:
    hand = observed(skin_m(0.4), turn=(0.0, math.radians(40), 0.0))
    flat = palm_m()
    blind = Hand(image_px=hand.image_px, world_m=flat - flat.mean(axis=0), presence=0.9, side=Side.RIGHT)
    distance = measured(robust(), blind)
    assert distance.shown_m == pytest.approx(0.4, rel=0.06)
    assert math.degrees(distance.tilt_rad) == pytest.approx(40, abs=4)


def test_an_upright_palm_has_a_small_margin_and_a_tilted_one_a_larger() -> None:
    upright, tilted = (measured(robust(), observed(skin_m(0.3), turn=(0.0, yaw, 0.0))) for yaw in (0.0, 0.7))
    assert upright.safe_m < 1.05 * upright.shown_m
    assert tilted.safe_m > 1.10 * tilted.shown_m


@given(st.floats(-0.6, 0.6), st.integers(0, 20), st.floats(-40, 40), st.floats(-40, 40))
def test_no_misplaced_keypoint_beside_the_knuckles_brings_the_button_s_distance_nearer_than_eq_4(
    pitch: float, keypoint: int, x_px: float, y_px: float
) -> None:
    hand = observed(skin_m(0.25), turn=(pitch, 0.0, 0.0))
    image_px = hand.image_px.copy()
    image_px[keypoint] += (x_px, y_px)
    misplaced = Hand(image_px=image_px, world_m=hand.world_m, presence=0.9, side=Side.RIGHT)
    reading = robust().explain(misplaced)
    if reading is not None:
        assert reading.far_m >= 1.03 * reading.readings_m[2] * (1 - 1e-9)


@given(x=st.floats(-0.25, 0.25), k1=st.floats(-0.15, 0.15))
def test_a_bent_lens_costs_nothing_once_its_distortion_is_known(x: float, k1: float) -> None:
    straight = observed(skin_m(0.4), aside_m=(x, 0.0))
    flat = (straight.image_px - CENTRE_PX) / FOCAL_PX
    bent = Hand(
        image_px=flat * (1 + k1 * (flat**2).sum(axis=1, keepdims=True)) * FOCAL_PX + CENTRE_PX,
        world_m=straight.world_m, presence=0.9, side=Side.RIGHT,
    )  # fmt: skip
    knowing = RobustRange(focal_px=FOCAL_PX, reference_m=REFERENCE_M, centre_px=CENTRE_PX, distortion=(k1, 0.0))
    assert measured(knowing, bent).shown_m == pytest.approx(measured(robust(), straight).shown_m, rel=0.003)


def test_a_wrist_out_of_the_image_leaves_half_the_decision_to_eq_4() -> None:
    hand = observed(skin_m(0.18), aside_m=(0.0, 0.03))
    assert hand.image_px[0, 1] > 2 * CENTRE_PX[1]
    misplaced = hand.image_px.copy()
    misplaced[0, 1] += 60
    guessed = Hand(image_px=misplaced, world_m=hand.world_m, presence=0.9, side=Side.RIGHT)
    assert measured(robust(), guessed).shown_m == pytest.approx(0.18, rel=0.05)


def test_one_near_outlier_is_outvoted_and_a_withdrawal_is_followed_at_once() -> None:
    finder = robust()
    for frame in range(1, 4):
        held = measured(finder, observed(skin_m(0.22)), frame * FRAME_NS)
    near = measured(finder, observed(skin_m(0.15)), 4 * FRAME_NS)
    assert near.safe_m == pytest.approx(held.safe_m)
    assert near.sd_m > 2 * held.sd_m
    again = measured(finder, observed(skin_m(0.15)), 5 * FRAME_NS)
    assert again.shown_m == pytest.approx(0.15, rel=0.02)
    assert measured(finder, observed(skin_m(0.22)), 6 * FRAME_NS).safe_m == pytest.approx(held.safe_m)


@pytest.mark.parametrize(("before_m", "after_m"), [(0.45, 0.15), (0.15, 0.40), (0.21, 0.11)])
def test_a_jump_that_no_hand_can_make_is_no_measurement_until_it_has_stayed(before_m: float, after_m: float) -> None:
    finder = robust()
    for frame in range(1, 4):
        finder.measure(observed(skin_m(before_m)), frame * FRAME_NS)
    jumped = [finder.measure(observed(skin_m(after_m)), frame * FRAME_NS) for frame in range(4, 4 + CONFIRM_FRAMES)]
    assert jumped[:-1] == [None] * (CONFIRM_FRAMES - 1)
    assert CONFIRM_FRAMES - 1 > GAP_FRAMES  # so the press has ended before the jump is believed
    assert jumped[-1] is not None


def test_knuckles_that_slip_together_in_one_frame_are_no_withdrawal() -> None:
    finder = robust()
    near = observed(0.16)
    slipped_px = near.image_px.copy()
    middle_px = near.palm_centre_px
    slipped_px[[5, 17]] = middle_px + (slipped_px[[5, 17]] - middle_px) / 2
    for frame in range(3):
        assert measured(finder, near, frame * FRAME_NS).safe_m < 0.19
    slipped = replace(near, image_px=slipped_px)
    reading = finder.explain(slipped)
    assert reading is not None
    assert reading.far_m > 0.27
    assert finder.measure(slipped, 3 * FRAME_NS) is None
    assert measured(finder, near, 4 * FRAME_NS).safe_m < 0.19
    for frame in range(5, 9):
        last = finder.measure(slipped, frame * FRAME_NS)
    assert last is not None, "it has stayed"


@given(st.floats(0.0, 1.0))
def test_the_fastest_push_is_no_jump(phase: float) -> None:
    """0.3 s from 36 cm to 14.5 and back, minimum jerk, sampled at any phase of the camera."""
    state = OutlierState()
    for frame in range(12):
        share = 1 - abs(min(2.0, max(0.0, (frame + phase - 1) * FRAME_NS / 0.15e9)) - 1)
        distance_m = 0.36 - 0.215 * minimum_jerk(share)
        state, believed = accept_distance(state, distance_m, (frame + 1) * FRAME_NS)
        assert believed


@pytest.mark.parametrize("rate_hz", [30, 45, 60, 90, 120])
def test_a_jump_that_stays_is_believed_after_a_press_has_ended(rate_hz: int) -> None:
    """A press ends half a frame after GAP_FRAMES, counted from the last distance that was believed."""
    period_ns = round(1e9 / rate_hz)
    state, now_ns = _stays(accept_distance(OutlierState(), 0.36, FRAME_NS)[0], 0.18, FRAME_NS, period_ns)
    assert state.last_m == 0.18
    assert (GAP_FRAMES + 0.5) * FRAME_NS <= now_ns - FRAME_NS - period_ns < (CONFIRM_FRAMES - 0.4) * FRAME_NS


@pytest.mark.parametrize("rate_hz", [30, 45, 60, 90, 120])
def test_a_jump_after_other_outliers_must_stay_as_long(rate_hz: int) -> None:
    period_ns = round(1e9 / rate_hz)
    state, now_ns = accept_distance(OutlierState(), 0.36, FRAME_NS)[0], FRAME_NS
    for _ in range(int(0.09 * rate_hz)):
        now_ns += period_ns
        state, _ = accept_distance(state, 0.10 if state.count % 2 else 0.12, now_ns)
    state, believed_ns = _stays(state, 0.19, now_ns, period_ns)
    assert state.last_m == 0.19
    assert believed_ns - now_ns - period_ns >= (CONFIRM_FRAMES - 1.5) * FRAME_NS


def _stays(state: OutlierState, distance_m: float, now_ns: int, period_ns: int) -> tuple[OutlierState, int]:
    """Frames of that distance until it is believed, and the capture of the one that is."""
    believed = False
    while not believed:
        now_ns += period_ns
        state, believed = accept_distance(state, distance_m, now_ns)
    return state, now_ns


@pytest.mark.parametrize("forget", ["reset", "gap"])
def test_another_hand_inherits_no_past(forget: str) -> None:
    finder = robust()
    for frame in range(1, 4):
        finder.measure(observed(0.60), frame * FRAME_NS)
    if forget == "reset":
        finder.reset()
    at_ns = 4 * FRAME_NS if forget == "reset" else 3_000_000_000
    assert measured(finder, observed(skin_m(0.30)), at_ns).shown_m == pytest.approx(0.30, rel=0.02)


@pytest.mark.parametrize(
    "hand",
    [
        Hand(image_px=np.zeros((21, 2)), world_m=palm_m(), presence=1, side=Side.LEFT),
        Hand(image_px=np.full((21, 2), np.nan), world_m=palm_m(), presence=1, side=Side.LEFT),
        Hand(image_px=observed(0.3).image_px, world_m=np.full((21, 3), np.nan), presence=1, side=Side.LEFT),
    ],
    ids=["a point", "not a number", "no landmarks"],
)
def test_keypoints_that_are_no_hand_give_no_distance(hand: Hand) -> None:
    assert robust().measure(hand, FRAME_NS) is None


def test_keypoints_that_are_no_palm_give_no_distance() -> None:
    image = observed(0.3).image_px.copy()
    image[list(RIGID)] = [(600, 300), (700, 300), (600, 400), (700, 400), (650, 200)]
    hand = Hand(image_px=image, world_m=palm_m(), presence=1, side=Side.LEFT)
    assert robust().measure(hand, FRAME_NS) is None


@pytest.mark.parametrize("make", [PublishedRange, RobustRange])
@pytest.mark.parametrize(
    ("focal_px", "reference_m", "fault"),
    [
        (0.0, 0.06, KgdfaFault.FOCAL_LENGTH),
        (-1.0, 0.06, KgdfaFault.FOCAL_LENGTH),
        (math.nan, 0.06, KgdfaFault.FOCAL_LENGTH),
        (math.inf, 0.06, KgdfaFault.FOCAL_LENGTH),
        (900.0, 0.0299, KgdfaFault.REFERENCE_LENGTH),
        (900.0, 0.1201, KgdfaFault.REFERENCE_LENGTH),
        (900.0, math.nan, KgdfaFault.REFERENCE_LENGTH),
    ],
)
def test_what_is_no_camera_or_no_palm_is_refused_by_name(
    make: type[PublishedRange] | type[RobustRange], focal_px: float, reference_m: float, fault: KgdfaFault
) -> None:
    with pytest.raises(KgdfaError) as raised:
        make(focal_px=focal_px, reference_m=reference_m)
    assert raised.value.code is fault


@given(tilt=st.floats(0, 1.0), roll=st.floats(-3, 3), stretch=st.floats(0.05, 5))
def test_the_palm_s_shape_gives_tilt_and_size_whatever_the_roll(tilt: float, roll: float, stretch: float) -> None:
    flat = np.zeros((21, 3))
    flat[list(RIGID), :2] = SHAPE
    view = view_palm(((flat @ turned(tilt, 0.0, roll).T)[list(RIGID), :2] * stretch).tolist())
    assert view.stretch == pytest.approx(stretch, rel=1e-6)
    assert view.tilt_rad == pytest.approx(tilt, abs=1e-4)
    assert view.misfit < 1e-9


@pytest.mark.parametrize("across", [False, True], ids=["turned about its length", "bent away"])
@pytest.mark.parametrize(("tilt_deg", "measures"), [(70.0, True), (80.0, False)])
def test_a_palm_seen_edge_on_has_no_distance(tilt_deg: float, measures: bool, across: bool) -> None:
    tilt_rad = math.radians(tilt_deg)
    hand = observed(skin_m(0.3), turn=(tilt_rad, 0.0, 0.0) if across else (0.0, tilt_rad, 0.0))
    assert (robust().measure(hand, 1) is not None) is measures
