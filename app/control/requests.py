"""Operator commands and action requests: what is handled at once, and which requested actions are granted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from app.control.diagnostics import exceeded_figure, link_figures, link_values
from app.control.events.row import Compared
from app.control.events.table import RaisedEvent, acknowledges, blocker, compared_fields
from app.control.gait import machine as gait_machine
from app.control.gait.machine import Answer, Change, Gait, Ignored, Latched, Refused, Started
from app.control.inputs import ActionRequest, DriveOrder, new_release
from app.control.running_action import RunningAction, command_record, new_report, plan_request
from app.control.state import Tick
from app.ipc.messages import STOP_KINDS, ActionReport, OperatorCommand, OperatorKind
from app.ipc.states import GESTURE_OF, Action, ConsoleChange, Effect, Event, RequestRefusal, Source, StopSource
from app.ipc.streams import NS_PER_MS, TRIGGER
from app.motion.follower import Mode
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import Reason, reason

FUTURE_MS = 50.0  # a capture time farther ahead of now than this is invalid
ACT_STALE_MS = 500  # a key pressed longer ago requests nothing any more; STOP never expires


def handle_operator_commands(tick: Tick) -> None:
    """Handle the new operator commands in their order; end the session where it must."""
    for command in tick.inputs.commands:
        if admits(tick.state.lease, tick.state.sequence, command):
            _HANDLERS[command.kind](tick, command)
            if command.lease == tick.state.lease:
                tick.update(sequence=command.sequence)
    if tick.inputs.must_end:
        _end(tick)


def end_unattended(tick: Tick) -> None:
    """End the session without a console for too long; while control itself stood still, none could be heard."""
    streams = tick.state.streams
    silent_ns = tick.now_ns - streams.console_ns - streams.unread_ns
    if silent_ns > tick.settings.unattended_ns and not tick.state.ending_ns:
        tick.update(unattended=True)
        tick.audit.append(records.Note(text=reason(ConsoleChange.NOBODY_CAME)))
        _end(tick)


def admits(lease: int, sequence: int, command: OperatorCommand) -> bool:
    """Whether control hears this command: of the console that has the lease, each once and in order.

    A console with a later lease takes over first. STOP is heard from everybody.
    """
    if command.lease == lease:
        return command.sequence > sequence
    if command.kind is OperatorKind.TAKE_OVER:
        return command.lease > lease
    return command.kind in STOP_KINDS


def presses_after(presses: int, newest_ns: int, sent_ns: int) -> int:
    """How many presses of STOP count after one more, sent then; newest_ns: when the one heard last was sent.

    One that was sent before that follows nothing: pressed while a link was lost, it comes after its return's takeover.
    """
    return presses if presses and sent_ns < newest_ns else presses + 1


def handle_gesture(tick: Tick) -> None:
    """Take the request of a newly released gesture."""
    request = new_release(tick.state.streams, tick.inputs.report)
    if request is None:
        return
    untimely = untimely_release(request.released_ns, request.pressed_ns, tick.state.armed_ns, tick.now_ns)
    if untimely is not None:
        refuse(tick, request, reason(untimely[0]), compared=untimely[1])
    elif foreign := outside_vocabulary(request.action, tick.settings.vocabulary):
        refuse(tick, request, foreign)
    else:
        tick.requests.append(request)  # while gestures are not armed, NOT_ARMED refuses it


def lacks_preflight(tick: Tick) -> bool:
    """Whether an action requested at rest has not passed the pre-flight it needs; ending a walk needs none.

    During a movement nothing could start: what is ignored there raises no event that would end a walk.
    """
    cleared, resting = tick.inputs.cleared, tick.state.gait.running is None
    return (
        cleared is not None
        and resting
        and any(request.action not in cleared and request.action is not Action.WALK_END for request in tick.requests)
    )


def arbitrate(tick: Tick) -> None:
    """Answer each request: by an event in force that refuses it, else by the gait machine."""
    for request in tick.requests:
        state, event = tick.state, blocker(tick.state.events, request.source)
        answer = answer_to(state.gait, request.action, event.reason if event else None, settled=state.motion.settled)
        if isinstance(answer, Ignored):
            _record_refusal(tick, request, answer.reason)
        elif isinstance(answer, Refused):
            refuse(tick, request, answer.reason, event=event)
        elif isinstance(answer, Latched):
            _latch(tick, request)
        else:
            _begin(tick, request, answer)


def answer_to(gait: Gait, action: Action, forbidden: Reason | None, *, settled: bool) -> Answer:
    """The answer to a request; forbidden: by the strongest event in force that refuses it, if one does."""
    answer = gait_machine.ask(gait, action)
    if isinstance(answer, Ignored):
        return answer
    if forbidden is not None:
        return Refused(reason=forbidden)
    if gait.running is None and not settled:
        return Refused(reason=reason(RequestRefusal.COMING_TO_REST))
    return answer


def outside_vocabulary(action: Action, vocabulary: frozenset[Gesture]) -> Reason | None:
    """Why the gesture of this action does not command; None when it may."""
    gesture = GESTURE_OF[action]
    return None if gesture in vocabulary else reason(RequestRefusal.NOT_IN_VOCABULARY, gesture=gesture)


Untimely = tuple[RequestRefusal, Compared]  # why a request of that moment is not answered at all


def untimely_release(released_ns: int, pressed_ns: int, armed_ns: int, now_ns: int) -> Untimely | None:
    """A stale release never acts, not even later, nor does one whose press began before gestures could command.

    A wearer who pushes while nothing comes of it draws the hand back at last, and means nothing by it.
    """
    age_ms, before_ms = (now_ns - released_ns) / NS_PER_MS, (armed_ns - pressed_ns) / NS_PER_MS
    if not -FUTURE_MS <= age_ms <= TRIGGER.stale_ms:
        limit_ms = TRIGGER.stale_ms if age_ms > 0 else -FUTURE_MS
        return RequestRefusal.RELEASE_EXPIRED, Compared("request_age_ms", age_ms, limit_ms)
    if before_ms > 0:
        return RequestRefusal.RELEASED_BEFORE_ARMING, Compared("before_arming_ms", before_ms, 0.0)
    return None


def untimely_key(sent_ns: int, now_ns: int) -> Untimely | None:
    """A key pressed too long ago requests nothing any more."""
    age_ms = (now_ns - sent_ns) / NS_PER_MS
    if age_ms > ACT_STALE_MS:
        return RequestRefusal.KEY_EXPIRED, Compared("request_age_ms", age_ms, ACT_STALE_MS)
    return None


def refuse(
    tick: Tick,
    request: ActionRequest,
    why: Reason,
    number: int = 0,
    *,
    event: RaisedEvent | None = None,
    compared: Compared | None = None,
) -> None:
    """Show and record why a request is not granted; event: the one in force that refuses it, else what was compared."""
    tick.show_refusal(why)
    _record_refusal(tick, request, why, number, event=event, compared=compared)


def _record_refusal(
    tick: Tick,
    request: ActionRequest,
    why: Reason,
    number: int = 0,
    *,
    event: RaisedEvent | None = None,
    compared: Compared | None = None,
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
            **compared_fields(event.compared if event else compared),
            **_grounds(tick, request),
        )
    )


def _grounds(tick: Tick, request: ActionRequest) -> dict[str, Any]:
    """What else an answer takes, for the trail."""
    moments = {"pressed_ns": request.pressed_ns, "requested_ns": request.requested_ns}
    return moments | {"settled": tick.state.motion.settled, "in_force": tick.in_force}


def _latch(tick: Tick, request: ActionRequest) -> None:
    running = tick.state.running
    assert running is not None
    report = _accept(tick, request)
    tick.change_gait(Change.REQUESTED, request.action)
    tick.update(running=replace(running, ending=report))


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
    tick.change_gait(Change.REQUESTED, request.action)
    tick.update(running=running, plan_number=number)


def _accept(tick: Tick, request: ActionRequest) -> ActionReport:
    number = tick.state.number + 1
    report = new_report(request, number, tick.state.gait.state, tick.now_ns)
    tick.update(number=number, refusal=None)
    tick.audit.append(command_record(report, **_grounds(tick, request)))
    return report


# --- operator commands --------------------------------------------------------------------------------------------


def _heartbeat(_tick: Tick, _: OperatorCommand) -> None:
    """`update_streams` keeps its time."""


def _stop(tick: Tick, command: OperatorCommand) -> None:
    presses = presses_after(tick.state.stop_presses, tick.state.press_ns, command.sent_ns)
    tick.update(stop_presses=presses, press_ns=command.sent_ns)
    by = StopSource.TAKEOVER if command.kind is OperatorKind.TAKE_OVER else StopSource.KEY
    _record_stop(tick, command, by, Effect.HOLD if presses == 1 else Effect.DAMP)


def _voice_stop(tick: Tick, command: OperatorCommand) -> None:
    """Not counted with the key's: a word said twice, or the key after the word, may not damp a standing wearer."""
    tick.update(voice_stopped=True)
    _record_stop(tick, command, StopSource.VOICE, Effect.HOLD)


