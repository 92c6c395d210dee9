"""Simulated joints: drives saturate, scenes stand where they are put."""

from __future__ import annotations

import numpy as np
import pytest

from hal.joints.body import average_body
from hal.joints.device import load_exoskeleton
from hal.joints.protocol import JointArray, JointCommand
from hal.joints.scene import Block, BlockKind, Scene
from hal.joints.simulated.driver import SimulatedJoints

TICK_NS = 2_000_000
STANDING = np.radians([4.0, 8.0, 4.0, 8.0])
STANDING_NM = np.array([3.0, -6.5, 3.0, -6.5])  # what standing so asks of the joints


def hold(
    position_rad: JointArray = STANDING, stiffness: float = 400.0, torque: float | JointArray = STANDING_NM
) -> JointCommand:
    return JointCommand(
        position_rad=position_rad,
        velocity_rad_s=np.zeros(4),
        stiffness_nm_rad=np.full(4, stiffness),
        damping_nm_s_rad=np.full(4, 4.5),
        torque_nm=np.zeros(4) + torque,
    )


@pytest.fixture
def joints() -> SimulatedJoints:
    simulated = SimulatedJoints(load_exoskeleton(), average_body(1.7, 65.0), noisy=False, quantised=False)
    simulated.place(STANDING)
    simulated.open(TICK_NS)
    simulated.enable(TICK_NS)
    return simulated


def run(joints: SimulatedJoints, ticks: int, command: JointCommand, start: int = 1) -> int:
    for tick in range(start + 1, start + 1 + ticks):
        joints.write(command, tick * TICK_NS)
        joints.read(tick * TICK_NS)
    return start + ticks


def test_a_held_wearer_stands_still_with_half_the_weight_on_the_feet(joints: SimulatedJoints) -> None:
    run(joints, 750, hold())
    truth = joints.ground_truth()
    assert np.abs(truth.joints_rad - STANDING).max() < np.radians(3)
    assert np.isclose(truth.contact_n.sum(), joints.wearer.weight_n / 2, rtol=0.05)
    assert abs(truth.hip_x_m) < 0.03


def test_without_power_the_harness_catches_the_wearer(joints: SimulatedJoints) -> None:
    before = joints.ground_truth().hip_z_m
    joints.close(TICK_NS)
    run(joints, 1000, hold())
    assert before - 0.08 < joints.ground_truth().hip_z_m <= before


def test_a_wearer_who_sank_is_lifted_without_power_and_not_while_the_drives_damp(joints: SimulatedJoints) -> None:
    upright_m, damped = joints.ground_truth().hip_z_m, hold(stiffness=0.0, torque=0.0)
    ticks = run(joints, 3000, damped)
    assert joints.ground_truth().hip_z_m < upright_m - 0.1
    joints.close(ticks * TICK_NS)
    run(joints, 5000, damped, ticks)
    assert joints.ground_truth().hip_z_m == pytest.approx(upright_m, abs=0.03)
    assert np.abs(joints.wearer.joints_rad).max() < np.radians(30)
    assert joints.contact_n() != (0.0, 0.0), "on the floor, not above it"


def test_no_drive_gives_more_than_it_has(joints: SimulatedJoints) -> None:
    joints.write(hold(torque=5000.0), 2 * TICK_NS)
    limits = [joint.max_torque_nm for joint in load_exoskeleton().joints]
    assert (np.abs(joints.torque_nm) <= limits).all()


def test_without_noise_and_quanta_the_truth_is_reported_and_with_them_nearly(joints: SimulatedJoints) -> None:
    assert np.array_equal(joints.read(3 * TICK_NS).position_rad, joints.wearer.joints_rad)
    noisy = SimulatedJoints(load_exoskeleton(), average_body(1.7, 65.0))
    noisy.place(STANDING)
    noisy.open(TICK_NS)
    error = noisy.read(2 * TICK_NS).position_rad - STANDING
    assert 0 < np.abs(error).max() < np.radians(0.1)


def test_a_floor_that_is_lowered_is_out_of_reach_and_a_block_carries(joints: SimulatedJoints) -> None:
    run(joints, 300, hold())
    under = Block(kind=BlockKind.STEP, from_x_m=-1.0, to_x_m=1.0, top_m=0.0)
    joints.stage(Scene(floor_m=-0.2, blocks=(under,)))
    run(joints, 300, hold(), 301)
    truth = joints.ground_truth()
    assert truth.contact_n.min() > 50
    assert truth.deepest_m < 0.005
