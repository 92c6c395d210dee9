"""Carrying out a granted action: its plans, the drives it needs, its movement, its end."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from app.control.events.table import blocker
from app.control.gait import machine as gait_machine
from app.control.gait.machine import Gait
from app.control.inputs import DriveOrder
from app.control.requests import refuse
from app.control.running_action import (
    ActionRequest,
    RunningAction,
    Stage,
    end_record,
    ended,
    plan_record,
    request,
)
from app.control.state import Tick
from app.ipc.states import Action, GaitState, Outcome, RequestRefusal
from app.ipc.streams import PLAN_REPLY
from app.motion import follower
from app.motion.follower import HOLD_S, Mode
from app.motion.plan import Phase, Plan
from hal.joints.protocol import TICK_HZ
from logs.reason import Reason, reason

ENABLE_LIMIT_MS = 3_000  # four drives, one after the other, with their confirmations
# A hold covers half of its time on the path at full pace; with fewer rows left the step could not be stopped on it.
LAST_CALL_ROWS = HOLD_S * TICK_HZ / 2 + 5


def planner_timed_out(tick: Tick) -> bool:
    """Whether the first plan of an action is overdue."""
    task = tick.memory.task
    return task is not None and task.waits_too_long(tick.now_ns, PLAN_REPLY.stale_ms)


def walk_plan_missing(tick: Tick) -> bool:
    """Whether a walk runs out of path with no step after it."""
    memory = tick.memory
    if memory.task is None or not memory.gait.walking or memory.motion.mode is not Mode.MOVING:
        return False
    return memory.motion.rows_left <= LAST_CALL_ROWS and _following(memory.gait) not in memory.task.ahead


def probe_planner(tick: Tick) -> None:
    """Ask for a plan that nobody will run: its answer shows that the planner is ready."""
    if tick.memory.plan_number == 0:
        tick.requests.append(request(1, Action.INITIALISE, Phase.WHOLE, GaitState.UNPOWERED, np.zeros(4)))
        tick.memory = replace(tick.memory, plan_number=1)


def accept_plans(tick: Tick) -> None:
    """Give the planner's answers to the action that waits for them; answers to older questions are dropped."""
    if tick.inputs.plans and not tick.memory.planner_ready:
        tick.memory = replace(tick.memory, planner_ready=True)
    for plan in tick.inputs.plans:
        task = tick.memory.task
        if task is None or plan.number not in task.awaited:
            continue
        tick.audit.append(plan_record(plan))
        task = replace(task, awaited=task.awaited - {plan.number})
        tick.memory = replace(tick.memory, task=task)
        if task.stage in {Stage.PLANNING, Stage.GRIPPING}:
            _first_plan(tick, task, plan)
        else:
            _step_ahead(tick, task, plan)


def advance_action(tick: Tick) -> None:
    """Bring the running action to its next stage when the one it is in has been reached."""
    task = tick.memory.task
    if task is None:
        return
    if planner_timed_out(tick):
        _give_up(tick, task, Outcome.REFUSED, reason(RequestRefusal.PLANNER_TIMEOUT))
    elif task.stage is Stage.ENABLING:
        _enabling(tick, task)
    elif task.stage is Stage.GRIPPING and tick.memory.motion.mode is Mode.HOLDING and not task.awaited:
        _move(tick, task)
    elif task.stage is Stage.MOVING and tick.memory.motion.arrived:
        _arrived(tick, task)


def stop_action(tick: Tick, why: Reason | None) -> None:
    """End the running action where it is, if one runs; the gait is set by whoever stops it."""
    task = tick.memory.task
    if task is not None:
        _end(tick, task, Outcome.STOPPED, why)


def _following(gait: Gait) -> Phase:
    """The step that comes after the running one, as things stand."""
    onward, close = gait_machine.following_phases(gait)
    return close if gait.closing else onward


def _first_plan(tick: Tick, task: RunningAction, plan: Plan) -> None:
    if plan.check.reason is not None:
        _refuse(tick, task, plan.check.reason)
        return
    task = replace(task, plan=plan)
    tick.memory = replace(tick.memory, task=task)
    if task.stage is Stage.PLANNING:
        _set_out(tick, task)


def _set_out(tick: Tick, task: RunningAction) -> None:
    """There is a plan: power, then stiffness, then movement, as far as they are not there yet."""
    if not tick.memory.heard.powered:
        _power(tick, task)
    elif tick.memory.motion.mode in {Mode.DAMPED, Mode.DISABLED}:
        _grip(tick, task)
    else:
        _move(tick, task)


