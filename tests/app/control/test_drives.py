"""The door to the joints at the end of a session: what is confirmed to be off is neither damped nor guarded."""

from __future__ import annotations

import numpy as np

from app.control.drives import Drives
from app.control.inputs import DriveOrder
from app.motion import follower
from app.motion.follower import gains_of
from app.motion.plan import body_of
from hal.joints.device import load_exoskeleton
from hal.joints.guard import limits_of
from hal.joints.protocol import DriveState, JointCommand
from hal.joints.simulated.driver import SimulatedJoints
from profiles.schema import DEMO_PATIENT

DEVICE = load_exoskeleton()


class CountingJoints(SimulatedJoints):
    """Counts what is written."""

    writes = 0

    def write(self, command: JointCommand, now_ns: int) -> None:
        self.writes += 1
        super().write(command, now_ns)


def powered() -> tuple[CountingJoints, Drives]:
    joints = CountingJoints(DEVICE, body_of(DEMO_PATIENT))
    drives = Drives(joints, limits_of(DEVICE), gains_of(DEVICE, 1.0, 1.0))
    drives.open(1)
    drives.execute(DriveOrder.ENABLE, 2)
    feedback = drives.read(3)
    drives.write(follower.NEUTRAL, feedback, 3)
    assert drives.powered
    return joints, drives


def test_drives_commanded_off_are_off_at_once() -> None:
    joints, drives = powered()
    assert drives.execute(DriveOrder.DISABLE, 4)
    assert not drives.powered
    before = joints.writes
    assert drives.close() is None
    assert joints.writes == before, "an orderly end has damped already: to do it again takes a third of a second"


def test_drives_left_powered_are_damped_before_they_are_let_go() -> None:
    joints, drives = powered()
    before = joints.writes
    assert drives.close() is None
    assert joints.writes > before
    assert joints.read(10).state is DriveState.DISABLED
    assert np.allclose(joints.torque_nm, 0.0)


def test_while_they_are_damped_the_guardian_is_informed_and_at_last_that_nothing_is_left_to_guard() -> None:
    joints, drives = powered()
    beats: list[bool] = []
    before = joints.writes
    assert drives.close(beats.append) is None
    assert beats == [True] * (joints.writes - before) + [False]
