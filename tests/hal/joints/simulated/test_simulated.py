"""Simulated joints: injected faults show as real ones would, drives saturate, scenes stand where they are put."""

from __future__ import annotations

import numpy as np
import pytest

from hal.errors import DrivesFault, HardwareError
from hal.joints.body import average_body
from hal.joints.device import load_exoskeleton
from hal.joints.protocol import BusFault, DriveFault, DriveState, Joint, JointArray, JointCommand
from hal.joints.scene import Block, BlockKind, Scene
from hal.joints.simulated.driver import SimulatedJoints
from tests.support.errors import refused

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


def test_an_unresponsive_drive_keeps_its_last_time_and_value(joints: SimulatedJoints) -> None:
    tick = run(joints, 10, hold())
    joints.silence(Joint.LEFT_KNEE)
    before = joints.read(tick * TICK_NS)
    run(joints, 50, hold(STANDING + 0.1), tick)
    after = joints.read((tick + 50) * TICK_NS)
    assert after.measured_ns[Joint.LEFT_KNEE] == before.measured_ns[Joint.LEFT_KNEE]
    assert after.position_rad[Joint.LEFT_KNEE] == before.position_rad[Joint.LEFT_KNEE]
    assert after.measured_ns[Joint.RIGHT_KNEE] == (tick + 50) * TICK_NS


def test_an_unresponsive_drive_is_named_when_opening() -> None:
    joints = SimulatedJoints(load_exoskeleton(), average_body(1.7, 65.0))
    joints.silence(Joint.RIGHT_HIP)
    with refused(DrivesFault.NO_REPLY, joints=(Joint.RIGHT_HIP,)):
        joints.open(0)


def test_a_fault_bit_is_reported_takes_the_torque_and_forbids_enabling(joints: SimulatedJoints) -> None:
    joints.raise_fault(Joint.LEFT_HIP, DriveFault.ENCODER)
    run(joints, 5, hold(STANDING + 0.2))
    feedback = joints.read(9 * TICK_NS)
    assert feedback.faults[Joint.LEFT_HIP] is DriveFault.ENCODER
    assert feedback.state is DriveState.FAULTED
    assert feedback.torque_nm[Joint.LEFT_HIP] == 0.0
    joints.close(10 * TICK_NS)
    with pytest.raises(HardwareError):
        joints.enable(11 * TICK_NS)


def test_a_stuck_joint_does_not_follow(joints: SimulatedJoints) -> None:
    joints.jam(Joint.RIGHT_KNEE)
    run(joints, 300, hold(STANDING + np.array([0.0, 0.0, 0.0, 0.5])))
    assert abs(joints.wearer.joints_rad[Joint.RIGHT_KNEE] - STANDING[Joint.RIGHT_KNEE]) < np.radians(3)


def test_a_drag_makes_a_following_error(joints: SimulatedJoints) -> None:
    target = STANDING + np.array([0.0, 0.0, 0.4, 0.4])
    run(joints, 60, hold(target))
    free = joints.wearer.joints_rad[Joint.RIGHT_HIP]
    joints.place(STANDING)
    joints.drag(Joint.RIGHT_HIP, 80.0)
    run(joints, 60, hold(target))
    assert joints.wearer.joints_rad[Joint.RIGHT_HIP] < free - np.radians(1)


def test_a_winding_can_be_made_hot(joints: SimulatedJoints) -> None:
    joints.warm_to(Joint.LEFT_KNEE, 91.0)
    feedback = joints.read(TICK_NS)
    assert feedback.temperature_c[Joint.LEFT_KNEE] == 91.0
    assert feedback.temperature_c[Joint.LEFT_HIP] < 30.0


def test_lost_frames_leave_old_answers(joints: SimulatedJoints) -> None:
    joints.lose_frames(1.0)
    run(joints, 10, hold())
    assert (joints.read(99 * TICK_NS).measured_ns == TICK_NS).all()


def test_a_bus_fault_is_reported_once(joints: SimulatedJoints) -> None:
    joints.disturb_bus(BusFault.BUS_OFF)
    assert joints.read(2 * TICK_NS).bus is BusFault.BUS_OFF
    assert joints.read(3 * TICK_NS).bus is BusFault.NONE


def test_mending_ends_every_fault(joints: SimulatedJoints) -> None:
    joints.silence(Joint.LEFT_HIP)
    joints.raise_fault(Joint.LEFT_KNEE, DriveFault.OVERLOAD)
    joints.clear_faults()
    feedback = joints.read(5 * TICK_NS)
    assert feedback.faults == (DriveFault.NONE,) * 4
    assert (feedback.measured_ns == 5 * TICK_NS).all()


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