def _record_stop(tick: Tick, command: OperatorCommand, by: StopSource, effect: Effect) -> None:
    tick.stopped = True
    tick.update(
        stop_ns=command.sent_ns,
        stop_received_ns=tick.now_ns,
        stop_command_ns=0,
        newest_stop=(command.lease, command.sequence),
    )
    body = records.Stop(
        state=tick.state.gait.state.value,
        effect=effect.name.lower(),
        sent_ns=command.sent_ns,
        seen_ns=tick.now_ns,
        by=by.value,
    )
    tick.update(stop_records=(*tick.state.stop_records, body))  # recorded with its first joint command, in a tick


def _acknowledge(tick: Tick, command: OperatorCommand) -> None:
    """It covers what was in force when its key was pressed: a STOP after that stays.

    So does a STOP that came in the same tick, whose event has not been raised yet: nothing is acknowledged beside it.
    """
    waiting = [one for one in tick.state.events if not tick.stopped and acknowledges(command.sent_ns, one)]
    if not tick.stopped:
        tick.acknowledged_ns = command.sent_ns
        _reset_stops(tick, {one.event for one in tick.state.events} - {one.event for one in waiting})
    if waiting and tick.state.armed_ns:  # until now no push had an effect
        tick.update(armed_ns=tick.now_ns)
    why = RequestRefusal.STOPPED_MEANWHILE if tick.stopped else RequestRefusal.NOTHING_TO_ACKNOWLEDGE
    since_ns = min((one.since_ns for one in waiting), default=tick.now_ns)
    tick.audit.append(
        records.Acknowledgement(
            events=tuple(one.event.value for one in waiting),
            waited_s=(tick.now_ns - since_ns) / 1e9,
            accepted=bool(waiting),
            at_ns=tick.now_ns,
            reason="" if waiting else reason(why),
        )
    )


