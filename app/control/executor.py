"""Action executor: a granted action's plans, the drives it needs, its movement, its end."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from app.control.events.table import RaisedEvent, blocker
from app.control.gait import machine as gait_machine
from app.control.gait.machine import Change, Gait
from app.control.inputs import ActionRequest, DriveOrder
from app.control.requests import ACT_STALE_MS, refuse
from app.control.running_action import RunningAction, Stage, end_record, ended, plan_record, plan_request
from app.control.state import ControlState, Tick
from app.ipc.states import Action, Effect, GaitState, Outcome, RequestRefusal
from app.ipc.streams import NS_PER_MS, PLAN_REPLY
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
    running = tick.state.running
    return running is not None and running.plan_overdue(tick.now_ns, PLAN_REPLY.stale_ms)


def next_step_missing(tick: Tick) -> bool:
    """Whether a walk runs out of path with no step after it."""
    state = tick.state
    if state.running is None or not state.gait.walking or state.motion.mode is not Mode.MOVING:
        return False
    return state.motion.rows_left <= LAST_CALL_ROWS and _next_phase(state.gait) not in state.running.next_steps


def step_onward(state: ControlState) -> Plan | None:
    """The planned step that goes on from the end of a walk's running one: the commanded one, or else the other."""
    if state.running is None or not state.gait.walking:
        return None
    steps = state.running.next_steps
    return steps.get(_next_phase(state.gait)) or next(iter(steps.values()), None)


def probe_planner(tick: Tick) -> None:
    """Request a plan that is never run: its answer shows that the planner is ready."""
    if tick.state.plan_number == 0:
        tick.plan_requests.append(plan_request(1, Action.INITIALISE, Phase.WHOLE, GaitState.UNPOWERED, np.zeros(4)))
        tick.update(plan_number=1)


def accept_plans(tick: Tick) -> None:
    """Give new plans to the action that waits for them; plans of older requests are dropped."""
    if tick.inputs.plans and not tick.state.planner_ready:
        tick.update(planner_ready=True)
    for plan in tick.inputs.plans:
        running = tick.state.running
        if running is None or plan.number not in running.awaited_plans:
            continue
        tick.audit.append(plan_record(plan, running.report.number))
        running = replace(running, awaited_plans=running.awaited_plans - {plan.number})
        tick.update(running=running)
        if running.stage in {Stage.PLANNING, Stage.STIFFENING}:
            _accept_first_plan(tick, running, plan)
        else:
            _accept_next_step(tick, running, plan)


def advance_action(tick: Tick) -> None:
    """Bring the running action to its next stage when its present one is completed; a pause begins none."""
    running = tick.state.running
    if running is None:
        return
    if planner_timed_out(tick):
        _cancel(tick, running, Outcome.REFUSED, reason(RequestRefusal.PLANNER_TIMEOUT))
    elif tick.state.effect is Effect.PAUSE and running.stage is not Stage.MOVING:
        _wait(tick, running)
    elif running.stage is Stage.PLANNING and running.plan is not None:
        _leave_planning(tick, running)
    elif running.stage is Stage.ENABLING:
        _await_power(tick, running)
    elif running.stage is Stage.STIFFENING and tick.state.motion.mode is Mode.HOLDING and not running.awaited_plans:
        if not _forbidden(tick, running):
            _move(tick, running)
    elif running.stage is Stage.MOVING and tick.state.motion.arrived:
        _complete_movement(tick, running)


def stop_action(tick: Tick, why: Reason | None = None) -> None:
    """End the running action, if one runs; why: by default the strongest event in force. The caller sets the gait."""
    running = tick.state.running
    if running is not None:
        strongest = next((one.reason for one in tick.state.events if one.in_force), None)
        _end(tick, running, Outcome.STOPPED, why or strongest)


def _next_phase(gait: Gait) -> Phase:
    """The walk's step after the running one; after gesture 6 the closing one."""
    onward, close = gait_machine.following_phases(gait)
    return close if gait.closing else onward


def _accept_first_plan(tick: Tick, running: RunningAction, plan: Plan) -> None:
    if plan.check.reason is not None:
        _refuse(tick, running, plan.check.reason)
        return
    tick.update(running=replace(running, plan=plan))


def _wait(tick: Tick, running: RunningAction) -> None:
    """An action that was granted and has not moved anything begins soon after its request, or not at all."""
    if running.stage is Stage.ENABLING and tick.inputs.drive_error is not None:
        _cancel(tick, running, Outcome.STOPPED, tick.inputs.drive_error)
        return
    waited_ns = tick.now_ns - running.report.accepted_ns
    event = blocker(tick.state.events, running.report.source)
    if running.stage is Stage.PLANNING and waited_ns > ACT_STALE_MS * NS_PER_MS and event is not None:
        _refuse(tick, running, event.reason, event)


def _leave_planning(tick: Tick, running: RunningAction) -> None:
    """With the first plan: power, then stiffness, then movement, as far as they are missing."""
    if _forbidden(tick, running):
        return
    powered = tick.state.streams.powered
    if powered and tick.state.motion.mode not in {Mode.DAMPED, Mode.DISABLED}:
        _move(tick, running)
    elif powered:
        _stiffen(tick, running)
    else:
        tick.drives = DriveOrder.ENABLE
        tick.update(running=replace(running, stage=Stage.ENABLING, requested_ns=tick.now_ns))


