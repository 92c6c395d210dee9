"""Operator commands and action requests: what is handled at once, and which requested actions are granted."""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from app.control.events.table import RaisedEvent, blocker, compared_fields
from app.control.gait import machine as gait_machine
from app.control.gait.machine import Ignored, Latched, Refused, Started
from app.control.inputs import ActionRequest, DriveOrder, new_release
from app.control.running_action import RunningAction, command_record, new_report, plan_request
from app.control.state import Tick
from app.ipc.messages import ActionReport, OperatorCommand, OperatorKind
from app.ipc.states import GESTURE_OF, Action, Effect, RequestRefusal, Source
from app.ipc.streams import NS_PER_MS
from app.motion.follower import Mode
from logs import records
from logs.reason import Reason, reason

ACT_STALE_MS = 500  # a key pressed longer ago requests nothing any more; STOP never expires


def handle_operator_commands(tick: Tick) -> None:
    """Handle the new operator commands in their order."""
    for command in tick.inputs.commands:
        if command.sequence > tick.state.sequence:
            tick.update(sequence=command.sequence)
            _HANDLERS[command.kind](tick, command)
    if tick.inputs.must_end:
        _end(tick)


def handle_gesture(tick: Tick) -> None:
    """Take the request of a newly released gesture."""
    request = new_release(tick.state.streams, tick.inputs.report, tick.now_ns)
    if request is None:
        return
    if request.released_ns < tick.state.armed_ns:
        refuse(tick, request, reason(RequestRefusal.RELEASED_BEFORE_ARMING))
    else:
        tick.requests.append(request)  # while gestures are not armed, NOT_ARMED refuses it


def lacks_preflight(tick: Tick) -> bool:
    """Whether an action requested in this tick has not passed the pre-flight it needs; ending a walk needs none."""
    cleared = tick.inputs.cleared
    return cleared is not None and any(
        request.action not in cleared and request.action is not Action.WALK_END for request in tick.requests
    )


def arbitrate(tick: Tick) -> None:
    """Answer each request: by an event in force that refuses it, else by the gait machine."""
    for request in tick.requests:
        answer = gait_machine.ask(tick.state.gait, request.action)
        if isinstance(answer, Ignored):
            _ignore(tick, request, answer.reason)
        elif event := blocker(tick.state.events, request.source):
            refuse(tick, request, event.reason, event=event)
        elif tick.state.gait.running is None and not tick.state.motion.settled:
            refuse(tick, request, reason(RequestRefusal.COMING_TO_REST))
        elif isinstance(answer, Refused):
            refuse(tick, request, answer.reason)
        elif isinstance(answer, Latched):
            _latch(tick, request, answer)
        else:
            _begin(tick, request, answer)


def refuse(tick: Tick, request: ActionRequest, why: Reason, number: int = 0, event: RaisedEvent | None = None) -> None:
    """Show and record why a request is not granted; event: the one in force that refuses it."""
    state = tick.state
    tick.state = replace(state, refusal=why, refusal_count=state.refusal_count + 1)
    _record_refusal(tick, request, why, number, event)


def _ignore(tick: Tick, request: ActionRequest, why: Reason) -> None:
    tick.update(ignored_count=tick.state.ignored_count + 1)
    _record_refusal(tick, request, why, 0)


def _record_refusal(
    tick: Tick, request: ActionRequest, why: Reason, number: int, event: RaisedEvent | None = None
) -> None:
    by_gesture = request.source is Source.GESTURE
    tick.audit.append(
        records.Refusal(
            reason=why,
            source=request.source.value,
            state=tick.state.gait.state.value,
            action=request.action.value,
            gesture=GESTURE_OF[request.action].value if by_gesture else None,
            number=number,
            recognised_ns=request.recognised_ns,
            released_ns=request.released_ns,
            refused_ns=tick.now_ns,
            event=event.event.value if event else "",
            raised_ns=event.since_ns if event else 0,
            **(compared_fields(event) if event else {}),
        )
    )


def _latch(tick: Tick, request: ActionRequest, answer: Latched) -> None:
    running = tick.state.running
    assert running is not None
    report = _accept(tick, request)
    tick.update(gait=answer.gait, running=replace(running, ending=report))


