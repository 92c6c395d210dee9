"""Walks of a simulated patient, recorded as a session is, beside what MuJoCo's feet and clock say."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.evaluate.harness import EvaluateFault
from app.ipc.states import Action, GaitState
from app.motion import follower
from app.motion.kinematics import CLOSING, LEVEL, leg_length
from app.motion.path import LEFT, RIGHT, lifted, reaching, sample
from app.motion.plan import Patient, Phase, Plan, PlanCheck
from app.motion.plan_check import joint_torques
from app.motion.rehearsal import RehearsalRun
from app.motion.trajectory import scene_of
from app.motion.walking import LONGEST_KNEE_RAD, SingleStep, step_movement
from app.recording import schemas
from app.recording.schemas import JointState, JointStates, time_of
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from hal.joints.device import JOINT_NAMES, Exoskeleton
from hal.joints.protocol import TICK_HZ, JointCommand
from hal.joints.simulated.wearer import GroundTruth
from logs.reason import Reason

STAND_TICKS = 750  # before and after; longer than what still counts as walking
GAIT_TICKS = 25  # a session's recording tells its gait 20 times a second


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """What a simulated patient does: strides of the continuous walk, or single steps with lengths and times a side."""

    strides: int = 0
    steps: int = 0
    length_m: tuple[float, float] = (0.3, 0.3)  # left, right; of single steps
    time_s: tuple[float, float] = (2.0, 2.0)
    sits: bool = False  # first down, up again


class RecordedWalk(RehearsalRun):
    """A rehearsal that is also written as a recording: what the drives reported, with their noise and quanta."""

    def __init__(self, patient: Patient, device: Exoskeleton, path: Path) -> None:
        super().__init__(patient, device, Action.WALK)
        topics = [topic for topic in schemas.TOPICS if topic.name in {schemas.JOINT_STATE, schemas.GAIT}]
        self._writer = RecordingWriter(path, topics, 0, floor_bytes=0)
        self._doing: Action | None = None
        self._truth: list[GroundTruth] = []

    def perform(self, walk: Walk) -> tuple[GroundTruth, ...]:
        """All of it, from standing to standing; the truth of each tick. Raises AppError where a plan is refused."""
        _raise(self.prepare())
        self._stand()
        if walk.sits:
            self.joints.stage(scene_of(Action.SIT_DOWN, self.patient))
            for action in (Action.SIT_DOWN, Action.STAND_UP):
                self._do(self.plan_next(0, action, Phase.WHOLE))
                self._stand()
        if walk.strides:
            self._walk(walk.strides)
        if walk.steps:
            self._step(walk)
        self._stand()
        self._writer.finish()
        return tuple(self._truth)

    def _write(self, command: JointCommand) -> None:
        if len(self.rows) % GAIT_TICKS == 0:
            self._writer.add(schemas.GAIT, self.now_ns, self._gait())
        feedback = self.joints.read(self.now_ns)
        quantities = (feedback.position_rad.tolist(), feedback.velocity_rad_s.tolist(), feedback.torque_nm.tolist())
        joints = tuple(JointState(*one) for one in zip(JOINT_NAMES, *quantities, strict=True))
        self._writer.add(schemas.JOINT_STATE, self.now_ns, JointStates(time_of(self.now_ns), joints))
        self._writer.settle(self.now_ns)
        super()._write(command)
        self._truth.append(self.joints.ground_truth())

    def _gait(self) -> schemas.Gait:
        return schemas.Gait(
            state=self.state.value,
            action=None if self._doing is None else self._doing.value,
            progress=0.0,
            effect="note",
            armed=True,
            powered=True,
            steps=0,
            distance_walked_m=0.0,
            events=(),
            refusal=None,
            refusal_count=0,
        )

    def _stand(self) -> None:
        self._doing = None
        self.motion = follower.hold(self.motion)
        for _ in range(STAND_TICKS):
            _raise(self.tick())

    def _do(self, made: Plan) -> None:
        self._doing = made.action
        _raise(made.check.reason or self.follow(made))

    def _walk(self, strides: int) -> None:
        phases = [(Action.WALK, Phase.WALK_START)]
        phases += [(Action.WALK, Phase.WALK_RIGHT), (Action.WALK, Phase.WALK_LEFT)] * strides
        phases += [(Action.WALK_END, Phase.WALK_CLOSE_RIGHT)]
        for number, (action, phase) in enumerate(phases):
            self._do(self.plan_next(number, action, phase))

    def _step(self, walk: Walk) -> None:
        """Single steps, right foot first, one directly after the other; the last one closes."""
        before_m = 0.0  # how far the foot that stepped last stands before the other
        for number in range(walk.steps):
            side = RIGHT if number % 2 == 0 else LEFT
            length_m = 0.0 if number == walk.steps - 1 else walk.length_m[side]
            step = SingleStep(
                swing_side=side,
                hip_to_m=(before_m + length_m) / 2,
                stand_at_m=before_m / 2,
                swing_from_m=-before_m / 2,
                swing_to_m=before_m / 2 + length_m,
                shape=LEVEL if length_m else CLOSING,
            )
            self._do(self._single(step, walk.time_s[side]))
            before_m = length_m

    def _single(self, step: SingleStep, time_s: float) -> Plan:
        """A step as the planner makes one, with a length and a time of its own."""
        body = self.patient.body
        movement = reaching(body, step_movement(self.patient, step, time_s), leg_length(body, LONGEST_KNEE_RAD))
        path = sample(body, lifted(body, movement, self.patient.gait.swing_clearance_m))
        return Plan(
            number=0,
            action=Action.STEP_RIGHT if step.swing_side == RIGHT else Action.STEP_LEFT,
            phase=Phase.WHOLE,
            from_state=GaitState.STANDING,
            to_state=GaitState.STANDING,
            position_rad=path.joints_rad,
            velocity_rad_s=np.gradient(path.joints_rad, 1 / TICK_HZ, axis=0, edge_order=2),
            torque_nm=joint_torques(self.patient, path),
            check=PlanCheck(),
            steps=1,
        )


def _raise(why: Reason | None) -> None:
    if why is not None:
        raise AppError(EvaluateFault.WALK_REFUSED, why=why)
