"""Stopped in the middle of anything: nothing moves under the wearer, gesture 0 leads back, and what follows works."""

from __future__ import annotations

import numpy as np
import pytest

from app.control.drives import Drives
from app.control.events.drives import FOLLOWING_LIMIT_RAD, POSE_LIMIT_RAD
from app.control.gait import machine as gait_machine
from app.control.gait.machine import Change, Gait, Started, changed
from app.control.inputs import DriveOrder
from app.ipc.states import Action, GaitState
from app.motion import follower
from app.motion.follower import Mode, Motion, gains_of
from app.motion.plan import Phase, PlanRequest, patient_of
from app.motion.trajectory import RECIPES, nominal_pose, path_of, plan, scene_of
from hal.joints.device import load_exoskeleton
from hal.joints.guard import SPEED_MARGIN, TORQUE_MARGIN, limits_of
from hal.joints.protocol import TICK_HZ
from hal.joints.simulated.driver import SimulatedJoints
from profiles.schema import DEMO_PATIENT

TICK_NS = 1_000_000_000 // TICK_HZ
DEVICE = load_exoskeleton()
PATIENT = patient_of(DEMO_PATIENT, DEVICE)
LIMITS = limits_of(DEVICE, PATIENT.hip_max_rad, PATIENT.knee_max_rad)
SCENES = {action: scene_of(action, PATIENT) for action in Action}
SETTLED_TICKS = 100
QUIET_RAD_S = 0.3  # a held leg sways in the harness
LEVEL_M = 0.01

A, S = Action, GaitState
PROGRESS = tuple(part / 10 for part in range(1, 10))
INTERRUPTED = tuple(key for key in RECIPES if key != (A.WALK_END, Phase.WALK_CLOSE_LEFT))  # the other one's mirror
# Carried out in simulation: over each thing early, with a foot on either side, and late; and one action after each.
CARRIED_OUT = (
    (A.STAIR_UP, 0.2, A.STAIR_DOWN),
    (A.STAIR_UP, 0.5, A.OBSTACLE),
    (A.STAIR_DOWN, 0.5, A.WALK),
    (A.STAIR_DOWN, 0.8, A.STAIR_UP),
    (A.OBSTACLE, 0.5, A.SIT_DOWN),
    (A.SIT_DOWN, 0.5, A.STEP_RIGHT_FIRST),
)


class Legs:
    """Simulated legs behind their guard, moved tick by tick; what would damp or hold a session fails the test."""

    def __init__(self) -> None:
        self.joints = SimulatedJoints(DEVICE, PATIENT.body)
        self.gains = gains_of(DEVICE, 1.0, 1.0)
        self.drives = Drives(self.joints, LIMITS, self.gains, SCENES)
        self.motion = Motion()
        self.gait = Gait(state=GaitState.STANDING)
        self.now_ns = TICK_NS
        self.joints.place(nominal_pose(GaitState.STANDING, PATIENT))
        self.drives.open(self.now_ns)
        self.drives.execute(DriveOrder.ENABLE, self.now_ns)
        self.motion = follower.start_stiffening(self.tick(hold=False), self.gains)
        while self.motion.mode is not Mode.HOLDING:
            self.tick(hold=False)

    def tick(self, *, hold: bool) -> np.ndarray:
        self.now_ns += TICK_NS
        feedback = self.drives.read(self.now_ns)
        self.motion = follower.advance(self.motion, self.gains, hold=hold)
        self.drives.write(self.motion.command, feedback, self.now_ns)
        assert self.drives.refusal is None
        assert (np.abs(feedback.velocity_rad_s) <= SPEED_MARGIN * LIMITS.speed_rad_s).all()
        assert (np.abs(feedback.torque_nm) <= TORQUE_MARGIN * LIMITS.torque_nm).all()
        if self.motion.mode in {Mode.HOLDING, Mode.MOVING}:
            assert np.abs(self.motion.command.position_rad - feedback.position_rad).max() <= FOLLOWING_LIMIT_RAD
        return feedback.position_rad.copy()

    def rest(self, ticks: int = SETTLED_TICKS) -> float:
        """The fastest that a joint turns meanwhile, rad/s."""
        fastest = 0.0
        for _ in range(ticks):
            self.tick(hold=True)
            fastest = max(fastest, float(np.abs(self.joints.wearer.speeds_rad_s).max()))
        return fastest

    def begin(self, action: Action) -> None:
        answer = gait_machine.ask(self.gait, action)
        assert isinstance(answer, Started)
        self.gait = answer.gait
        pose = self.motion.command.position_rad
        quad = (float(pose[0]), float(pose[1]), float(pose[2]), float(pose[3]))
        made = plan(
            PlanRequest(
                number=1, action=action, phase=self.gait.phase, from_state=GaitState.STANDING, start_rad=quad
            ),
            PATIENT,
        )  # fmt: skip
        assert made.check.ok, made.check.reason
        self.drives.stage_scene(action)
        self.motion = follower.start_plan(self.motion, made)

    def run_attempts(self, action: Action) -> None:
        """To its end, in the pose of the state that it leads to; of a walk the first step."""
        self.begin(action)
        while not self.motion.arrived:
            self.tick(hold=False)
        self.motion = follower.hold(self.motion)
        self.rest()
        if self.gait.phase is not Phase.WALK_START:
            self.gait = changed(self.gait, Change.COMPLETED)
            away = np.abs(self.joints.wearer.joints_rad - nominal_pose(self.gait.state, PATIENT))
            assert away.max() < POSE_LIMIT_RAD

    def stop_at(self, action: Action, progress: float) -> None:
        self.begin(action)
        while self.motion.progress < progress:
            self.tick(hold=False)
        while not self.motion.halted:
            self.tick(hold=True)
        self.motion = follower.hold(self.motion)
        self.gait = changed(self.gait, Change.INTERRUPTED)
        self.rest()


@pytest.mark.parametrize(("action", "phase"), INTERRUPTED)
def test_from_the_middle_of_anything_there_is_a_return(action: Action, phase: Phase) -> None:
    nominal = path_of(action, phase, PATIENT).joints_rad
    for progress in PROGRESS:
        pose = nominal[round(progress * (len(nominal) - 1))]
        quad = (float(pose[0]), float(pose[1]), float(pose[2]), float(pose[3]))
        check = plan(
            PlanRequest(number=1, action=A.INITIALISE, phase=Phase.WHOLE, from_state=S.BETWEEN, start_rad=quad), PATIENT
        ).check
        assert check.ok, (progress, check.reason)


@pytest.mark.parametrize(("action", "progress", "after"), CARRIED_OUT)
def test_gesture_0_leads_back_and_the_next_action_works(action: Action, progress: float, after: Action) -> None:
    legs = Legs()
    legs.stop_at(action, progress)
    legs.run_attempts(A.INITIALISE)
    ankles = legs.joints.ground_truth().ankle_m
    assert abs(ankles[0, 1] - ankles[1, 1]) < LEVEL_M
    legs.run_attempts(after)


@pytest.mark.parametrize(
    ("action", "progress"), [(A.STAIR_UP, 0.5), (A.STAIR_DOWN, 0.3), (A.OBSTACLE, 0.7), (A.SIT_DOWN, 0.8)]
)
def test_asking_for_the_return_moves_nothing_under_a_held_wearer(action: Action, progress: float) -> None:
    legs = Legs()
    legs.stop_at(action, progress)
    legs.drives.stage_scene(A.INITIALISE)
    assert legs.rest() < QUIET_RAD_S
