"""The digital hand: its truth agrees with its image, its motion with its commands, its depth with the D435i's."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.cameras.digital_hand import skeleton
from hal.cameras.digital_hand.depth import (
    BASELINE_M,
    DEPTH_FOCAL_PX,
    FLIP_LOST,
    FLIP_M,
    FLIP_POWER,
    LEAST_M,
    DepthCamera,
)
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.movement import Tremor
from hal.cameras.digital_hand.raycast import Capsules, capsules_of, cast, grid_over, project_px
from hal.cameras.digital_hand.render import (
    WALL_M,
    Person,
    keypoints_m,
    lens_for,
    person_of,
    posed,
    render,
    true_depth,
)
from hal.cameras.digital_hand.skeleton import GESTURES, LOOK_ALIKES, POSES, HandPlace, HandShape, joints_m, placed_m
from hal.errors import CameraFault
from kgdfa.depth import DepthRange
from kgdfa.gesture import Gesture
from profiles import palm as palm_calibration
from tests.support.errors import refused
from tests.support.known_hands import known_hand

LENS = lens_for(320, 180)
SECOND = 1_000_000_000
palms = st.floats(0.06, 0.11)
turns = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
poses = st.sampled_from(sorted(POSES))


def hand_at(start_ns: int = 0) -> DigitalHandCamera:
    return DigitalHandCamera(seed=1, lens=LENS, clock_ns=lambda: start_ns)


def test_each_gesture_has_its_pose_and_no_two_poses_have_one_name() -> None:
    in_file = "hal/cameras/digital_hand/skeleton.py"
    assert [pose.name for pose in GESTURES] == [gesture.value for gesture in Gesture], f"GESTURES in {in_file}"
    assert len(POSES) == len(GESTURES) + len(LOOK_ALIKES), f"a name of GESTURES and of LOOK_ALIKES in {in_file}"


@given(palm=palms, left=st.booleans(), pose=poses, turn=turns)
def test_the_reference_segment_is_three_quarters_of_the_palm_in_every_pose(
    palm: float, left: bool, pose: str, turn: tuple[float, float, float]
) -> None:
    shape = HandShape(palm_width_m=palm, left=left)
    place = HandPlace(position_m=(0.02, -0.01, 0.4), turn_rad=turn)
    joints = placed_m(joints_m(shape, POSES[pose].angles_deg), place)
    assert np.linalg.norm(joints[5] - joints[17]) == pytest.approx(0.75 * palm)
    assert (joints[5] + joints[17]) / 2 == pytest.approx(np.array(place.position_m))


@given(palm=palms, pose=poses, other=poses)
def test_bones_keep_their_lengths_in_every_pose(palm: float, pose: str, other: str) -> None:
    shape = HandShape(palm_width_m=palm)
    bones = [(j, j + 1) for first in (1, 5, 9, 13, 17) for j in range(first, first + 3)]
    a, b = (joints_m(shape, POSES[name].angles_deg) for name in (pose, other))
    for start, end in bones:
        assert np.linalg.norm(a[start] - a[end]) == pytest.approx(np.linalg.norm(b[start] - b[end]))


def test_two_hands_stand_in_one_scene_the_nearer_one_in_front() -> None:
    near, far = (posed("5", lens=LENS, position_m=(0.0, 0.02, z)) for z in (0.3, 0.5))
    alone, behind = render(near, 1).image_bgr, replace(near, second=far)
    both = render(behind, 1, depth=True)
    swapped = render(replace(far, second=near), 1, depth=True)
    assert both.surface_m is not None
    assert swapped.surface_m is not None
    assert (both.surface_m == swapped.surface_m).all()
    assert both.surface_m.min() == pytest.approx(render(near, 1, depth=True).surface_m.min())  # type: ignore[union-attr]
    beside = replace(near, second=posed("0", person=person_of(3), lens=LENS, position_m=(0.15, 0.02, 0.5)))
    assert (render(beside, 1).image_bgr != alone).any()


@given(pose=poses, palm=palms)
def test_a_left_hand_is_the_mirror_of_a_right_one(pose: str, palm: float) -> None:
    right, left = (joints_m(HandShape(palm_width_m=palm, left=side), POSES[pose].angles_deg) for side in (False, True))
    assert left == pytest.approx(right * (-1, 1, 1))


@given(turn=turns)
def test_turns_are_rotations_and_tilt_is_the_palms_angle(turn: tuple[float, float, float]) -> None:
    place = HandPlace(position_m=(0, 0, 0.4), turn_rad=turn)
    assert place.rotation @ place.rotation.T == pytest.approx(np.eye(3), abs=1e-9)
    normal = place.rotation @ np.array([0.0, 0.0, -1.0])
    assert math.cos(place.tilt_rad) == pytest.approx(-normal[2])


@pytest.mark.parametrize("gesture", sorted(POSES))
@pytest.mark.parametrize("left", [False, True])
def test_every_joint_lies_inside_the_flesh_that_is_drawn(gesture: str, left: bool) -> None:
    person = Person(shape=HandShape(left=left))
    scene = posed(gesture, person=person, lens=lens_for(), position_m=(0.0, 0.0, 0.4))
    joints = keypoints_m(scene)
    assert joints is not None
    body = capsules_of(joints, person.shape)
    grid = grid_over(body, scene.lens, 850.0, 0.4)
    assert grid is not None
    surface = cast(body, grid, scene.lens)
    pixels = project_px(joints, scene.lens)
    columns = ((pixels[:, 0] - grid.left + 0.5) * grid.columns / grid.width).astype(int)
    rows = ((pixels[:, 1] - grid.top + 0.5) * grid.rows / grid.height).astype(int)
    in_front = surface[rows, columns]
    assert np.isfinite(in_front).all()
    assert (in_front < joints[:, 2] + 0.001).all()


def test_a_lone_ball_is_met_where_geometry_predicts() -> None:
    centre = np.array([[0.0, 0.0, 0.5]])
    body = Capsules(centre, centre + np.array([0.0, 0.0, 1e-4]), np.array([0.05]), np.array([0.05]), np.array([True]))
    lens = lens_for(321, 181)
    grid = grid_over(body, lens, 10_000.0, 0.5)
    assert grid is not None
    surface = cast(body, grid, lens)
    assert surface.min() == pytest.approx(0.45, abs=1e-4)
    wide = np.isfinite(surface).any(axis=0).sum() * grid.width / grid.columns
    assert wide == pytest.approx(2 * lens.fx_px * 0.05 / math.sqrt(0.5**2 - 0.05**2), abs=2.5)


def test_the_same_moment_is_the_same_image_and_another_seed_another() -> None:
    first, again = hand_at().render(SECOND), hand_at().render(SECOND)
    assert np.array_equal(first.image_bgr, again.image_bgr)
    other = DigitalHandCamera(seed=2, lens=LENS).render(SECOND)
    assert not np.array_equal(first.image_bgr, other.image_bgr)


def test_a_tremor_moves_the_hand_by_its_travel_about_where_it_would_be() -> None:
    shakes = Tremor(travel_m=0.02, frequency_hz=5.0, axis=(0.0, 0.0, 1.0))
    still, trembling = (DigitalHandCamera(tremor=one, clock_ns=lambda: 0) for one in (None, shakes))
    times_ns = range(0, SECOND, SECOND // 200)
    away_m = np.array([distance_m(trembling, now_ns) - distance_m(still, now_ns) for now_ns in times_ns])
    assert np.ptp(away_m) == pytest.approx(0.02, rel=0.01)
    assert away_m.mean() == pytest.approx(0.0, abs=1e-6)
    assert np.argmax(np.abs(np.fft.rfft(away_m))) == 5  # per second


def distance_m(camera: DigitalHandCamera, now_ns: int) -> float:
    """Of the hand's place."""
    place = camera.scene(now_ns).place
    assert place is not None
    return place.position_m[2]


