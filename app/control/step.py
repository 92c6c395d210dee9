"""One tick of control: inputs → streams → events → effect → action requests → trajectory → joint command.

Pure: values in, values out, time among the inputs.
"""

from __future__ import annotations

from math import isfinite

from msgspec.structs import replace

from app.control.diagnostics import JointDiagnostics, PlanningDiagnostics, SessionDiagnostics, collect_diagnostics
from app.control.events.programs import CLOCK_STEP_S
from app.control.events.table import ROW, RaisedEvent, RaisedEvents, advance, compared_fields, displaced, walk_ender
from app.control.executor import (
    accept_plans,
    advance_action,
    next_step_missing,
    planner_timed_out,
    probe_planner,
    step_onward,
    stop_action,
)
from app.control.gait.machine import Change
from app.control.inputs import (
    DriveNotice,
    DriveOrder,
    Inputs,
    Outputs,
    Settings,
    initial_streams,
    update_streams,
    without_stale_report,
)
from app.control.operator_commands import end_unattended, handle_operator_commands
from app.control.pause import paused_too_long, track_pause
from app.control.requests import arbitrate, handle_gesture, lacks_preflight
from app.control.running_action import Stage, measure, note_command
from app.control.silence import update_silences
from app.control.state import ControlState, Tick
from app.control.stop_inputs import input_records, reader_age_ns, update_stop_inputs
from app.ipc.states import Effect, Event, RequestRefusal
from app.ipc.streams import AUDIT_HEALTH, DAMP_NS, GUARDIAN, NS_PER_MS, OPERATOR, TRIGGER
from app.motion import follower
from app.motion.follower import Mode
from hal.joints.device import Joint
from logs import records
from logs.reason import Reason, reason

# The stream whose heartbeat is missing while the event is present.
STREAM_OF = {
    Event.PERCEPTION_TIMEOUT: TRIGGER,
    Event.CONSOLE_TIMEOUT: OPERATOR,
    Event.AUDIT_TIMEOUT: AUDIT_HEALTH,
    Event.GUARDIAN_TIMEOUT: GUARDIAN,
}
END_HOLD_NS = 400 * NS_PER_MS  # a session that ends holds first, longer than a hold takes; then it damps


def initial_state(inputs: Inputs) -> ControlState:
    """The state before the first tick; streams count as fresh from then."""
    return ControlState(streams=initial_streams(inputs))


def step(state: ControlState, inputs: Inputs, settings: Settings) -> tuple[ControlState, Outputs]:
    """The state after one tick, and what the loop has to do."""
    inputs = without_stale_report(state.streams, inputs)
    tick = Tick(state=state, inputs=inputs, settings=settings)
    _measure_last_tick(tick)
    handle_operator_commands(tick)
    handle_gesture(tick)
    tick.update(streams=update_streams(tick.state.streams, inputs, tick.state.lease))
    end_unattended(tick)
    _update_stop_inputs(tick)
    _update_events(tick)
    _apply_effect(tick)
    track_pause(tick)
    probe_planner(tick)
    arbitrate(tick)
    _apply_torque_off(tick)
    accept_plans(tick)
    advance_action(tick)
    _disable_drives(tick)
    _advance_motion(tick)
    return tick.state, tick.outputs()


def _measure_last_tick(tick: Tick) -> None:
    """Take over what happened to the last tick's command."""
    state, inputs = tick.state, tick.inputs
    if inputs.guard_refusal is not None and inputs.written is not None:
        state = replace(state, motion=follower.resume_from(state.motion, inputs.written))
        refusal = inputs.guard_refusal
        tick.audit.append(
            records.GuardRefusal(
                reason=reason(refusal.code, **refusal.values),
                joint=refusal.joint.name.lower(),
                quantity=refusal.quantity.value,
                value=refusal.value if isfinite(refusal.value) else None,
                limit=refusal.limit if isfinite(refusal.limit) else None,
            )
        )
    if state.stop_received_ns and not state.stop_command_ns and inputs.written_ns > state.stop_received_ns:
        state = replace(state, stop_command_ns=inputs.written_ns)
    if state.stop_records and (inputs.written_ns > state.stop_records[-1].seen_ns):
        tick.audit.extend(replace(body, command_ns=inputs.written_ns) for body in state.stop_records)
        state = replace(state, stop_records=())
    if state.running is not None:
        running = measure(
            state.running, state.motion.command, inputs.feedback.position_rad, inputs.written_ns, inputs.now_ns
        )
        state = replace(state, running=running)
    tick.state = state


