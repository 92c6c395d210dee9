"""Simulated legs are at rest when a session begins: a stand that is requested at once is carried out at once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from app.control.drives import Drives
from app.control.events.drives import STILL_RAD_S
from app.control.inputs import DriveOrder
from app.control.running_action import Stage
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, GaitState, Outcome
from app.motion.follower import NEUTRAL
from app.motion.plan import Plan, PlanRequest, body_of
from app.motion.trajectory import plan
from hal.joints.body import average_body
from hal.joints.device import load_exoskeleton
from hal.joints.factory import make_joints
from hal.joints.protocol import DriveState, JointCommand, JointFeedback
from profiles.schema import DEMO_PATIENT
from tests.app.control.ideal_joints import IdealJoints
from tests.app.control.moments import now
from tests.app.control.rig import DEVICE, SETTINGS, TICK_NS, Rig
from tests.app.control.test_interrupted import PATIENT

READY_TICKS = 750  # until somebody has pressed the keys: legs that were not at rest would be sinking now
AT_ONCE_TICKS = 300  # the joints take 150 to stiffen
LATER_TICKS = 5000


@dataclass(repr=False)
class SimulatedLegs(IdealJoints):
    """The joints of a session as its control makes them."""

    drives: Drives = field(
        default_factory=lambda: Drives(
            make_joints("simulated", DEVICE, body_of(DEMO_PATIENT)), SETTINGS.limits, SETTINGS.gains
        )
    )

    def __post_init__(self) -> None:
        self.drives.open(0)

    def take(self, command: JointCommand) -> None:
        self.drives.write(command, self.drives.read(self.measured_ns), self.measured_ns)

    def feedback(self, now_ns: int) -> JointFeedback:
        self.measured_ns = now_ns
        if self.state is DriveState.ENABLED and not self.drives.powered:
            self.drives.execute(DriveOrder.ENABLE, now_ns)
        return self.drives.read(now_ns)


class Session(Rig):
    """A rig whose planner is the real one."""

    def _answer(self, plan_request: PlanRequest) -> Plan:
        return plan(plan_request, PATIENT)


def test_a_stand_requested_right_after_arming_is_carried_out() -> None:
    session = Session(joints=SimulatedLegs())
    session.tick(READY_TICKS)
    for kind in (OperatorKind.CONFIRM_PATIENT, OperatorKind.ARM):
        session.send(kind)
    session.send(OperatorKind.ACT, Action.INITIALISE)
    session.run_until(lambda state: state.running is not None and state.running.stage is Stage.MOVING, AT_ONCE_TICKS)
    assert now(session).refusal_count == 0
    session.settle()
    assert (now(session).gait.state, now(session).reports[-1].outcome) == (GaitState.STANDING, Outcome.COMPLETED)


@pytest.mark.parametrize(
    ("stature_m", "mass_kg", "support"),
    [(1.7, 65.0, 0.5), (1.5, 45.0, 0.5), (1.95, 110.0, 0.3)],
)
def test_every_body_stays_at_rest_without_power(stature_m: float, mass_kg: float, support: float) -> None:
    joints = make_joints("simulated", load_exoskeleton(), average_body(stature_m, mass_kg, support))
    joints.open(0)
    for tick in range(LATER_TICKS):
        joints.write(NEUTRAL, tick * TICK_NS)
        if tick % 10 == 0:
            assert np.abs(joints.read(tick * TICK_NS).velocity_rad_s).max() < STILL_RAD_S
