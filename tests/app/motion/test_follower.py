"""The follower's commands pass the guard on any device that its file may describe."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from app.ipc.states import Action, GaitState
from app.motion import follower
from app.motion.follower import NEUTRAL, Gains, Mode, Motion, gains_of
from app.motion.plan import Phase, PlanRequest
from hal.joints.device import Exoskeleton, load_exoskeleton
from hal.joints.guard import Guard, limits_of
from hal.joints.protocol import JointCommand
from tests.app.control.instant_planner import make_plan
from tests.support.can_rig import each_joint

ZERO = np.zeros(4)


def weak(torque_nm: float) -> Exoskeleton:
    return each_joint(load_exoskeleton(), lambda _, joint: msgspec.structs.replace(joint, max_torque_nm=torque_nm))


def refusals(device: Exoskeleton, motion: Motion, gains: Gains, previous: JointCommand, ticks: int) -> list[object]:
    """What the guard of this device refuses of the commands that follow."""
    guard, found = Guard(limits_of(device)), []
    for _ in range(ticks):
        motion = follower.advance(motion, gains, hold=False)
        found.append(guard.check(motion.command, previous, motion.command.position_rad))
        previous = motion.command
    return [refusal for refusal in found if refusal is not None]


@pytest.mark.parametrize("torque_nm", [5.0, 20.0, 25.0, 110.0])
def test_the_torque_of_a_plan_changes_no_faster_than_the_guard_allows(torque_nm: float) -> None:
    device = weak(torque_nm)
    gains = gains_of(device, 1.0, 1.0)
    held = follower.advance(Motion(mode=Mode.STIFFENING, ramp=1.0), gains, hold=False)
    request = PlanRequest(
        number=1, action=Action.STEP_RIGHT_FIRST, phase=Phase.WHOLE, from_state=GaitState.STANDING, start_rad=(0.0,) * 4
    )
    plan = msgspec.structs.replace(made := make_plan(request, 0.4), torque_nm=made.position_rad * 0 + 0.8 * torque_nm)
    assert not refusals(device, follower.start_plan(held, plan), gains, held.command, 100)


def test_a_refusal_while_the_joints_are_stiffened_damps_them_from_what_was_written() -> None:
    device = load_exoskeleton()
    gains = gains_of(device, 1.0, 1.0)
    motion = follower.advance(follower.start_stiffening(np.full(4, 0.1), gains), gains, hold=True)
    for written in (NEUTRAL, motion.command):
        after = follower.resume_from(motion, written)
        assert (after.mode, after.command, after.ramp) == (Mode.DAMPED, written, 0.0)
        assert not refusals(device, after, gains, written, 200)
