"""A world for the step: joints, planner, guard and streams that speak, each of which a test can spoil."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from app.control.inputs import DriveOrder, Inputs, Outputs, Settings
from app.control.state import ControlState
from app.control.step import initial_state, step
from app.ipc.messages import AuditHealth, GuardianHealth, OperatorCommand, OperatorKind, TriggerReport
from app.ipc.states import Action
from app.motion.follower import gains_of, without_stiffness
from app.motion.plan import Plan, PlanCheck, PlanRequest
from hal.inputs.device import InputReadings
from hal.inputs.reader import READ_S, InputReader
from hal.joints.device import load_exoskeleton
from hal.joints.guard import Guard, Refusal, limits_of
from hal.joints.protocol import (
    TICK_HZ,
    DriveState,
    JointCommand,
    JointFeedback,
)
from kgdfa.gesture import Gesture
from logs.reason import Reason, reason_of
from logs.records import Body
from tests.app.control.ideal_joints import IdealJoints
from tests.app.control.instant_planner import POSES, make_plan

TICK_NS = 1_000_000_000 // TICK_HZ
DEVICE = load_exoskeleton()
SETTINGS = Settings(
    limits=limits_of(DEVICE),
    gains=gains_of(DEVICE, 1.0, 1.0),
    poses=POSES,
    warn_c=np.full(4, 65.0),
    limit_c=np.full(4, 80.0),
    patient="demo",
)


@dataclass(repr=False)  # its history would fill a screen for minutes
class Rig:
    """Runs the step tick by tick; the guard is the real one."""

    settings: Settings = SETTINGS
    now_ns: int = 1_000_000_000
    joints: IdealJoints = field(default_factory=IdealJoints)
    state: ControlState | None = None
    outputs: Outputs | None = None
    guard: Guard = field(default_factory=lambda: Guard(SETTINGS.limits))
    alive: bool = True  # the console sends heartbeats
    watching: bool = True  # perception sends reports
    auditing: bool = True
    guarding: bool = True
    planning: bool = True
    plan_s: float = 0.4
    answer_ticks: int = 1
    refuse_plans: str = ""
    withhold: bool = False  # the next tick's command, as where control is frozen in it
    withheld: bool = False
    refused: frozenset[Action] = frozenset(Action)  # whose plans `refuse_plans` concerns
    unanswered: frozenset[Action] = frozenset()  # whose plans never come
    audit: list[Body] = field(default_factory=list)
    history: list[tuple[ControlState, Outputs]] = field(default_factory=list)
    spoil: dict[str, Any] = field(default_factory=dict)  # fields of the next tick's Inputs
    report: dict[str, Any] = field(default_factory=dict)  # fields of every report
    audit_health: dict[str, Any] = field(default_factory=dict)
    guardian_health: dict[str, Any] = field(default_factory=dict)
    cleared: frozenset[Action] | None = None
    stop_inputs: InputReader | None = None  # attached when the rig is where it is wanted; polled at its own rate
    reading: bool = True  # the stop inputs' thread runs
    _sequence: int = 0
    _reports: int = 0
    _releases: int = 0
    _released: Gesture | None = None
    _released_ns: int = 0
    _pressed_ns: int = 0
    incarnation: int = 1
    lease: int = 1
    _commands: list[OperatorCommand] = field(default_factory=list)
    _asked: list[tuple[int, PlanRequest]] = field(default_factory=list)
    _written: JointCommand | None = None
    _refusal: Refusal | None = None
    _error: Reason | None = None

    def send(self, kind: OperatorKind, action: Action | None = None, age_ms: float = 0.0) -> None:
        """An operator command, received in the next tick."""
        self._sequence += 1
        sent_ns = self.now_ns + TICK_NS - int(age_ms * 1e6)
        command = OperatorCommand(lease=self.lease, sequence=self._sequence, kind=kind, sent_ns=sent_ns, action=action)
        self._commands.append(command)

    def release(self, gesture: Gesture, age_ms: float = 30.0, held_ms: float = 0.0) -> None:
        """A released gesture, reported from the next report on; held_ms: from press to release."""
        self._releases += 1
        self._released, self._released_ns = gesture, self.now_ns + TICK_NS - int(age_ms * 1e6)
        self._pressed_ns = self._released_ns - int(held_ms * 1e6)

    def restart_perception(self) -> None:
        """As the host does it."""
        self.incarnation += 1
        self._releases, self._released, self._reports = 0, None, 0
        self._released_ns = self._pressed_ns = 0

    def tick(self, times: int = 1) -> ControlState:
        """So many ticks."""
        for _ in range(times):
            self._one()
        assert self.state is not None
        return self.state

    def run_until(self, wanted: Callable[[ControlState], bool], limit: int = 2500) -> ControlState:
        """Ticks until `wanted(memory)` holds; fails when it never does."""
        for _ in range(limit):
            if wanted(self.tick()):
                assert self.state is not None
                return self.state
        raise AssertionError(f"not reached in {limit} ticks")

    def settle(self) -> ControlState:
        """Ticks until nothing runs and nothing moves."""
        return self.run_until(lambda m: m.running is None and m.motion.settled)

    def act(self, action: Action) -> ControlState:
        """By the therapist's key, to its end."""
        self.send(OperatorKind.ACT, action)
        self.tick(2)
        return self.settle()

    @property
    def command(self) -> JointCommand:
        """The newest."""
        assert self._written is not None
        return self._written

    def events(self) -> set[str]:
        """Names of the events in force."""
        assert self.state is not None
        return {one.event.value for one in self.state.events if one.in_force}

    def _one(self) -> None:
        self.now_ns += TICK_NS
        reader = self.stop_inputs
        if reader is not None and self.reading and self.now_ns - reader.newest.at_ns >= READ_S * 1e9:
            reader.poll(self.now_ns)
        if self.alive and self.now_ns % 50_000_000 < TICK_NS:
            self.send(OperatorKind.HEARTBEAT)
            self._commands[-1] = replace_sent(self._commands[-1], self.now_ns)
        inputs = self._inputs()
        self.state, self.outputs = step(self.state or initial_state(inputs), inputs, self.settings)
        self.history.append((self.state, self.outputs))
        self.audit.extend(self.outputs.audit)
        self._asked.extend((self.answer_ticks, plan_request) for plan_request in self.outputs.plan_requests)
        self.withheld, self.withhold = self.withhold, False
        if self.withheld:
            self._refusal = None
            self.joints.take(self.command)
        else:
            self._write(self.outputs, inputs.feedback)
        self._execute(self.outputs.drives)

    def _inputs(self) -> Inputs:
        rare = self.now_ns % 50_000_000 < TICK_NS
        plain = Inputs(
            now_ns=self.now_ns,
            wall_ns=self.now_ns + 5_000_000_000,
            boot_ns=self.now_ns + 1_000_000_000,
            feedback=self.joints.feedback(self.now_ns),
            report=self._report() if self.watching and self.now_ns % 34_000_000 < TICK_NS else None,
            commands=tuple(self._commands),
            plans=self._plans(),
            audit=self._audit() if self.auditing and rare else None,
            guardian=self._guardian() if self.guarding and rare else None,
            written=self._written,
            written_ns=self.now_ns - TICK_NS // 2,
            guard_refusal=self._refusal,
            withheld=self.withheld,
            drive_error=self._error,
            stop_inputs=self.stop_inputs.newest if self.stop_inputs else InputReadings(),
            cleared=self.cleared,
        )
        self._commands = []
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
            "released_ns": self._released_ns,
            "released_pressed_ns": self._pressed_ns,
        }
        return TriggerReport(**(fields | self.report))

    def _audit(self) -> AuditHealth:
        fields: dict[str, Any] = {"at_ns": self.now_ns, "written": 1, "waiting": 0}
        return AuditHealth(**(fields | self.audit_health))

    def _guardian(self) -> GuardianHealth:
        fields: dict[str, Any] = {"at_ns": self.now_ns}
        return GuardianHealth(**(fields | self.guardian_health))

    def _plans(self) -> tuple[Plan, ...]:
        due = [plan_request for ticks, plan_request in self._asked if ticks <= 1]
        self._asked = [(ticks - 1, plan_request) for ticks, plan_request in self._asked if ticks > 1]
        due = [plan_request for plan_request in due if plan_request.action not in self.unanswered]
        return tuple(self._answer(plan_request) for plan_request in due) if self.planning else ()

    def _answer(self, plan_request: PlanRequest) -> Plan:
        plan = make_plan(plan_request, self.plan_s)
        if not self.refuse_plans or plan_request.action not in self.refused:
            return plan
        return msgspec.structs.replace(plan, check=PlanCheck(reason=reason_of(OSError(self.refuse_plans))))

    def _write(self, outputs: Outputs, feedback: JointFeedback) -> None:
        powered = self.joints.state in {DriveState.ENABLED, DriveState.FAULTED}
        previous = self._written if powered else None
        if previous is not None:
            previous = without_stiffness(previous, outputs.unheld)
        self._refusal = self.guard.check(outputs.command, previous, feedback.position_rad)
        if self._refusal is None:
            self._written = outputs.command
        assert self._written is not None
        self.joints.take(self._written)

    def _execute(self, order: DriveOrder) -> None:
        self._error = None
        if order is DriveOrder.ENABLE and self.joints.refuse_enable:
            self._error = reason_of(OSError(self.joints.refuse_enable))
        elif order is DriveOrder.ENABLE:
            self.joints.state = DriveState.ENABLED
        elif order is DriveOrder.DISABLE:
            self.joints.state = DriveState.DISABLED


def replace_sent(command: OperatorCommand, sent_ns: int) -> OperatorCommand:
    """The same word, sent then."""
    return msgspec.structs.replace(command, sent_ns=sent_ns)