def _power(tick: Tick, task: RunningAction) -> None:
    """Unless something forbids it by now: legs that rested when it was asked for may have begun to sink."""
    event = blocker(tick.memory.active, task.report.source)
    if event is not None:
        _refuse(tick, task, event.reason)
        return
    tick.drives = DriveOrder.ENABLE
    tick.memory = replace(tick.memory, task=replace(task, stage=Stage.ENABLING, asked_ns=tick.now_ns))


def _refuse(tick: Tick, task: RunningAction, why: Reason) -> None:
    """What was granted can't be done after all."""
    refuse(tick, ActionRequest(action=task.report.action, source=task.report.source), why, task.report.number)
    _give_up(tick, task, Outcome.REFUSED, why)


def _step_ahead(tick: Tick, task: RunningAction, plan: Plan) -> None:
    """A step of a walk that may follow: one that can't be done ends the walk before it."""
    if plan.check.ok:
        tick.memory = replace(tick.memory, task=replace(task, ahead={**task.ahead, plan.phase: plan}))
    elif plan.action is Action.WALK:
        tick.memory = replace(tick.memory, gait=gait_machine.close_walk(tick.memory.gait))


def _enabling(tick: Tick, task: RunningAction) -> None:
    overdue = tick.now_ns - task.asked_ns > ENABLE_LIMIT_MS * 1e6
    if tick.memory.heard.powered:
        _grip(tick, task)
    elif tick.inputs.drive_error or overdue:
        _give_up(tick, task, Outcome.STOPPED, tick.inputs.drive_error or reason(RequestRefusal.ENABLE_TIMEOUT))


def _give_up(tick: Tick, task: RunningAction, outcome: Outcome, why: Reason) -> None:
    """Before the first row of the plan: joints that had to be gripped stay held where they were found."""
    gripped = task.stage is Stage.GRIPPING
    tick.reach((gait_machine.interrupt if gripped else gait_machine.abandon)(tick.memory.gait))
    _end(tick, task, outcome, why)


def _grip(tick: Tick, task: RunningAction) -> None:
    """Hold slack joints where they are now, and plan anew from there: they may have sunk since the first plan."""
    measured_rad, gait = tick.inputs.feedback.position_rad, tick.memory.gait
    number = tick.memory.plan_number + 1
    tick.requests.append(request(number, task.report.action, gait.phase, gait.state, measured_rad))
    tick.memory = replace(
        tick.memory,
        motion=follower.start_stiffening(measured_rad, tick.settings.gains),
        plan_number=number,
        task=replace(task, stage=Stage.GRIPPING, asked_ns=tick.now_ns, awaited=frozenset({number})),
    )


def _move(tick: Tick, task: RunningAction) -> None:
    assert task.plan is not None
    tick.memory = replace(
        tick.memory,
        motion=follower.start_plan(tick.memory.motion, task.plan),
        task=replace(task, stage=Stage.MOVING),
    )
    _ask_ahead(tick)


def _arrived(tick: Tick, task: RunningAction) -> None:
    assert task.plan is not None
    memory = tick.memory
    tick.memory = replace(
        memory,
        steps=memory.steps + task.plan.steps,
        distance_walked_m=memory.distance_walked_m + task.plan.advance_m,
    )
    tick.reach(gait_machine.complete(memory.gait))
    if tick.memory.gait.running is None:
        tick.memory = replace(tick.memory, motion=follower.hold(tick.memory.motion))
        _end(tick, task, Outcome.COMPLETED, None)
        return
    onward = task.ahead[tick.memory.gait.phase]  # `walk_plan_missing` has held the legs before it could be missing
    tick.memory = replace(
        tick.memory, task=replace(task, plan=onward, ahead={}), motion=follower.start_plan(tick.memory.motion, onward)
    )
    _ask_ahead(tick)


def _ask_ahead(tick: Tick) -> None:
    """In a walk ask for both steps that may follow, from where the running one will end."""
    memory = tick.memory
    phases = gait_machine.following_phases(memory.gait)
    task = memory.task
    assert task is not None
    assert task.plan is not None
    last_rad, lands = task.plan.position_rad[-1], task.plan.to_state
    numbers = range(memory.plan_number + 1, memory.plan_number + 1 + len(phases))
    for number, phase in zip(numbers, phases, strict=True):
        action = gait_machine.action_of(phase)
        tick.requests.append(request(number, action, phase, lands, np.asarray(last_rad)))
    tick.memory = replace(
        memory,
        plan_number=memory.plan_number + len(phases),
        task=replace(task, awaited=task.awaited | frozenset(numbers)),
    )


def _end(tick: Tick, task: RunningAction, outcome: Outcome, why: Reason | None) -> None:
    memory = tick.memory
    reports = ended(task, outcome, memory.gait.state, tick.now_ns, why)
    tick.audit.extend(end_record(report, memory.steps, memory.distance_walked_m) for report in reports)
    tick.memory = replace(memory, task=None)
    tick.keep(*reports)
