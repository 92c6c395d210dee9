"""Legs that lose their power in the middle of an action: the wearer sinks, is lifted, and INITIALISE is planned."""

from __future__ import annotations

import numpy as np
import pytest

from app.ipc.states import Action, GaitState
from app.motion import follower
from app.motion.plan import Phase, PlanRequest, patient_of, quad
from app.motion.rehearsal import RehearsalRun
from app.motion.trajectory import nominal_pose, plan
from app.motion.transfer import chair_scene
from hal.joints.device import load_exoskeleton
from hal.joints.protocol import TICK_NS, JointCommand
from hal.joints.simulated.driver import SimulatedJoints
from profiles.schema import DEMO_PATIENT

DEVICE = load_exoskeleton()
PATIENT = patient_of(DEMO_PATIENT, DEVICE)
DAMPED_TICKS, UNPOWERED_TICKS = 1000, 5000  # the guardian's damping; sinking, 3 s, and up to 6 s of lifting
DAMPED = JointCommand(
    position_rad=np.zeros(4),
    velocity_rad_s=np.zeros(4),
    stiffness_nm_rad=np.zeros(4),
    damping_nm_s_rad=np.full(4, 4.5),
    torque_nm=np.zeros(4),
)


def lose_power(joints: SimulatedJoints, now_ns: int) -> None:
    """First damped, then off."""
    for tick in range(DAMPED_TICKS + UNPOWERED_TICKS):
        if tick == DAMPED_TICKS:
            joints.close(now_ns)
        now_ns += TICK_NS
        joints.write(DAMPED, now_ns)


@pytest.mark.parametrize("share", [0.3, 0.6])
@pytest.mark.parametrize("action", [Action.WALK, Action.STAIR_UP, Action.STAIR_DOWN, Action.OBSTACLE, Action.STAND_UP])
def test_after_power_was_lost_in_an_action_the_legs_can_be_brought_to_standing(action: Action, share: float) -> None:
    run = RehearsalRun(PATIENT, DEVICE, action)
    assert run.prepare() is None
    phase = Phase.WALK_START if action is Action.WALK else Phase.WHOLE
    made = run.plan_next(1, action, phase)
    interrupted = round(share * len(made.position_rad))
    run.motion = follower.start_plan(run.motion, made)
    for _ in range(interrupted):
        assert run.tick() is None
    lose_power(run.joints, run.now_ns)
    measured = run.joints.read(run.now_ns).position_rad
    state = GaitState.UNPOWERED
    request = PlanRequest(
        number=2, action=Action.INITIALISE, phase=Phase.WHOLE, from_state=state, start_rad=quad(measured)
    )
    assert plan(request, PATIENT).check.reason is None


def test_a_wearer_who_sits_without_power_is_left_on_the_chair() -> None:
    joints = SimulatedJoints(DEVICE, PATIENT.body)
    joints.place(nominal_pose(GaitState.SITTING, PATIENT))
    joints.stage(chair_scene(PATIENT))
    joints.open(TICK_NS)
    joints.enable(TICK_NS)
    seated_m = joints.ground_truth().hip_z_m
    lose_power(joints, TICK_NS)
    assert joints.ground_truth().hip_z_m == pytest.approx(seated_m, abs=0.05)