def _begin(tick: Tick, request: ActionRequest, answer: Started) -> None:
    report = _accept(tick, request)
    number = tick.state.plan_number + 1
    measured_rad = tick.inputs.feedback.position_rad
    tick.plan_requests.append(plan_request(number, request.action, answer.gait.phase, report.from_state, measured_rad))
    running = RunningAction(
        report=report,
        requested_ns=tick.now_ns,
        awaited_plans=frozenset({number}),
        initial_command=tick.state.motion.command,
        start_rad=measured_rad,
    )
    tick.change_gait(answer.gait)
    tick.update(running=running, plan_number=number)


def _accept(tick: Tick, request: ActionRequest) -> ActionReport:
    number = tick.state.number + 1
    report = new_report(request, number, tick.state.gait.state, tick.now_ns)
    tick.update(number=number)
    tick.audit.append(command_record(report))
    return report


# --- operator commands --------------------------------------------------------------------------------------------


def _heartbeat(_tick: Tick, _: OperatorCommand) -> None:
    """`update_streams` keeps its time."""


def _stop(tick: Tick, command: OperatorCommand) -> None:
    presses = tick.state.stop_presses + 1
    tick.update(stop_presses=presses, stop_ns=command.sent_ns, stop_received_ns=tick.now_ns, stop_command_ns=0)
    body = records.Stop(
        state=tick.state.gait.state.value,
        effect=(Effect.HOLD if presses == 1 else Effect.DAMP).name.lower(),
        sent_ns=command.sent_ns,
        seen_ns=tick.now_ns,
    )
    tick.update(stop_records=(*tick.state.stop_records, body))  # recorded with its first joint command, in a tick


def _acknowledge(tick: Tick, command: OperatorCommand) -> None:
    """It covers what was in force when it was sent: a STOP on its heels stays."""
    waiting = [one for one in tick.state.events if one.latched and one.since_ns < command.sent_ns]
    tick.acknowledged_ns = command.sent_ns
    if tick.state.stop_ns < command.sent_ns:
        tick.update(stop_presses=0)
    since_ns = min((one.since_ns for one in waiting), default=tick.now_ns)
    tick.audit.append(
        records.Acknowledgement(
            events=tuple(one.event.value for one in waiting),
            waited_s=(tick.now_ns - since_ns) / 1e9,
            accepted=bool(waiting),
            reason="" if waiting else "nothing to acknowledge",
        )
    )


def _arm(tick: Tick, _: OperatorCommand) -> None:
    tick.update(armed_ns=tick.now_ns)
    tick.audit.append(records.Arming(armed=True))


def _disarm(tick: Tick, _: OperatorCommand) -> None:
    tick.update(armed_ns=0)
    tick.audit.append(records.Arming(armed=False))


def _confirm_patient(tick: Tick, _: OperatorCommand) -> None:
    tick.update(patient_confirmed=True)
    tick.audit.append(records.PatientConfirmed(patient=tick.settings.patient))


def _act(tick: Tick, command: OperatorCommand) -> None:
    if command.action is None:
        return
    request = ActionRequest(action=command.action, source=Source.THERAPIST)
    if tick.now_ns - command.sent_ns > ACT_STALE_MS * NS_PER_MS:
        refuse(tick, request, reason(RequestRefusal.KEY_EXPIRED))
    else:
        tick.requests.append(request)


def _torque_off(tick: Tick, _: OperatorCommand) -> None:
    """The joints are switched off when they are fully damped (see `step`), never while stiff."""
    if tick.state.motion.mode is Mode.DAMPED:
        tick.update(torque_off=True)
    elif tick.state.motion.mode is Mode.DISABLED:
        tick.drives = DriveOrder.DISABLE
    else:
        tick.update(
            refusal=reason(RequestRefusal.TORQUE_OFF_NEEDS_DAMPING),
            refusal_count=tick.state.refusal_count + 1,
        )


def _shut_down(tick: Tick, _: OperatorCommand) -> None:
    _end(tick)


def _end(tick: Tick) -> None:
    if not tick.state.ending_ns:
        tick.update(ending_ns=tick.now_ns)


_HANDLERS: dict[OperatorKind, Callable[[Tick, OperatorCommand], None]] = {
    OperatorKind.HEARTBEAT: _heartbeat,
    OperatorKind.STOP: _stop,
    OperatorKind.ACKNOWLEDGE: _acknowledge,
    OperatorKind.ARM: _arm,
    OperatorKind.DISARM: _disarm,
    OperatorKind.ACT: _act,
    OperatorKind.TORQUE_OFF: _torque_off,
    OperatorKind.CONFIRM_PATIENT: _confirm_patient,
    OperatorKind.SHUT_DOWN: _shut_down,
}
