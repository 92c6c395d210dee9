"""One tick of control: inputs → streams → events → effect → action requests → trajectory → joint command.

Pure: values in, values out, time among the inputs.
"""

from __future__ import annotations

from math import isfinite

from msgspec.structs import replace

from app.control.diagnostics import PlanningDiagnostics, SessionDiagnostics, collect_diagnostics
from app.control.effects import END_HOLD_NS, apply_effect, apply_torque_off, disable_drives
from app.control.events.programs import CLOCK_STEP_S
from app.control.events.table import ROW, RaisedEvent, RaisedEvents, advance, compared_fields
from app.control.executor import accept_plans, advance_action, next_step_missing, planner_timed_out, probe_planner
from app.control.inputs import Inputs, Outputs, Settings, initial_streams, update_streams, without_stale_report
from app.control.joint_diagnostics import JointDiagnostics
from app.control.operator_commands import end_unattended, handle_operator_commands
from app.control.pause import paused_too_long, track_pause
from app.control.requests import arbitrate, handle_gesture, lacks_preflight
from app.control.running_action import measure, note_command
from app.control.silence import update_silences
from app.control.state import ControlState, Tick
from app.control.stop_inputs import input_records, reader_age_ns, update_stop_inputs
from app.ipc.states import Effect, Event
from app.ipc.streams import AUDIT_HEALTH, GUARDIAN, NS_PER_MS, OPERATOR, TRIGGER
from app.motion import follower
from app.motion.follower import Mode
from logs import records
from logs.reason import reason

# The stream whose heartbeat is missing while the event is present.
STREAM_OF = {
    Event.PERCEPTION_TIMEOUT: TRIGGER,
    Event.CONSOLE_TIMEOUT: OPERATOR,
    Event.AUDIT_TIMEOUT: AUDIT_HEALTH,
    Event.GUARDIAN_TIMEOUT: GUARDIAN,
}


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
    apply_effect(tick)
    track_pause(tick)
    probe_planner(tick)
    arbitrate(tick)
    apply_torque_off(tick)
    accept_plans(tick)
    advance_action(tick)
    disable_drives(tick)
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
    if inputs.withheld and inputs.written is not None and state.motion.mode is Mode.MOVING:
        # the legs stood at the command before; going on from the one left out, the next would be a jump
        state = replace(state, motion=follower.resume_from(state.motion, inputs.written))
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
