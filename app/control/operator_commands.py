"""Operator commands: which console's count, and what each of them does."""

from __future__ import annotations

from collections.abc import Callable

from app.control.diagnostics import exceeded_figure, link_figures, link_values
from app.control.events.table import acknowledges
from app.control.inputs import ActionRequest, DriveOrder
from app.control.requests import refuse, untimely_key
from app.control.state import Tick
from app.ipc.messages import STOP_KINDS, OperatorCommand, OperatorKind
from app.ipc.states import ConsoleChange, Effect, Event, RequestRefusal, Source, StopSource
from app.motion.follower import Mode
from logs import records
from logs.reason import Reason, reason


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
    """The joints are switched off when they are fully damped (see `disable_drives`), never while stiff."""
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