def _reset_stops(tick: Tick, left: set[Event]) -> None:
    """Count presses anew from an acknowledgement on; left: the events that it does not cover, whose STOPs still count.

    Control sees a STOP later than it was sent: an acknowledgement sent in between does not cover its event.
    """
    if tick.state.stop_ns >= tick.acknowledged_ns:
        return
    if not left & {Event.STOP, Event.STOP_AGAIN}:
        tick.update(stop_presses=0)
    if Event.VOICE_STOP not in left:
        tick.update(voice_stopped=False)


def _arm(tick: Tick, command: OperatorCommand) -> None:
    untimely = untimely_key(command.sent_ns, tick.now_ns)
    if untimely is not None:
        _refuse_command(tick, reason(untimely[0]))
        return
    poor = exceeded_figure(link_figures(tick.state.streams.link))
    if poor is not None:  # refused with the figure, not armed and then refused gesture by gesture
        _refuse_command(tick, reason(RequestRefusal.LINK_POOR, **link_values(poor)))
        return
    tick.update(armed_ns=tick.now_ns)
    tick.audit.append(records.Arming(armed=True, at_ns=tick.now_ns))


def _refuse_command(tick: Tick, why: Reason) -> None:
    tick.show_refusal(why)
    tick.audit.append(records.Note(text=why))