def test_seeds_give_people_of_both_hands_many_tones_and_plausible_palms() -> None:
    people = [person_of(seed) for seed in range(60)]
    assert {person.shape.left for person in people} == {False, True}
    assert len({person.tone_bgr for person in people}) >= 6
    assert all(0.07 <= person.shape.palm_width_m <= 0.092 for person in people)
    assert person_of(5) == person_of(5)


@pytest.mark.parametrize("gesture", [pose.name for pose in GESTURES])
def test_a_shown_gesture_settles_within_a_quarter_second(gesture: str) -> None:
    camera = hand_at()
    camera.command(gesture=gesture, at_ns=SECOND)
    assert camera.scene(SECOND).angles_deg == pytest.approx(POSES["rest"].angles_deg)
    assert camera.scene(SECOND + 100_000_000).angles_deg != pytest.approx(POSES[gesture].angles_deg)
    assert camera.scene(SECOND + 250_000_000).angles_deg == pytest.approx(POSES[gesture].angles_deg)


def test_a_click_goes_under_the_threshold_and_back_within_its_time() -> None:
    camera = hand_at()
    camera.command(gesture="5", at_ns=0)
    camera.command(click_s=0.3, at_ns=SECOND)
    times = [SECOND + ms * 1_000_000 for ms in range(400)]
    distances = [distance_m(camera, t) for t in times]
    assert min(distances) < 0.16
    assert min(range(400), key=distances.__getitem__) == pytest.approx(150, abs=15)
    assert distances[-1] > 0.3
    assert max(abs(a - b) for a, b in pairwise(distances)) < 0.005


