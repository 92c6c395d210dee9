"""A world for the step: ideal joints, an instant planner and streams that speak, each of which a test can spoil."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import msgspec
import numpy as np

from app.control.gait_machine import TABLE
from app.control.inputs import DriveOrder, Inputs, Outputs
from app.control.memory import Memory
from app.control.plan import TICK_HZ, Phase, Plan, PlanCheck, PlanRequest
from app.control.settings import Settings, gains_of
from app.control.states import ACTION_OF, Action, GaitState
from app.control.step import begin, step
from app.messages import AuditHealth, GuardianHealth, OperatorCommand, OperatorKind, TriggerReport
from hal.joints.device import load_exoskeleton
from hal.joints.guard import Guard, Refusal, limits_of
from hal.joints.joints import (
    BusFault,
    DriveFault,
    DriveState,
    JointArray,
    JointCommand,
    JointFeedback,
)
from kgdfa.hand import Gesture
from logs.records import Body

TICK_NS = 1_000_000_000 // TICK_HZ
DEVICE = load_exoskeleton()
POSES = {
    GaitState.STANDING: np.zeros(4),
    GaitState.SITTING: np.array([1.4, 1.5, 1.4, 1.5]),
    GaitState.RIGHT_FORWARD: np.array([-0.15, 0.1, 0.3, 0.2]),
    GaitState.LEFT_FORWARD: np.array([0.3, 0.2, -0.15, 0.1]),
}
SETTINGS = Settings(
    limits=limits_of(DEVICE),
    gains=gains_of(DEVICE, 1.0, 1.0),
    poses=POSES,
    warn_c=np.full(4, 65.0),
    limit_c=np.full(4, 80.0),
    patient="demo",
)
CHECK = PlanCheck(ok=True, reason="", peak_speed_rad_s=(1.0,) * 4, peak_torque_nm=(30.0,) * 4, min_clearance_m=0.05)
FASTEST_RAD_S = 2.5
GESTURE = {action: gesture for gesture, action in ACTION_OF.items()}


def lands_in(action: Action, phase: Phase, state: GaitState) -> GaitState:
    """Where the table says that a movement leads."""
    return next(
        row.to
        for row in TABLE
        if row.action is action and row.phase is phase and (row.source is state or row.chained or row.through)
    )


def make_plan(request: PlanRequest, duration_s: float = 0.4) -> Plan:
    """A smooth way from the pose asked for to the pose of the state it leads to."""
    to_state = lands_in(request.action, request.phase, request.from_state)
    start_rad, end_rad = np.array(request.start_rad), POSES[to_state]
    duration_s = max(duration_s, 1.875 * float(np.abs(end_rad - start_rad).max()) / FASTEST_RAD_S)
    s = np.linspace(0.0, 1.0, int(duration_s * TICK_HZ) + 1)[:, None]
    shape, rate = s**3 * (10 - 15 * s + 6 * s * s), 30 * s * s * (1 - s) ** 2 / duration_s
    bump = np.array([0.1, 0.2, 0.1, 0.2]) * np.sin(np.pi * s) ** 2
    bump_rate = np.array([0.1, 0.2, 0.1, 0.2]) * np.pi / duration_s * np.sin(2 * np.pi * s)
    return Plan(
        number=request.number,
        action=request.action,
        phase=request.phase,
        from_state=request.from_state,
        to_state=to_state,
        position_rad=start_rad + shape * (end_rad - start_rad) + bump,
        velocity_rad_s=rate * (end_rad - start_rad) + bump_rate,
        torque_nm=np.tile([5.0, -5.0, 5.0, -5.0], (len(s), 1)),
        check=CHECK,
        steps=1,
        advance_m=0.3,
    )


@dataclass
class IdealJoints:
    """Joints that are where a stiff command puts them one tick later; each thing that can go wrong is a field."""

    position_rad: JointArray = field(default_factory=lambda: np.array([0.05, 0.1, 0.05, 0.1]))
    state: DriveState = DriveState.PROBED
    faults: tuple[DriveFault, DriveFault, DriveFault, DriveFault] = (DriveFault.NONE,) * 4
    bus: BusFault = BusFault.NONE
    detail: str = ""
    temperature_c: JointArray = field(default_factory=lambda: np.full(4, 30.0))
    velocity_rad_s: JointArray = field(default_factory=lambda: np.zeros(4))
    torque_nm: JointArray = field(default_factory=lambda: np.zeros(4))
    stuck: bool = False
    silent: bool = False
    refuse_enable: str = ""
    measured_ns: int = 1

    def take(self, command: JointCommand) -> None:
        """The command's effect until the next tick."""
        stiff = command.stiffness_nm_rad > 0
        if self.state is DriveState.ENABLED and not self.stuck:
            self.position_rad = np.where(stiff, command.position_rad, self.position_rad)

    def feedback(self, now_ns: int) -> JointFeedback:
        """What they report now."""
        if not self.silent:
            self.measured_ns = now_ns
        return JointFeedback(
            measured_ns=np.full(4, self.measured_ns),
            position_rad=self.position_rad.copy(),
            velocity_rad_s=self.velocity_rad_s.copy(),
            torque_nm=self.torque_nm.copy(),
            temperature_c=self.temperature_c.copy(),
            faults=self.faults,
            state=self.state,
            bus=self.bus,
            detail=self.detail,
        )


