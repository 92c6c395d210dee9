"""One tick of control: inputs → freshness → events → safety mode → gait machine → trajectory → commands.

Pure: values in, values out, time among the inputs. Read `step` from top to bottom; each stage does what it is called.
"""

from __future__ import annotations

from math import isfinite

from msgspec.structs import replace

from app.control.diagnostics import MotionDiagnostics, Planning, Session, collect_diagnostics
from app.control.events.programs import CLOCK_STEP_S
from app.control.events.table import ROW, Active, Actives, advance, blocker, displaced
from app.control.executor import (
    accept_plans,
    advance_action,
    planner_timed_out,
    probe_planner,
    stop_action,
    walk_plan_missing,
)
from app.control.freshness import NS_PER_MS, initial_streams, update_streams
from app.control.gait import machine as gait_machine
from app.control.inputs import DriveOrder, Inputs, Outputs, Settings
from app.control.requests import arbitrate, handle_gesture, handle_operator_commands, uncleared
from app.control.running_action import Stage, measure, note_command
from app.control.state import ControlState, Tick
from app.ipc.states import Effect, Event, RequestRefusal
from app.ipc.streams import AUDIT_HEALTH, GUARDIAN, OPERATOR, TRIGGER
from app.motion import follower
from app.motion.follower import Mode
from logs import records
from logs.reason import Reason, reason

# What the trail calls the loss of a stream's heartbeat.
STREAM_OF = {
    Event.PERCEPTION_TIMEOUT: TRIGGER,
    Event.CONSOLE_TIMEOUT: OPERATOR,
    Event.AUDIT_TIMEOUT: AUDIT_HEALTH,
    Event.GUARDIAN_TIMEOUT: GUARDIAN,
}
END_HOLD_NS = 400 * NS_PER_MS  # a session that ends holds first, longer than a hold takes; then it gives way


def begin(inputs: Inputs) -> ControlState:
    """The memory before the first tick; what is not heard from then on is counted as silent."""
    return ControlState(heard=initial_streams(inputs))


def step(memory: ControlState, inputs: Inputs, settings: Settings) -> tuple[ControlState, Outputs]:
    """The memory after one tick, and what the shell has to do."""
    tick = Tick(memory=memory, inputs=inputs, settings=settings)
    _observe(tick)
    handle_operator_commands(tick)
    handle_gesture(tick)
    tick.memory = replace(tick.memory, heard=update_streams(tick.memory.heard, inputs))
    _watch(tick)
    _restrain(tick)
    probe_planner(tick)
    arbitrate(tick)
    accept_plans(tick)
    advance_action(tick)
    _switch_off(tick)
    _move(tick)
    return tick.memory, tick.outputs()


def _observe(tick: Tick) -> None:
    """What became of the command of the tick before."""
    memory, inputs = tick.memory, tick.inputs
    if inputs.guard_refusal is not None and inputs.written is not None:
        memory = replace(memory, motion=follower.resume_from(memory.motion, inputs.written))
        refusal = inputs.guard_refusal
        tick.audit.append(
            records.GuardRefusal(
                reason=str(refusal),
                joint=refusal.joint.name.lower(),
                quantity=refusal.quantity.value,
                value=refusal.value if isfinite(refusal.value) else None,
                limit=refusal.limit if isfinite(refusal.limit) else None,
            )
        )
    if memory.stop_seen_ns and not memory.stop_command_ns:
        memory = replace(memory, stop_command_ns=inputs.written_ns)
    if memory.task is not None:
        task = measure(
            memory.task,
            memory.motion.command,
            inputs.feedback.position_rad,
            inputs.written_ns,
            inputs.now_ns,
        )
        memory = replace(memory, task=task)
    tick.memory = memory


def _watch(tick: Tick) -> None:
    """Which events are in force now."""
    before = tick.memory.active
    facts = collect_diagnostics(tick.inputs, tick.memory.heard, _standing(tick), tick.settings)
    after = advance(before, facts, tick.acknowledged_ns)
    if after is not before:
        effect_before = tick.memory.effect
        tick.memory = replace(tick.memory, active=after)
        tick.audit.extend(_news(before, after, tick.now_ns))
        if tick.memory.effect is not effect_before:
            tick.audit.append(
                records.EffectChanged(from_effect=effect_before.name.lower(), to_effect=tick.memory.effect.name.lower())
            )
    if abs(facts.clocks.step_s) > CLOCK_STEP_S:
        tick.audit.append(records.ClockStep(step_s=facts.clocks.step_s))


def _restrain(tick: Tick) -> None:
    """What the events in force do to the legs, before anybody's wish is heard."""
    effect = tick.memory.effect
    if tick.memory.motion.mode is not Mode.DISABLED and not tick.memory.heard.powered:
        _let_go(tick, _strongest(tick))
    elif effect is Effect.DAMP:
        _interrupt(tick)
        tick.memory = replace(tick.memory, motion=follower.ramp_to_damping(tick.memory.motion))
    elif effect is Effect.HOLD and tick.memory.gait.running is not None:
        _interrupt(tick)
    elif displaced(tick.memory.active) and tick.memory.gait.running is None:
        tick.reach(gait_machine.interrupt(tick.memory.gait))
    elif effect is Effect.REFUSE and tick.memory.gait.walking:
        _end_walk(tick)