def _update_stop_inputs(tick: Tick) -> None:
    before, inputs = tick.state.stop_inputs, tick.inputs
    age_ns = reader_age_ns(inputs.stop_inputs, inputs.now_ns, tick.state.streams.reader_delay_ns)
    after = update_stop_inputs(before, inputs.stop_inputs, inputs.now_ns, age_ns)
    if after != before:
        tick.update(stop_inputs=after)
        tick.audit.extend(input_records(before, after, inputs.stop_inputs.at_ns))


def _update_events(tick: Tick) -> None:
    """Update the events in force, and record what changed."""
    before = tick.state.events
    diagnostics = collect_diagnostics(tick, _session(tick), _planning(tick))
    after = advance(before, diagnostics, tick.acknowledged_ns)
    _note_silence(tick, diagnostics.joints, any(one.event is Event.JOINT_SANK and one.in_force for one in after))
    if after is not before:
        effect_before = tick.state.effect
        tick.update(events=after)
        tick.audit.extend(_event_records(before, after, tick.now_ns))
        if tick.state.effect is not effect_before:
            tick.audit.append(
                records.EffectChanged(
                    from_effect=effect_before.name.lower(),
                    to_effect=tick.state.effect.name.lower(),
                    in_force=tick.in_force,
                )
            )
    if abs(diagnostics.clocks.step_s) > CLOCK_STEP_S:
        tick.audit.append(records.ClockStep(step_s=diagnostics.clocks.step_s))


def _note_silence(tick: Tick, joints: JointDiagnostics, sank: bool) -> None:
    """Keep where joints were before they fell silent, and which have sunk meanwhile."""
    state = tick.state
    if joints.silent or state.silenced or state.sunk:
        tick.update(
            silenced=update_silences(state.silenced, state.motion, tick.inputs.feedback, joints.silent, tick.now_ns),
            sunk=state.sunk | joints.sunk if sank else frozenset(),
        )


def _apply_effect(tick: Tick) -> None:
    """Apply the strongest effect in force, before any request is answered."""
    effect = tick.state.effect
    if tick.state.motion.mode is not Mode.DISABLED and not tick.state.streams.powered:
        _lose_power(tick)
    elif effect is Effect.DAMP:
        _interrupt(tick)
        _damp(tick)
    elif effect is Effect.HOLD and tick.state.gait.running is not None:
        _interrupt(tick)
    elif displaced(tick.state.events) and tick.state.gait.running is None:
        tick.change_gait(Change.INTERRUPTED)
    elif effect is Effect.REFUSE and tick.state.gait.walking:
        _end_walk(tick)


def _apply_torque_off(tick: Tick) -> None:
    """End what waits for its plan or for power, though it was requested, or is planned, in the same tick."""
    torque_off = tick.drives is DriveOrder.DISABLE or tick.state.torque_off
    if torque_off and tick.state.running is not None:
        _interrupt(tick, reason(RequestRefusal.TORQUE_OFF))


def _damp(tick: Tick) -> None:
    """Ramp to damping; without a ramp what is not held any more, whatever was commanded."""
    state = tick.state
    if state.motion.mode is not Mode.DISABLED:
        tick.unheld = _unheld(state)
        tick.update(motion=follower.ramp_to_damping(state.motion, tick.unheld))
    elif state.streams.powered:
        tick.update(motion=follower.start_damped(tick.settings.gains))


def _unheld(state: ControlState) -> frozenset[Joint]:
    """The joints that the guardian has damped or switched off, or that have sunk while they did not answer."""
    in_force = {one.event for one in state.events if one.in_force}
    if Event.GUARDIAN_ACTED in in_force:
        return frozenset(Joint)
    return state.sunk


def _interrupt(tick: Tick, why: Reason | None = None) -> None:
    """End what runs. Legs at rest keep their gait state, unless they will be damped. why: as of `stop_action`."""
    state = tick.state
    planning = state.running is not None and state.running.stage is Stage.PLANNING
    if state.motion.mode is Mode.DISABLED or (planning and state.effect is Effect.HOLD):
        tick.change_gait(Change.ABANDONED)  # nothing has moved yet
    else:
        tick.update(motion=replace(state.motion, onward=step_onward(state)))  # a walk's step ends with the legs moving
        tick.change_gait(Change.INTERRUPTED)
    stop_action(tick, why)


def _lose_power(tick: Tick, why: Reason | None = None) -> None:
    """The drives have no power any more."""
    tick.change_gait(Change.POWER_LOST)
    tick.update(motion=follower.disable(tick.state.motion), torque_off=False)
    stop_action(tick, why)


def _end_walk(tick: Tick) -> None:
    """Gesture 6 would be refused: the running step ends the walk."""
    running = tick.state.running
    event = None if running is None else walk_ender(tick.state.events, running.report.source)
    if running is not None and event is not None and not tick.state.gait.closing:
        tick.change_gait(Change.WALK_CLOSED)
        tick.update(running=replace(running, walk_ended_by=event.reason))