def _disarm(tick: Tick, _: OperatorCommand) -> None:
    tick.update(armed_ns=0)
    tick.audit.append(records.Arming(armed=False, at_ns=tick.now_ns))


def _confirm_patient(tick: Tick, _: OperatorCommand) -> None:
    first = not tick.state.patient_confirmed
    tick.update(patient_confirmed=True)
    tick.audit.append(records.PatientConfirmed(patient=tick.settings.patient))
    if first and tick.state.armed_ns:  # armed anew: until now no push had an effect
        tick.update(armed_ns=tick.now_ns)
        tick.audit.append(records.Arming(armed=True, at_ns=tick.now_ns))


def _act(tick: Tick, command: OperatorCommand) -> None:
    if command.action is None:
        return
    request = ActionRequest(action=command.action, source=Source.THERAPIST, requested_ns=command.sent_ns)
    untimely = untimely_key(command.sent_ns, tick.now_ns)
    if untimely is not None:
        refuse(tick, request, reason(untimely[0]), compared=untimely[1])
    else:
        tick.requests.append(request)


def _torque_off(tick: Tick, _: OperatorCommand) -> None:
    """The joints are switched off when they are fully damped (see `step`), never while stiff."""
    if tick.state.motion.mode is Mode.DAMPED:
        tick.update(torque_off=True)
    elif tick.state.motion.mode is Mode.DISABLED:
        tick.drives = DriveOrder.DISABLE
    else:
        _refuse_command(tick, reason(RequestRefusal.TORQUE_OFF_NEEDS_DAMPING))
        return
    tick.audit.append(records.Note(text=reason(RequestRefusal.TORQUE_OFF)))


def _take_over(tick: Tick, command: OperatorCommand) -> None:
    """Another console commands. Nothing moves by it: the legs are held as by STOP, and gestures disarmed."""
    if command.lease == tick.state.lease:
        return
    if tick.state.armed_ns:
        _disarm(tick, command)
    tick.update(lease=command.lease, operator=command.operator)
    tick.audit.append(
        records.Note(text=reason(ConsoleChange.TAKEN_OVER, operator=command.operator or "–", lease=command.lease))
    )
    if not tick.state.stop_presses:
        _stop(tick, command)
    tick.update(stop_received_ns=0)  # nobody pressed STOP: there is no time to show


def _shut_down(tick: Tick, _: OperatorCommand) -> None:
    _end(tick)


def _end(tick: Tick) -> None:
    if not tick.state.ending_ns:
        tick.update(ending_ns=tick.now_ns)


_HANDLERS: dict[OperatorKind, Callable[[Tick, OperatorCommand], None]] = {
    OperatorKind.HEARTBEAT: _heartbeat,
    OperatorKind.STOP: _stop,
    OperatorKind.VOICE_STOP: _voice_stop,
    OperatorKind.ACKNOWLEDGE: _acknowledge,
    OperatorKind.ARM: _arm,
    OperatorKind.DISARM: _disarm,
    OperatorKind.ACT: _act,
    OperatorKind.TORQUE_OFF: _torque_off,
    OperatorKind.CONFIRM_PATIENT: _confirm_patient,
    OperatorKind.SHUT_DOWN: _shut_down,
    OperatorKind.TAKE_OVER: _take_over,
}