def _interrupt(tick: Tick) -> None:
    """Whatever runs is over; where the legs rest they keep their state unless they will give way."""
    memory = tick.memory
    planning = memory.task is not None and memory.task.stage is Stage.PLANNING
    if memory.motion.mode is Mode.DISABLED or (planning and memory.effect is Effect.HOLD):
        tick.reach(gait_machine.abandon(memory.gait))  # nothing has moved yet
    else:
        tick.reach(gait_machine.interrupt(memory.gait))
    stop_action(tick, _strongest(tick))


def _let_go(tick: Tick, why: Reason | None) -> None:
    """The drives carry nothing any more."""
    tick.reach(gait_machine.power_off(tick.memory.gait))
    tick.memory = replace(tick.memory, motion=follower.disable(tick.memory.motion), torque_off=False)
    stop_action(tick, why)


def _end_walk(tick: Tick) -> None:
    """A wish for more steps could not be heard any more: the running step ends the walk."""
    task = tick.memory.task
    if task is not None and blocker(tick.memory.active, task.report.source) is not None:
        tick.memory = replace(tick.memory, gait=gait_machine.close_walk(tick.memory.gait))


def _move(tick: Tick) -> None:
    """The next command; what is not running any more slows down along its path and stays."""
    memory = tick.memory
    motion = follower.advance(memory.motion, tick.settings.gains, hold=memory.gait.running is None)
    if motion.halted:
        motion = follower.hold(motion)
    moves = motion.mode is Mode.MOVING or motion.mode is not memory.motion.mode
    still_since_ns = 0 if moves else memory.still_since_ns or tick.now_ns
    task = memory.task and note_command(memory.task, motion.command)
    tick.memory = replace(memory, motion=motion, still_since_ns=still_since_ns, task=task)


def _switch_off(tick: Tick) -> None:
    """Torque off on the operator's word or at the session's end, once the joints have been told to give way wholly.

    Before the tick's own movement: while the last stiffness is on the drives, a neutral command would be a jump.
    """
    memory = tick.memory
    wanted = memory.torque_off or memory.ending_ns
    if wanted and memory.motion.fully_damped:
        tick.drives = DriveOrder.DISABLE
        _let_go(tick, reason(RequestRefusal.TORQUE_OFF))
    if memory.ending_ns and tick.memory.motion.mode is Mode.DISABLED:
        tick.drives = DriveOrder.DISABLE
        tick.finished = True


def _standing(tick: Tick) -> MotionDiagnostics:
    memory = tick.memory
    return MotionDiagnostics(
        gait=memory.gait,
        motion=memory.motion,
        still_since_ns=memory.still_since_ns,
        session=_session(tick),
        planning=Planning(
            ready=memory.planner_ready, silent=planner_timed_out(tick), walk_plan_missing=walk_plan_missing(tick)
        ),
    )


def _session(tick: Tick) -> Session:
    memory = tick.memory
    ending_ns = memory.ending_ns
    return Session(
        armed=memory.armed_ns > 0,
        patient_confirmed=memory.patient_confirmed,
        uncleared=uncleared(tick),
        stop_presses=memory.stop_presses,
        ending=ending_ns > 0,
        ending_slack=ending_ns > 0 and tick.now_ns - ending_ns > END_HOLD_NS,
    )


def _strongest(tick: Tick) -> Reason | None:
    return next((one.reason for one in tick.memory.active if one.in_force), None)


def _news(before: Actives, after: Actives, now_ns: int) -> list[records.Body]:
    """Which events came into force and which went, for the trail."""
    was = {one.event: one for one in before}
    still = {one.event for one in after}
    raised: list[records.Body] = [
        records.EventRaised(event=one.event.value, effect=ROW[one.event].effect.name.lower(), text=one.reason)
        for one in after
        if one.event not in was
    ]
    lost: list[records.Body] = [
        records.HeartbeatLost(stream=STREAM_OF[one.event].name, age_ms=STREAM_OF[one.event].stale_ms)
        for one in after
        if one.event not in was and one.event in STREAM_OF
    ]
    gone = [body for one in before if one.event not in still for body in _cleared(one, now_ns)]
    return [*raised, *lost, *gone]


def _cleared(one: Active, now_ns: int) -> list[records.Body]:
    cleared = records.EventCleared(
        event=one.event.value,
        effect=ROW[one.event].effect.name.lower(),
        lasted_s=(now_ns - one.since_ns) / 1e9,
    )
    stream = STREAM_OF.get(one.event)
    if stream is None:
        return [cleared]
    silent_ms = stream.stale_ms + (one.last_ns - one.since_ns) / NS_PER_MS
    return [cleared, records.HeartbeatFound(stream=stream.name, silent_ms=silent_ms)]
