from __future__ import annotations

import numpy as np
import pytest

from app.evaluate.gestures.joint_ranges import (
    FIRST_PERSON,
    JOINTS,
    _accepted,
    _around,
    joint_space_table,
    measure_joint_space,
)
from app.evaluate.gestures.joint_space import LABEL, Errors, joint_hands, label_by_joints, scene_about
from app.evaluate.noise import residual
from hal.cameras.digital_hand.raycast import project_px
from hal.cameras.digital_hand.render import Scene, keypoints_m
from hal.cameras.digital_hand.skeleton import GESTURES, LOOK_ALIKES, POSES
from kgdfa.hand import Hand, Side
from kgdfa.robust import RobustRules

NO_ERRORS = Errors(angles_deg=np.array([POSES["5"].angles_deg]), image=np.zeros((1, 21, 2)), world=np.zeros((1, 21, 3)))


@pytest.mark.parametrize("pose", [*GESTURES, *LOOK_ALIKES], ids=lambda pose: pose.name)
def test_joint_angles_name_every_gesture_and_no_look_alike(pose: object) -> None:
    assert label_by_joints(pose.angles_deg) == (pose.name if pose in GESTURES else LABEL)  # type: ignore[attr-defined]


def test_a_finger_between_open_and_folded_has_no_label() -> None:
    angles = POSES["2"].angles_deg
    angles[3] = 0, 60, 70, 45, 0, 0  # the ring finger, neither folded nor clearly not
    assert label_by_joints(angles) is None


def test_a_pinch_with_open_tips_is_no_7() -> None:
    angles = POSES["7"].angles_deg
    angles[0] = POSES["5"].angles_deg[0]
    assert label_by_joints(angles) != "7"


def test_an_error_taken_from_a_hand_is_put_back_on_it() -> None:
    random = np.random.default_rng(1)
    scene = scene_about(POSES["4"].angles_deg, 3, random)
    joints = keypoints_m(scene)
    assert joints is not None
    seen = Hand(
        image_px=project_px(joints, scene.lens) + random.normal(0, 2, (21, 2)),
        world_m=joints - joints.mean(axis=0) + random.normal(0, 0.002, (21, 3)),
        presence=1.0,
        side=Side.RIGHT,
    )
    image, world = residual(seen, scene)
    again = Errors(angles_deg=scene.angles_deg[None], image=image[None], world=world[None]).observe(scene, random)
    assert again is not None
    np.testing.assert_allclose(again.image_px, seen.image_px, atol=1e-6)
    np.testing.assert_allclose(again.world_m, seen.world_m, atol=1e-9)


def test_hands_from_joint_space_are_counted_by_what_they_show() -> None:
    figures = measure_joint_space(RobustRules(), NO_ERRORS, 60)
    assert sum(figures.shown.values()) == figures.hands == 60
    assert figures.wrongly_accepted == sum(figures.wrong.values()) / 60
    assert joint_space_table(figures).row_count == 13
    labels = {one.label for one in joint_hands(NO_ERRORS, 60, 9_000_000, ("1", "rock"))}
    assert {"1", "rock", LABEL} <= labels


def test_a_range_is_what_is_taken_about_the_pose() -> None:
    values = np.arange(0.0, 60.0, 10.0)
    assert _around(np.array([True, False, True, True, False, True]), values, 24.0) == (20.0, 30.0)
    assert _around(np.zeros(6, bool), values, 24.0) == (None, None)


class OutOfView(Errors):
    """Nobody's hand is in the image."""

    def observe(self, scene: Scene, random: np.random.Generator) -> None:
        """It sees none."""


def test_a_pose_that_nobody_shows_in_view_is_accepted_of_nobody() -> None:
    pose_deg = POSES["5"].angles_deg
    assert _accepted(RobustRules(), NO_ERRORS, "5", pose_deg) == 1.0
    outside = OutOfView(angles_deg=NO_ERRORS.angles_deg, image=NO_ERRORS.image, world=NO_ERRORS.world)
    assert _accepted(RobustRules(), outside, "5", pose_deg) == 0.0


def test_a_walked_joint_takes_along_what_moves_with_it() -> None:
    middle = next(joint for joint in JOINTS if joint.name == "ring middle")
    moved = middle.moved(POSES["5"].angles_deg, 100.0)
    assert moved[3, 2:4].tolist() == [100.0, 65.0]
    assert np.count_nonzero(moved != POSES["5"].angles_deg) == 2


def test_another_seed_draws_other_hands_from_joint_space() -> None:
    hands = [[one.angles_deg for one in joint_hands(NO_ERRORS, 5, FIRST_PERSON + 5 * seed)] for seed in (0, 0, 1)]
    np.testing.assert_array_equal(hands[0], hands[1])
    assert not np.array_equal(hands[0], hands[2])
    counted = [measure_joint_space(RobustRules(), NO_ERRORS, 40, seed=seed) for seed in (0, 3)]
    assert [one.hands for one in counted] == [40, 40]
