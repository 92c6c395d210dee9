"""The action that is running: its stage, its plans, and what is measured of it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from math import radians, sqrt
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict, replace

from app.control.inputs import ActionRequest
from app.ipc.snapshot import ActionReport
from app.ipc.states import GESTURE_OF, Action, GaitState, Outcome, Source
from app.motion.plan import Phase, Plan, PlanRequest, quad
from hal.joints.protocol import JointArray, JointCommand
from logs import records
from logs.reason import Reason

VISIBLE_RAD = radians(0.5)


class Stage(Enum):
    """Stages of an action, in their order; those that are not needed are skipped."""

    PLANNING = "planning"
    ENABLING = "enabling"
    STIFFENING = "stiffening"
    MOVING = "moving"


class RunningAction(Struct, frozen=True, kw_only=True):
    """An accepted action until its end."""

    report: ActionReport
    stage: Stage = Stage.PLANNING
    requested_ns: int  # when the awaited plan was requested
    awaited_plans: frozenset[int]  # numbers of plan requests without an answer yet
    plan: Plan | None = None
    next_steps: Mapping[Phase, Plan] = {}  # steps of a walk, planned while one runs
    walk_ended_by: Reason | None = None  # what ended a walk without a request
    ending: ActionReport | None = None  # gesture 6's own report while it is latched
    initial_command: JointCommand  # the command when the action was accepted
    start_rad: JointArray  # measured then
    commanded: bool = False  # a command differs from `initial_command`
    squares_rad2: float = 0.0
    samples: int = 0

    def plan_overdue(self, now_ns: int, limit_ms: float) -> bool:
        """Whether the plan that it can't go on without is overdue."""
        waiting = self.stage in {Stage.PLANNING, Stage.STIFFENING} and bool(self.awaited_plans)
        return waiting and now_ns - self.requested_ns > limit_ms * 1e6


def new_report(request: ActionRequest, number: int, state: GaitState, now_ns: int) -> ActionReport:
    """The report of a request that has just been granted."""
    return ActionReport(
        number=number,
        action=request.action,
        source=request.source,
        from_state=state,
        recognised_ns=request.recognised_ns,
        released_ns=request.released_ns,
        accepted_ns=now_ns,
    )


def measure(
    running: RunningAction, command: JointCommand, measured_rad: JointArray, written_ns: int, now_ns: int
) -> RunningAction:
    """Measure the tick before: its command left at `written_ns`, the joints were read at `now_ns`."""
    report = running.report
    if running.commanded and not report.first_command_ns:
        report = replace(report, first_command_ns=written_ns)
    moved = float(np.abs(measured_rad - running.start_rad).max()) >= VISIBLE_RAD
    if moved and report.first_command_ns and not report.first_motion_ns:
        report = replace(report, first_motion_ns=now_ns)
    if running.stage is not Stage.MOVING:
        return running if report is running.report else replace(running, report=report)
    error = measured_rad - command.position_rad
    return replace(
        running,
        report=report,
        squares_rad2=running.squares_rad2 + float(error @ error) / 4,
        samples=running.samples + 1,
    )


def note_command(running: RunningAction, command: JointCommand) -> RunningAction:
    """Note that the joint command has changed since the action was accepted."""
    if running.commanded or command is running.initial_command or _same(command, running.initial_command):
        return running
    return replace(running, commanded=True)


def ended(
    running: RunningAction, outcome: Outcome, to_state: GaitState, now_ns: int, why: Reason | None = None
) -> tuple[ActionReport, ...]:
    """The final reports of an action, and of the gesture 6 that was latched in it."""
    rms = sqrt(running.squares_rad2 / running.samples) if running.samples else 0.0
    return tuple(
        replace(report, outcome=outcome, to_state=to_state, ended_ns=now_ns, reason=why, tracking_rms_rad=rms)
        for report in (running.report, running.ending)
        if report is not None
    )


def command_record(report: ActionReport, **grounds: Any) -> records.Command:
    """An accepted action for the audit trail; grounds: what else the answer took."""
    by_gesture = report.source is Source.GESTURE
    return records.Command(
        number=report.number,
        action=report.action.value,
        source=report.source.value,
        state=report.from_state.value,
        gesture=GESTURE_OF[report.action].value if by_gesture else None,
        recognised_ns=report.recognised_ns,
        released_ns=report.released_ns,
        accepted_ns=report.accepted_ns,
        **grounds,
    )


def plan_record(plan: Plan, command: int) -> records.PlanChecked:
    """A plan's check for the audit trail; command: number of the action that it is for."""
    return records.PlanChecked(
        number=plan.number,
        action=plan.action.value,
        phase=plan.phase.value,
        ok=plan.check.ok,
        reason=plan.check.reason,
        duration_s=plan.duration_s if plan.check.ok else 0.0,
        peak_speed_rad_s=plan.check.peak_speed_rad_s,
        peak_torque_nm=plan.check.peak_torque_nm,
        min_clearance_m=plan.check.min_clearance_m,
        steps=plan.steps,
        advance_m=plan.advance_m,
        command=command,
    )


def end_record(report: ActionReport, steps: int, distance_m: float) -> records.ActionEnd:
    """An ended action for the audit trail: the report's fields, codes by their values."""
    fields = {name: value.value if isinstance(value, Enum) else value for name, value in asdict(report).items()}
    return records.ActionEnd(**fields, steps=steps, distance_m=distance_m)


def plan_request(number: int, action: Action, phase: Phase, state: GaitState, start_rad: JointArray) -> PlanRequest:
    """A request to the planner for one movement."""
    return PlanRequest(number=number, action=action, phase=phase, from_state=state, start_rad=quad(start_rad))


def _same(one: JointCommand, other: JointCommand) -> bool:
    return all(map(np.array_equal, one.fields, other.fields))