def _advance_motion(tick: Tick) -> None:
    """The next joint command; a movement that pauses slows down, one whose action has ended slows down and holds."""
    state = tick.state
    ended = state.gait.running is None
    slow = ended or state.effect is Effect.PAUSE
    motion = follower.advance(state.motion, tick.settings.gains, hold=slow, missed=tick.inputs.missed_ticks)
    if ended and motion.halted:
        motion = follower.hold(motion)
    moves = motion.mode is Mode.MOVING or motion.mode is not state.motion.mode
    still_since_ns = 0 if moves else state.still_since_ns or tick.now_ns
    running = state.running and note_command(state.running, motion.command)
    tick.state = replace(state, motion=motion, still_since_ns=still_since_ns, running=running)


def _disable_drives(tick: Tick) -> None:
    """Torque off at the operator's command, after the guardian's or at the session's end, once the joints are damped.

    Before the tick's own command: while the last stiffness is on the drives, a neutral command would be a jump.
    """
    state = tick.state
    guardian = state.streams.guardian
    damped_ns = END_HOLD_NS + DAMP_NS if state.unattended else 0
    ended = state.ending_ns > 0 and tick.now_ns - state.ending_ns >= damped_ns
    followed = guardian is not None and guardian.off and not (state.torque_off or ended)
    if (state.torque_off or ended or followed) and state.motion.fully_damped:
        tick.drives = DriveOrder.DISABLE
        if followed and tick.inputs.drive_error is None:  # once: an order that failed is given again in each tick
            tick.audit.append(records.Note(text=reason(DriveNotice.FOLLOWED_GUARDIAN)))
        _lose_power(tick, reason(RequestRefusal.TORQUE_OFF))
    if state.ending_ns and tick.state.motion.mode is Mode.DISABLED:
        tick.drives = DriveOrder.DISABLE
        tick.finished = True


def _planning(tick: Tick) -> PlanningDiagnostics:
    return PlanningDiagnostics(
        ready=tick.state.planner_ready,
        timed_out=planner_timed_out(tick),
        next_step_missing=next_step_missing(tick),
        pause_too_long=paused_too_long(tick),
    )


def _session(tick: Tick) -> SessionDiagnostics:
    state = tick.state
    ending_ns = state.ending_ns
    return SessionDiagnostics(
        armed=state.armed_ns > 0,
        patient_confirmed=state.patient_confirmed,
        lacks_preflight=lacks_preflight(tick),
        stop_presses=state.stop_presses,
        voice_stopped=state.voice_stopped,
        ending=ending_ns > 0,
        ending_damped=ending_ns > 0 and tick.now_ns - ending_ns > END_HOLD_NS,
    )


def _event_records(before: RaisedEvents, after: RaisedEvents, now_ns: int) -> list[records.Body]:
    """Records of the events that went and of those that came into force; one that was raised anew is among both."""
    was = {(one.event, one.since_ns) for one in before}
    still = {(one.event, one.since_ns) for one in after}
    raised: list[records.Body] = [
        records.EventRaised(
            event=one.event.value,
            effect=ROW[one.event].effect.name.lower(),
            text=one.reason,
            raised_ns=one.since_ns,
            **compared_fields(one.compared),
        )
        for one in after
        if (one.event, one.since_ns) not in was
    ]
    lost: list[records.Body] = [
        records.HeartbeatLost(stream=STREAM_OF[one.event].name, age_ms=_age_ms(one))
        for one in after
        if (one.event, one.since_ns) not in was and one.event in STREAM_OF
    ]
    gone = [body for one in before if (one.event, one.since_ns) not in still for body in _cleared(one, now_ns)]
    return [*gone, *raised, *lost]


def _cleared(one: RaisedEvent, now_ns: int) -> list[records.Body]:
    cleared = records.EventCleared(
        event=one.event.value,
        effect=ROW[one.event].effect.name.lower(),
        lasted_s=(now_ns - one.since_ns) / 1e9,
        total=one.total if ROW[one.event].counts else None,
    )
    stream = STREAM_OF.get(one.event)
    if stream is None:
        return [cleared]
    silent_ms = _age_ms(one) + (one.last_ns - one.since_ns) / NS_PER_MS
    return [cleared, records.HeartbeatFound(stream=stream.name, silent_ms=silent_ms)]


def _age_ms(one: RaisedEvent) -> float:
    """How old the stream's newest message was when the event was raised."""
    return one.compared.value if one.compared else STREAM_OF[one.event].stale_ms