def test_pressing_holds_until_released() -> None:
    camera = hand_at()
    camera.command(press=True, at_ns=SECOND)
    assert distance_m(camera, 3 * SECOND) < 0.19
    camera.command(press=False, at_ns=3 * SECOND)
    assert distance_m(camera, 4 * SECOND) > 0.3


def test_the_past_stays_what_it_was_after_new_commands() -> None:
    camera = hand_at()
    camera.command(gesture="2", click_s=0.5, at_ns=SECOND)
    source = [SECOND + ms * 1_000_000 for ms in range(0, 900, 50)]
    before = [keypoints_m(camera.scene(t)) for t in source]
    camera.command(gesture="rock", press=True, at_ns=2 * SECOND)
    camera.command(gesture="none", at_ns=4 * SECOND)
    for t, known in zip(source, before, strict=True):
        assert keypoints_m(camera.scene(t)) == pytest.approx(known)


def test_none_leaves_the_image_and_a_gesture_comes_back() -> None:
    camera = hand_at()
    camera.command(gesture="none", at_ns=SECOND)
    assert camera.scene(2 * SECOND).place is None
    empty = camera.render(2 * SECOND).image_bgr.astype(float)
    with_hand = camera.render(SECOND // 2).image_bgr.astype(float)
    assert (np.abs(empty - with_hand).mean(axis=2) > 30).mean() > 0.01
    camera.command(gesture="5", at_ns=3 * SECOND)
    assert camera.scene(4 * SECOND).place is not None


def test_keys_move_the_hand_and_stop_at_its_reach() -> None:
    camera = hand_at()
    before = known_hand(camera.scene(SECOND))
    camera.command(move_m=(0.05, 0.0, 0.0), at_ns=SECOND)
    after = known_hand(camera.scene(2 * SECOND))
    assert before is not None
    assert after is not None
    assert (after.image_px[:, 0] > before.image_px[:, 0] + 10).all()
    for step in range(40):
        camera.command(move_m=(0.0, 0.0, 0.1), at_ns=(3 + step) * SECOND)
    assert distance_m(camera, 60 * SECOND) < 0.9


def test_what_does_not_exist_is_refused_by_name() -> None:
    with refused(CameraFault.UNKNOWN_POSE, pose="ten"):
        hand_at().command(gesture="ten")
    with refused(CameraFault.CLICK_OUT_OF_RANGE):
        hand_at().command(click_s=-1.0)
    with refused(CameraFault.RATE_OUT_OF_RANGE):
        DigitalHandCamera(rate_hz=0)


@settings(max_examples=20, deadline=None)
@given(pose=poses, x=st.floats(-0.5, 0.5), y=st.floats(-0.4, 0.6), z=st.floats(0.05, 1.0), turn=turns)
def test_any_place_renders_a_whole_image(
    pose: str, x: float, y: float, z: float, turn: tuple[float, float, float]
) -> None:
    observed = render(posed(pose, lens=LENS, position_m=(x, y, z), turn_rad=turn), depth=True)
    assert observed.image_bgr.shape == (180, 320, 3)
    assert observed.surface_m is not None
    assert np.isfinite(observed.surface_m).all()


def scene_depth(distance_m: float) -> tuple[np.ndarray, np.ndarray]:
    """True and measured depth of an open hand."""
    surface = render(posed("5", lens=LENS, position_m=(0, 0, distance_m)), depth=True).surface_m
    assert surface is not None
    return surface, DepthCamera(1).measure(surface, 3)


def test_depth_is_zero_nearer_than_the_d435i_can_see() -> None:
    surface, measured = scene_depth(0.18)
    assert (surface < LEAST_M).any()
    assert (measured[surface < LEAST_M] == 0).all()


def test_depth_is_zero_left_of_the_hand_and_right_elsewhere_on_it() -> None:
    """The right imager sees the hand where the left one sees the wall beside it."""
    surface, measured = scene_depth(0.45)
    hand = surface < 0.6
    row = int(np.argmax(hand.sum(axis=1)))
    left, right = np.flatnonzero(hand[row])[[0, -1]]
    shadow_px = DEPTH_FOCAL_PX * BASELINE_M * (1 / 0.45 - 1 / WALL_M) * surface.shape[1] / 1280
    assert shadow_px > 8
    assert (measured[row, left - round(0.8 * shadow_px) : left] == 0).all()
    assert (measured[row, left - round(1.5 * shadow_px) - 8 : left - round(1.2 * shadow_px)] > 0).all()
    assert (measured[row, right + 2 : right + 10] > 0).all()
    inside = cv2.erode(hand.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool) & (measured > 0)
    assert inside.sum() > 100
    assert np.abs(measured[inside] - surface[inside]).mean() < 0.004


@pytest.mark.parametrize("z_m", [0.3, 0.5, 1.0])
def test_the_invalid_band_is_at_the_left_edge_and_as_wide_as_the_disparity(z_m: float) -> None:
    measured = DepthCamera(1).measure(np.full((360, 640), z_m, np.float32), 3)
    band_px = round(DEPTH_FOCAL_PX * BASELINE_M / z_m * 640 / 1280)
    assert (measured[:, : band_px - 1] == 0).all()
    assert (measured[10:-10, band_px + 1 : -10] > 0).all()
    assert (measured[[0, -1]] == 0).all()
    assert (measured[:, -1] == 0).all()


@pytest.mark.parametrize(("before_m", "hidden"), [(0.04, True), (0.01, False)])
def test_a_shadow_narrower_than_the_matchers_window_is_measured(before_m: float, hidden: bool) -> None:
    """A finger 4 cm before the palm shadows it at 30 cm, one that lies on it doesn't."""
    palm = np.full((720, 1280), 0.30, np.float32)
    palm[200:500, 600:640] = 0.30 - before_m
    measured = DepthCamera(1).measure(palm, 3)
    assert (measured[220:480, 594:599] == 0).all() == hidden
    assert (measured[220:480, 645:700] > 0).all()


def test_depth_noise_grows_with_the_square_of_distance() -> None:
    flat = [np.full((180, 320), z, np.float32) for z in (0.5, 1.0, 2.0)]
    noise = [float((DepthCamera(1).measure(z, 5)[20:160, 40:280] - z[0, 0]).std()) for z in flat]
    assert noise[1] / noise[0] == pytest.approx(4.0, rel=0.25)
    assert noise[2] / noise[1] == pytest.approx(4.0, rel=0.25)


@pytest.mark.parametrize("z_m", [0.26, 0.30, 0.40, 0.60])
def test_a_flipping_hand_loses_patches_the_more_the_nearer_it_is(z_m: float) -> None:
    flat, camera = np.full((400, 800), z_m, np.float32), DepthCamera(1)
    inside = (slice(20, -20), slice(100, -20))
    lost = [float((camera.measure(flat, frame, True)[inside] == 0).mean()) for frame in range(100)]
    assert np.mean(lost) == pytest.approx(FLIP_LOST * (FLIP_M / z_m) ** FLIP_POWER, rel=0.15, abs=0.0005)
    assert (camera.measure(flat, 5)[inside] > 0).all()


def test_a_flip_leaves_the_room_behind_the_hand() -> None:
    surface = np.full((400, 800), 1.2, np.float32)
    surface[:, 400:] = 0.26
    lost = [DepthCamera(1).measure(surface, frame, True) == 0 for frame in range(100)]
    assert not np.any([one[20:-20, 100:300] for one in lost])


def test_depth_misses_the_hand_in_its_share_of_frames() -> None:
    surface = np.full((180, 320), 1.2, np.float32)
    surface[60:120, 120:200] = 0.5
    inside = (slice(75, 105), slice(130, 190))
    holed = DepthCamera(1, holes=0.4)

    def missed(camera: DepthCamera, frame: int) -> bool:
        return bool((np.abs(camera.measure(surface, frame)[inside] - 0.5) > 0.02).mean() > 0.1)

    # Of the patchy third some leave this part of it whole.
    assert 0.25 < sum(missed(holed, frame) for frame in range(300)) / 300 < 0.45
    assert not any(missed(DepthCamera(1), frame) for frame in range(10))


@pytest.mark.parametrize("gesture", [pose.name for pose in GESTURES])
def test_the_palm_is_measured_under_folded_fingers_in_every_gesture(gesture: str) -> None:
    """At keypoint 21 alone a fist reads 5 cm near."""
    lens = lens_for(640, 360)
    for seed in (5000, 5001):
        scene = posed(gesture, person=person_of(seed), lens=lens, position_m=(0, 0.015, 0.34))
        joints, shown = keypoints_m(scene), known_hand(scene)
        assert joints is not None
        assert shown is not None
        distance = DepthRange(mode="robust").measure(DepthCamera(seed).measure(true_depth(scene), seed), shown, 1)
        assert distance is not None
        assert -0.02 < distance.safe_m - joints[[5, 17], 2].mean() < 0.01


def test_true_depth_is_what_the_image_is_rendered_from() -> None:
    scene = posed("5", lens=LENS, position_m=(0.02, 0, 0.3))
    np.testing.assert_array_equal(true_depth(scene), render(scene, depth=True).surface_m)


def test_the_rendered_hand_has_the_ratio_that_the_calibration_assumes() -> None:
    assert skeleton.REFERENCE_OF_PALM == palm_calibration.REFERENCE_OF_PALM