def _forbidden(tick: Tick, running: RunningAction) -> bool:
    """Refuse an action that has moved nothing yet, if an event forbids it by now; whether it did.

    Legs that rested at the request may have begun to sink, a supervising process may have failed since.
    """
    event = blocker(tick.state.events, running.report.source)
    if event is not None:
        _refuse(tick, running, event.reason, event)
    return event is not None


def _refuse(tick: Tick, running: RunningAction, why: Reason, event: RaisedEvent | None = None) -> None:
    """Refuse an action that was already granted."""
    report = running.report
    request = ActionRequest(
        action=report.action, source=report.source, recognised_ns=report.recognised_ns, released_ns=report.released_ns
    )
    refuse(tick, request, why, report.number, event=event)
    _cancel(tick, running, Outcome.REFUSED, why)


def _accept_next_step(tick: Tick, running: RunningAction, plan: Plan) -> None:
    """Keep the plan of a step that may follow; a step that can't be planned ends the walk before it.

    So does a closing step: a walk that could not be ended goes no farther.
    """
    if plan.check.ok:
        tick.update(running=replace(running, next_steps={**running.next_steps, plan.phase: plan}))
    else:
        tick.change_gait(Change.WALK_CLOSED)


def _await_power(tick: Tick, running: RunningAction) -> None:
    overdue = tick.now_ns - running.requested_ns > ENABLE_LIMIT_MS * 1e6
    if tick.state.streams.powered:
        if not _forbidden(tick, running):
            _stiffen(tick, running)
    elif tick.inputs.drive_error or overdue:
        _cancel(tick, running, Outcome.STOPPED, tick.inputs.drive_error or reason(RequestRefusal.ENABLE_TIMEOUT))


def _cancel(tick: Tick, running: RunningAction, outcome: Outcome, why: Reason) -> None:
    """Cancel before the first row of the plan; joints that were being stiffened stay held."""
    held = running.stage is Stage.STIFFENING
    tick.change_gait(Change.INTERRUPTED if held else Change.ABANDONED)
    _end(tick, running, outcome, why)


def _stiffen(tick: Tick, running: RunningAction) -> None:
    """Hold damped joints where they are, and plan anew from there: they may have sunk since the first plan.

    A joint that leans on its end stop is measured a little beyond what the guard lets pass.
    """
    limits, gait = tick.settings.limits, tick.state.gait
    held_rad = np.clip(tick.inputs.feedback.position_rad, limits.low_rad, limits.high_rad)
    number = tick.state.plan_number + 1
    tick.plan_requests.append(plan_request(number, running.report.action, gait.phase, gait.state, held_rad))
    tick.update(
        motion=follower.start_stiffening(held_rad, tick.settings.gains),
        plan_number=number,
        running=replace(running, stage=Stage.STIFFENING, requested_ns=tick.now_ns, awaited_plans=frozenset({number})),
    )


def _move(tick: Tick, running: RunningAction) -> None:
    assert running.plan is not None
    tick.update(
        motion=follower.start_plan(tick.state.motion, running.plan),
        running=replace(running, stage=Stage.MOVING),
    )
    _request_next_steps(tick)


def _complete_movement(tick: Tick, running: RunningAction) -> None:
    assert running.plan is not None
    state = tick.state
    phases = gait_machine.following_phases(state.gait)
    tick.state = replace(
        state,
        steps=state.steps + running.plan.steps,
        distance_walked_m=state.distance_walked_m + running.plan.advance_m,
    )
    tick.change_gait(Change.COMPLETED)
    if tick.state.gait.running is None:
        tick.update(motion=follower.hold(tick.state.motion))
        _end(tick, running, Outcome.COMPLETED, running.walk_ended_by)
        return
    onward = running.next_steps.get(tick.state.gait.phase)
    if onward is None:  # the walk was closed too late for `next_step_missing` to halt the legs before
        _halt(tick, next((running.next_steps[phase] for phase in phases if phase in running.next_steps), None))
        return
    tick.update(
        running=replace(running, plan=onward, next_steps={}, awaited_plans=frozenset()),
        motion=follower.start_plan(tick.state.motion, onward),
    )
    _request_next_steps(tick)


def _halt(tick: Tick, path: Plan | None) -> None:
    """Hold at the end of a step that nothing may follow; the legs still move there and slow down along another step."""
    motion = tick.state.motion
    tick.update(motion=follower.hold(motion) if path is None else follower.start_plan(motion, path))
    tick.change_gait(Change.INTERRUPTED)
    stop_action(tick, reason(RequestRefusal.PLANNER_TIMEOUT))


def _request_next_steps(tick: Tick) -> None:
    """In a walk request both steps that may follow, from the end of the running one."""
    state = tick.state
    phases = gait_machine.following_phases(state.gait)
    running = state.running
    assert running is not None
    assert running.plan is not None
    last_rad, lands = running.plan.position_rad[-1], running.plan.to_state
    numbers = range(state.plan_number + 1, state.plan_number + 1 + len(phases))
    for number, phase in zip(numbers, phases, strict=True):
        action = gait_machine.action_of(phase)
        tick.plan_requests.append(plan_request(number, action, phase, lands, np.asarray(last_rad)))
    tick.state = replace(
        state,
        plan_number=state.plan_number + len(phases),
        running=replace(running, awaited_plans=running.awaited_plans | frozenset(numbers)),
    )


def _end(tick: Tick, running: RunningAction, outcome: Outcome, why: Reason | None) -> None:
    state = tick.state
    reports = ended(running, outcome, state.gait.state, tick.now_ns, why)
    tick.audit.extend(end_record(report, state.steps, state.distance_walked_m) for report in reports)
    tick.state = replace(state, running=None)
    tick.update_reports(*reports)
