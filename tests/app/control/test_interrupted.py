"""Stopped half way over something: gesture 0 finds the same surroundings, and the legs do not jump."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.config import Config
from app.control import follow
from app.control.assemble import scenes_of
from app.control.drives import Drives
from app.control.follow import Mode, Motion
from app.control.inputs import DriveOrder
from app.control.patient import patient_of
from app.control.plan import TICK_HZ, Phase, PlanRequest
from app.control.settings import gains_of
from app.control.states import Action, GaitState
from app.control.trajectory import nominal_pose, plan
from app.host import make_setup
from app.paths import Home
from hal.joints.device import load_exoskeleton
from hal.joints.guard import limits_of
from hal.joints.simulated import SimulatedJoints
from profiles.schema import DEMO_PATIENT

TICK_NS = 1_000_000_000 // TICK_HZ
DEVICE = load_exoskeleton()
SETTLED_TICKS = 150
QUIET_RAD_S = 0.3  # a held leg sways in the harness


class Legs:
    """Simulated legs behind their guard, moved tick by tick."""

    def __init__(self, home: Path) -> None:
        self.patient = patient_of(DEMO_PATIENT, DEVICE)
        self.joints = SimulatedJoints(DEVICE, self.patient.body)
        self.gains = gains_of(DEVICE, 1.0, 1.0)
        scenes = scenes_of(make_setup(Home(home), Config(), DEMO_PATIENT, "test"))
        self.drives = Drives(self.joints, limits_of(DEVICE), self.gains, scenes)
        self.motion = Motion()
        self.now_ns = TICK_NS

    def stand(self) -> None:
        self.joints.place(nominal_pose(GaitState.STANDING, self.patient))
        self.drives.open(self.now_ns)
        self.drives.obey(DriveOrder.ENABLE, self.now_ns)
        self.motion = follow.grip(self.tick(hold=False), self.gains)
        while self.motion.mode is not Mode.STIFF:
            self.tick(hold=False)

    def tick(self, *, hold: bool) -> np.ndarray:
        self.now_ns += TICK_NS
        feedback = self.drives.read(self.now_ns)
        self.motion = follow.advance(self.motion, self.gains, hold=hold)
        self.drives.write(self.motion.command, feedback, self.now_ns)
        assert self.drives.refusal is None
        return feedback.position_rad.copy()

    def stop_at(self, action: Action, progress: float) -> None:
        pose = self.motion.command.position_rad
        quad = (float(pose[0]), float(pose[1]), float(pose[2]), float(pose[3]))
        request = PlanRequest(number=1, action=action, phase=Phase.WHOLE, from_state=GaitState.STANDING, start_rad=quad)
        self.drives.expect(action)
        self.motion = follow.start(self.motion, plan(request, self.patient))
        while self.motion.progress < progress:
            self.tick(hold=False)
        while not self.motion.halted:
            self.tick(hold=True)


@pytest.mark.parametrize(
    ("action", "progress"), [(Action.STAIR_UP, 0.3), (Action.STAIR_DOWN, 0.3), (Action.OBSTACLE, 0.7)]
)
def test_asking_for_the_way_back_does_not_move_a_held_leg(tmp_path: Path, action: Action, progress: float) -> None:
    legs = Legs(tmp_path)
    legs.stand()
    legs.stop_at(action, progress)
    for _ in range(SETTLED_TICKS):
        legs.tick(hold=True)
    legs.drives.expect(Action.INITIALISE)
    fastest = 0.0
    for _ in range(SETTLED_TICKS):
        legs.tick(hold=True)
        fastest = max(fastest, float(np.abs(legs.joints.wearer.speeds_rad_s).max()))
    assert fastest < QUIET_RAD_S
