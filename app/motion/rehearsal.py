"""An action rehearsed in simulation through the same planner, follower and guard as on the device, and evaluated.

Pure but for MuJoCo's stepping: no clock, no files. Pre-flight, `rleex simulate` and the tests use it alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from msgspec import structs

from app.ipc.states import Action, GaitState
from app.motion import follower
from app.motion.follower import Gains, Mode, Motion, gains_of
from app.motion.kinematics import Array
from app.motion.plan import Patient, Phase, Plan, PlanFault, PlanRequest, quad
from app.motion.rehearsal_checks import (
    RehearsalFault,
    RehearsalVerdict,
    faults_of,
    least_clearance,
    most_slide,
    stride_m,
)
from app.motion.trajectory import nominal_pose, plan, scene_of
from hal.joints.device import Exoskeleton
from hal.joints.guard import Guard, limits_of
from hal.joints.protocol import TICK_HZ, TICK_NS, JointCommand
from hal.joints.scene import Scene
from hal.joints.simulated.driver import SimulatedJoints
from hal.joints.simulated.wearer import GroundTruth
from logs.reason import Reason, reason

TRUTH_TICKS = 5  # between two samples of the ground truth
SETTLE_TICKS = 250  # stand still before and after
STIFFENING_LIMIT_TICKS = 500

A, P, S = Action, Phase, GaitState
STARTS: dict[Action, GaitState] = {
    A.STEP_LEFT: S.RIGHT_FORWARD,
    A.STEP_RIGHT: S.LEFT_FORWARD,
    A.STEP_END: S.RIGHT_FORWARD,
    A.STAND_UP: S.SITTING,
}
WALK_PHASES = (  # two walks, as left and right may have limits of their own: each ends in the other closing step
    (A.WALK, P.WALK_START),
    *[(A.WALK, P.WALK_RIGHT), (A.WALK, P.WALK_LEFT)] * 2,
    (A.WALK_END, P.WALK_CLOSE_RIGHT),
    (A.WALK, P.WALK_START),
    (A.WALK, P.WALK_RIGHT),
    (A.WALK_END, P.WALK_CLOSE_LEFT),
)
SEQUENCES: dict[Action, tuple[tuple[Action, Phase], ...]] = {A.WALK: WALK_PHASES, A.WALK_END: WALK_PHASES}
CROUCH_RAD = np.array([0.35, 0.6, 0.35, 0.6])  # where a wearer is before gesture 0, for the rehearsal


@dataclass(frozen=True, slots=True, kw_only=True)
class Rehearsal:
    """Everything that happened; ticks (n, 4), truths every TRUTH_TICKS of them."""

    verdict: RehearsalVerdict
    target_rad: Array
    angle_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    truths: tuple[GroundTruth, ...]
    scene: Scene
    starts: tuple[int, ...]  # ticks at which a plan began


def rehearse(patient: Patient, device: Exoskeleton, action: Action) -> Rehearsal:
    """Carry out one action (walking: two walks, nine steps) in simulation from its state's pose."""
    running = RehearsalRun(patient, device, action)
    return running.evaluated(running.run())