@dataclass
class Rig:
    """Runs the step tick by tick; the guard is the real one."""

    settings: Settings = SETTINGS
    now_ns: int = 1_000_000_000
    joints: IdealJoints = field(default_factory=IdealJoints)
    memory: Memory | None = None
    outputs: Outputs | None = None
    guard: Guard = field(default_factory=lambda: Guard(SETTINGS.limits))
    alive: bool = True  # the console speaks
    watching: bool = True  # perception speaks
    auditing: bool = True
    guarding: bool = True
    planning: bool = True
    plan_s: float = 0.4
    answer_ticks: int = 1
    refuse_plans: str = ""
    audit: list[Body] = field(default_factory=list)
    history: list[tuple[Memory, Outputs]] = field(default_factory=list)
    spoil: dict[str, Any] = field(default_factory=dict)  # fields of the next tick's Inputs
    report: dict[str, Any] = field(default_factory=dict)  # fields of every report
    audit_health: dict[str, Any] = field(default_factory=dict)
    guardian_health: dict[str, Any] = field(default_factory=dict)
    cleared: frozenset[Action] | None = None
    _sequence: int = 0
    _reports: int = 0
    _releases: int = 0
    _released: Gesture | None = None
    _released_ns: int = 0
    incarnation: int = 1
    _words: list[OperatorCommand] = field(default_factory=list)
    _asked: list[tuple[int, PlanRequest]] = field(default_factory=list)
    _written: JointCommand | None = None
    _refusal: Refusal | None = None
    _error: str = ""

    def say(self, kind: OperatorKind, action: Action | None = None, age_ms: float = 0.0) -> None:
        """The operator's word, heard in the next tick."""
        self._sequence += 1
        sent_ns = self.now_ns + TICK_NS - int(age_ms * 1e6)
        self._words.append(OperatorCommand(sequence=self._sequence, kind=kind, sent_ns=sent_ns, action=action))

    def release(self, gesture: Gesture, age_ms: float = 30.0) -> None:
        """The wearer's release, told from the next report on."""
        self._releases += 1
        self._released, self._released_ns = gesture, self.now_ns + TICK_NS - int(age_ms * 1e6)

    def restart_perception(self) -> None:
        """As the host does it."""
        self.incarnation += 1
        self._releases, self._released, self._released_ns, self._reports = 0, None, 0, 0

    def tick(self, times: int = 1) -> Memory:
        """So many ticks."""
        for _ in range(times):
            self._one()
        assert self.memory is not None
        return self.memory

    def run_until(self, wanted: Callable[[Memory], bool], limit: int = 2500) -> Memory:
        """Ticks until `wanted(memory)` holds; fails when it never does."""
        for _ in range(limit):
            if wanted(self.tick()):
                assert self.memory is not None
                return self.memory
        raise AssertionError(f"not reached in {limit} ticks")

    def settle(self) -> Memory:
        """Ticks until nothing runs and nothing moves."""
        return self.run_until(lambda m: m.task is None and m.motion.resting)

    def stand(self) -> Rig:
        """Patient confirmed, armed, initialised: standing."""
        self.tick(2)
        self.say(OperatorKind.CONFIRM_PATIENT)
        self.say(OperatorKind.ARM)
        self.act(Action.INITIALISE)
        assert self.memory is not None
        assert self.memory.gait.state is GaitState.STANDING, self.memory
        return self

    def act(self, action: Action) -> Memory:
        """By the therapist's key, to its end."""
        self.say(OperatorKind.ACT, action)
        self.tick(2)
        return self.settle()

    def reach(self, state: GaitState) -> Rig:
        """Bring a fresh rig to a resting state, by the table's ways."""
        if state is GaitState.UNPOWERED:
            self.tick(2)
            self.say(OperatorKind.CONFIRM_PATIENT)
            self.say(OperatorKind.ARM)
            self.tick(60)
            return self
        self.stand()
        for action in _WAYS[state]:
            self.act(action)
        if state is GaitState.BETWEEN:
            self.say(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
            self.tick(100)
            self.say(OperatorKind.STOP)
            self.settle()
            self.tick()
            self.say(OperatorKind.ACKNOWLEDGE)
            self.tick()
        assert self.memory is not None
        assert self.memory.gait.state is state
        self.tick(60)
        return self

    @property
    def command(self) -> JointCommand:
        """The newest."""
        assert self._written is not None
        return self._written

    def events(self) -> set[str]:
        """Names of the events in force."""
        assert self.memory is not None
        return {one.event.value for one in self.memory.active if one.in_force}

    def _one(self) -> None:
        self.now_ns += TICK_NS
        if self.alive and self.now_ns % 50_000_000 < TICK_NS:
            self.say(OperatorKind.ALIVE)
            self._words[-1] = replace_sent(self._words[-1], self.now_ns)
        inputs = self._inputs()
        self.memory, self.outputs = step(self.memory or begin(inputs), inputs, self.settings)
        self.history.append((self.memory, self.outputs))
        self.audit.extend(self.outputs.audit)
        self._asked.extend((self.answer_ticks, request) for request in self.outputs.requests)
        self._write(self.outputs.command, inputs.feedback)
        self._obey(self.outputs.drives)

    def _inputs(self) -> Inputs:
        rare = self.now_ns % 50_000_000 < TICK_NS
        plain = Inputs(
            now_ns=self.now_ns,
            wall_ns=self.now_ns + 5_000_000_000,
            boot_ns=self.now_ns + 1_000_000_000,
            feedback=self.joints.feedback(self.now_ns),
            report=self._report() if self.watching and self.now_ns % 34_000_000 < TICK_NS else None,
            commands=tuple(self._words),
            plans=self._plans(),
            audit=self._audit() if self.auditing and rare else None,
            guardian=self._guardian() if self.guarding and rare else None,
            written=self._written,
            written_ns=self.now_ns - TICK_NS // 2,
            guard_refusal=self._refusal,
            drive_error=self._error,
            cleared=self.cleared,
        )
        self._words = []
        spoiled = msgspec.structs.replace(plain, **self.spoil)
        self.spoil = {}
        return spoiled

    def _report(self) -> TriggerReport:
        self._reports += 1
        fields: dict[str, Any] = {
            "incarnation": self.incarnation,
            "sequence": self._reports,
            "captured_ns": self.now_ns - 30_000_000,
            "sent_ns": self.now_ns,
            "hand": True,
            "gesture": None,
            "release_count": self._releases,
            "released_gesture": self._released,
            "released_captured_ns": self._released_ns,
        }
        return TriggerReport(**(fields | self.report))

    def _audit(self) -> AuditHealth:
        fields: dict[str, Any] = {"at_ns": self.now_ns, "written": 1, "waiting": 0}
        return AuditHealth(**(fields | self.audit_health))

    def _guardian(self) -> GuardianHealth:
        fields: dict[str, Any] = {"at_ns": self.now_ns}
        return GuardianHealth(**(fields | self.guardian_health))

    def _plans(self) -> tuple[Plan, ...]:
        due = [request for ticks, request in self._asked if ticks <= 1]
        self._asked = [(ticks - 1, request) for ticks, request in self._asked if ticks > 1]
        return tuple(self._answer(request) for request in due) if self.planning else ()

    def _answer(self, request: PlanRequest) -> Plan:
        plan = make_plan(request, self.plan_s)
        if not self.refuse_plans:
            return plan
        return replace(plan, check=replace(CHECK, ok=False, reason=self.refuse_plans))

    def _write(self, command: JointCommand, feedback: JointFeedback) -> None:
        powered = self.joints.state in {DriveState.ENABLED, DriveState.FAULTED}
        self._refusal = self.guard.check(command, self._written if powered else None, feedback.position_rad)
        if self._refusal is None:
            self._written = command
        assert self._written is not None
        self.joints.take(self._written)

    def _obey(self, order: DriveOrder) -> None:
        self._error = ""
        if order is DriveOrder.ENABLE and self.joints.refuse_enable:
            self._error = self.joints.refuse_enable
        elif order is DriveOrder.ENABLE:
            self.joints.state = DriveState.ENABLED
        elif order is DriveOrder.DISABLE:
            self.joints.state = DriveState.DISABLED


def replace_sent(command: OperatorCommand, sent_ns: int) -> OperatorCommand:
    """The same word, sent then."""
    return OperatorCommand(sequence=command.sequence, kind=command.kind, sent_ns=sent_ns, action=command.action)


_WAYS: dict[GaitState, tuple[Action, ...]] = {
    GaitState.STANDING: (),
    GaitState.SITTING: (Action.SIT_DOWN,),
    GaitState.RIGHT_FORWARD: (Action.STEP_RIGHT_FIRST,),
    GaitState.LEFT_FORWARD: (Action.STEP_RIGHT_FIRST, Action.STEP_LEFT),
    GaitState.BETWEEN: (),
}


@cache
def _reached(state: GaitState) -> Rig:
    rig = Rig().reach(state)
    rig.tick(240)  # past the time in which the joints settle
    rig.history.clear()
    rig.audit.clear()
    return rig


def resting(state: GaitState) -> Rig:
    """A rig that rests in a state, settled; each call gives one of its own."""
    return deepcopy(_reached(state))


def standing() -> Rig:
    """A rig that stands: patient confirmed, gestures armed."""
    return resting(GaitState.STANDING)