class RehearsalRun:
    """One rehearsal while it runs: planner, follower, guard and simulated joints."""

    def __init__(self, patient: Patient, device: Exoskeleton, action: Action) -> None:
        self.patient, self.device, self.action = patient, device, action
        gait = patient.gait
        self.gains: Gains = gains_of(device, gait.assist_left, gait.assist_right)
        self.guard = Guard(limits_of(device, patient.hip_max_rad, patient.knee_max_rad))
        self.joints = SimulatedJoints(device, patient.body)
        self.scene = scene_of(action, patient)
        self.state = STARTS.get(action, S.STANDING)
        self.motion = Motion()
        self.previous: JointCommand | None = None
        self.now_ns = TICK_NS
        self.rows: list[tuple[Array, ...]] = []
        self.truths: list[GroundTruth] = []
        self.starts: list[int] = []
        self.moving = np.zeros(0, dtype=bool)
        self.moving_ticks = 0
        self.final_rad: Array | None = None
        self.advance_m = 0.0

    def run(self) -> Reason | None:
        """Why it could not be carried out; None: it was."""
        if refused := self.prepare():
            return refused
        for number, (part, phase) in enumerate(SEQUENCES.get(self.action, ((self.action, P.WHOLE),))):
            made = self.plan_next(number, part, phase)
            if refused := made.check.reason or self.follow(made):
                return refused
        self.motion = follower.hold(self.motion)
        return next(filter(None, (self.tick() for _ in range(SETTLE_TICKS))), None)

    def prepare(self) -> Reason | None:
        """Put the wearer into the action's pose and hold the joints there."""
        pose = self.start_pose()
        if not np.isfinite(pose).all():
            gait, body = self.patient.gait, self.patient.body
            return reason(PlanFault.CHAIR_DOES_NOT_FIT, chair_m=gait.chair_height_m, thigh_m=body.thigh_m)
        self.joints.place(pose)
        self.joints.stage(self.scene)
        self.joints.open(self.now_ns)
        self.joints.enable(self.now_ns)
        return self._stiffen()

    def start_pose(self) -> Array:
        """Where the action starts, (4,) radians; not finite where the chair does not fit."""
        return CROUCH_RAD if self.action is A.INITIALISE else nominal_pose(self.state, self.patient)

    def plan_next(self, number: int, part: Action, phase: Phase) -> Plan:
        """The next movement's plan, from where the joints are."""
        measured = self.joints.read(self.now_ns).position_rad
        request = PlanRequest(number=number, action=part, phase=phase, from_state=self.state, start_rad=quad(measured))
        made = plan(request, self.patient)
        self.state = made.to_state
        return made

    def _stiffen(self) -> Reason | None:
        self.tick()
        self.motion = follower.start_stiffening(self.joints.read(self.now_ns).position_rad, self.gains)
        for _ in range(STIFFENING_LIMIT_TICKS):
            if refused := self.tick():
                return refused
        return None if self.motion.mode is Mode.HOLDING else reason(RehearsalFault.NOT_STIFFENED)

    def follow(self, made: Plan) -> Reason | None:
        """Carry out a plan; why the guard refused a command of it."""
        self.starts.append(len(self.rows))
        self.motion = follower.start_plan(self.motion, made)
        self.final_rad = made.position_rad[-1]
        self.advance_m += made.advance_m
        while not self.motion.arrived:
            if refused := self.tick():
                return refused
            self.moving_ticks += 1
        return None

    def tick(self, *, hold: bool = False, missed: int = 0) -> Reason | None:
        """One tick, with the follower's `hold` and `missed`; why the guard refused its command."""
        self.now_ns += TICK_NS
        feedback = self.joints.read(self.now_ns)
        self.motion = follower.advance(self.motion, self.gains, hold=hold, missed=missed)
        command = self.motion.command
        refusal = self.guard.check(command, self.previous, feedback.position_rad)
        if refusal is not None:
            return reason(
                RehearsalFault.GUARD_REFUSED,
                joint=refusal.joint,
                quantity=refusal.quantity,
                value=refusal.value,
                limit=refusal.limit,
            )
        self._write(command)
        return None

    def miss_tick(self) -> None:
        """A tick without a command: the drives go on under the last one."""
        self.now_ns += TICK_NS
        self.joints.read(self.now_ns)
        assert self.previous is not None
        self._write(self.previous)

    def _write(self, command: JointCommand) -> None:
        self.joints.write(command, self.now_ns)
        self.previous = command
        wearer = self.joints.wearer
        self.rows.append(
            (command.position_rad, wearer.joints_rad.copy(), wearer.speeds_rad_s.copy(), self.joints.torque_nm)
        )
        if len(self.rows) % TRUTH_TICKS == 0:
            self.truths.append(self.joints.ground_truth())

    def evaluated(self, refusal: Reason | None) -> Rehearsal:
        """Figures and verdict."""
        rows = self.rows or [(np.zeros(4),) * 4]
        target, angle, speed, torque = (np.array(column) for column in zip(*rows, strict=True))
        return Rehearsal(
            verdict=self._verdict(refusal, target, angle, speed, torque),
            target_rad=target,
            angle_rad=angle,
            speed_rad_s=speed,
            torque_nm=torque,
            truths=tuple(self.truths),
            scene=self.scene,
            starts=tuple(self.starts),
        )

    def _verdict(
        self, refusal: Reason | None, target: Array, angle: Array, speed: Array, torque: Array
    ) -> RehearsalVerdict:
        if not self.starts:
            assert refusal is not None
            return RehearsalVerdict(action=self.action, passed=False, reasons=(refusal,))
        first, body = self.starts[0], self.patient.body
        truths = self.truths[first // TRUTH_TICKS :] or self.truths[-1:]  # from the first plan on
        span = slice(first, first + self.moving_ticks)
        error = angle[span] - target[span]
        verdict = RehearsalVerdict(
            action=self.action,
            passed=True,
            reasons=(),
            duration_s=self.moving_ticks / TICK_HZ,
            peak_torque_nm=quad(np.abs(torque[first:]).max(axis=0)),
            torque_limit_nm=quad(np.array([joint.max_torque_nm for joint in self.device.joints])),
            peak_speed_deg_s=quad(np.degrees(np.abs(speed[first:]).max(axis=0))),
            speed_limit_deg_s=quad(np.array([joint.max_speed_deg_s for joint in self.device.joints])),
            tracking_rms_deg=quad(np.degrees(np.sqrt((error**2).mean(axis=0)))),
            clearance_m=least_clearance(body, truths, self.scene),
            slide_m=most_slide(body, truths),
            penetration_m=max(truth.deepest_m for truth in truths),
            contact_peak_n=max(float(truth.contact_n.max()) for truth in truths),
            stride_m=stride_m(truths) if self.action in SEQUENCES else self.advance_m,
            energy_j=float(np.clip(torque[span] * speed[span], 0, None).sum() / TICK_HZ),
            temperature_c=float(self.joints.read(self.now_ns).temperature_c.max()),
            balance_peak_nm=max(abs(truth.balance_nm) for truth in truths),
            hold_peak_n=max(abs(truth.hold_n) for truth in truths),
        )
        struck = any(truth.struck for truth in truths)
        reasons = (refusal,) if refusal else tuple(faults_of(verdict, self._end_error_rad(), struck=struck))
        return structs.replace(verdict, passed=not reasons, reasons=reasons)

    def _end_error_rad(self) -> float:
        """How far the farthest joint is from where the last plan ends."""
        return pi if self.final_rad is None else float(np.abs(self.joints.wearer.joints_rad - self.final_rad).max())
