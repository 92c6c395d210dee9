"""What the operator says and the wearer wants, and which of it is granted."""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from app.control.events.table import blocker
from app.control.freshness import NS_PER_MS, release_in
from app.control.gait import machine as gait_machine
from app.control.gait.machine import Ignored, Latched, Refused, Started
from app.control.inputs import DriveOrder
from app.control.running_action import ActionRequest, RunningAction, command_record, new_report, request
from app.control.state import Tick
from app.ipc.messages import ActionReport, OperatorCommand, OperatorKind
from app.ipc.states import GESTURE_OF, Action, Effect, RequestRefusal, Source
from app.motion.follower import Mode
from logs import records
from logs.reason import Reason, reason

ACT_STALE_MS = 500  # a key pressed longer ago is no wish any more; STOP never grows old


def handle_operator_commands(tick: Tick) -> None:
    """Take the operator's new words in their order."""
    for command in tick.inputs.commands:
        if command.sequence > tick.memory.sequence:
            tick.memory = replace(tick.memory, sequence=command.sequence)
            _WORD[command.kind](tick, command)
    if tick.inputs.must_end:
        _end(tick)


def handle_gesture(tick: Tick) -> None:
    """Take the wearer's release, if this tick's report tells one that still counts."""
    memory = tick.memory
    release = release_in(memory.heard, tick.inputs.report, tick.now_ns)
    if release is None:
        return
    wish = ActionRequest(
        action=release.action,
        source=Source.GESTURE,
        recognised_ns=release.recognised_ns,
        released_ns=release.captured_ns,
    )
    if release.captured_ns < memory.armed_ns:
        refuse(tick, wish, reason(RequestRefusal.RELEASED_BEFORE_ARMING))
    else:
        tick.wishes.append(wish)  # one that nobody armed is refused by its event


def uncleared(tick: Tick) -> bool:
    """Whether a wish of this tick needs a pre-flight that it has not passed; ending a walk never does."""
    cleared = tick.inputs.cleared
    return cleared is not None and any(
        wish.action not in cleared and wish.action is not Action.WALK_END for wish in tick.wishes
    )


def arbitrate(tick: Tick) -> None:
    """Ask the gait machine for each wish, unless an event in force refuses it."""
    for wish in tick.wishes:
        answer = gait_machine.ask(tick.memory.gait, wish.action)
        if isinstance(answer, Ignored):
            _ignore(tick, wish, answer.reason)
        elif forbidden := _forbidden(tick, wish):
            refuse(tick, wish, forbidden)
        elif isinstance(answer, Refused):
            refuse(tick, wish, answer.reason)
        elif isinstance(answer, Latched):
            _latch(tick, wish, answer)
        else:
            _begin(tick, wish, answer)


def refuse(tick: Tick, wish: ActionRequest, why: Reason, number: int = 0) -> None:
    """Tell the operator and the trail why a wish is not granted."""
    memory = tick.memory
    tick.memory = replace(memory, refusal=why, refusal_count=memory.refusal_count + 1)
    _record_refusal(tick, wish, why, number)


def _ignore(tick: Tick, wish: ActionRequest, why: Reason) -> None:
    tick.memory = replace(tick.memory, ignored_count=tick.memory.ignored_count + 1)
    _record_refusal(tick, wish, why, 0)


def _record_refusal(tick: Tick, wish: ActionRequest, why: Reason, number: int) -> None:
    by_gesture = wish.source is Source.GESTURE
    tick.audit.append(
        records.Refusal(
            reason=why,
            source=wish.source.value,
            state=tick.memory.gait.state.value,
            action=wish.action.value,
            gesture=GESTURE_OF[wish.action].value if by_gesture else None,
            number=number,
        )
    )


def _forbidden(tick: Tick, wish: ActionRequest) -> Reason | None:
    """Why the wish can't be granted whatever the gait table says; None when it can."""
    event = blocker(tick.memory.active, wish.source)
    if event is not None:
        return event.reason
    if tick.memory.gait.running is None and not tick.memory.motion.settled:
        return reason(RequestRefusal.COMING_TO_REST)
    return None


def _latch(tick: Tick, wish: ActionRequest, answer: Latched) -> None:
    task = tick.memory.task
    assert task is not None
    report = _accept(tick, wish)
    tick.memory = replace(tick.memory, gait=answer.gait, task=replace(task, ending=report))


def _begin(tick: Tick, wish: ActionRequest, answer: Started) -> None:
    report = _accept(tick, wish)
    number = tick.memory.plan_number + 1
    measured_rad = tick.inputs.feedback.position_rad
    tick.requests.append(request(number, wish.action, answer.gait.phase, report.from_state, measured_rad))
    task = RunningAction(
        report=report,
        asked_ns=tick.now_ns,
        awaited=frozenset({number}),
        before=tick.memory.motion.command,
        start_rad=measured_rad,
    )
    tick.reach(answer.gait)
    tick.memory = replace(tick.memory, task=task, plan_number=number)


def _accept(tick: Tick, wish: ActionRequest) -> ActionReport:
    number = tick.memory.number + 1
    report = new_report(wish, number, tick.memory.gait.state, tick.now_ns)
    tick.memory = replace(tick.memory, number=number)
    tick.audit.append(command_record(report))
    return report


# --- the operator's words -----------------------------------------------------------------------------------------


def _alive(_tick: Tick, _: OperatorCommand) -> None:
    """Heard already: `freshness` keeps its time."""


def _stop(tick: Tick, command: OperatorCommand) -> None:
    presses = tick.memory.stop_presses + 1
    tick.memory = replace(
        tick.memory, stop_presses=presses, stop_ns=command.sent_ns, stop_seen_ns=tick.now_ns, stop_command_ns=0
    )
    tick.audit.append(
        records.Stop(
            state=tick.memory.gait.state.value,
            effect=(Effect.HOLD if presses == 1 else Effect.DAMP).name.lower(),
            sent_ns=command.sent_ns,
            seen_ns=tick.now_ns,
            command_ns=tick.now_ns,
        )
    )


def _acknowledge(tick: Tick, command: OperatorCommand) -> None:
    """It covers what was in force when it was sent: a STOP on its heels stays."""
    waiting = [one for one in tick.memory.active if one.latched and one.since_ns < command.sent_ns]
    tick.acknowledged_ns = command.sent_ns
    if tick.memory.stop_ns < command.sent_ns:
        tick.memory = replace(tick.memory, stop_presses=0)
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
    tick.memory = replace(tick.memory, armed_ns=tick.now_ns)
    tick.audit.append(records.Arming(armed=True))


def _disarm(tick: Tick, _: OperatorCommand) -> None:
    tick.memory = replace(tick.memory, armed_ns=0)
    tick.audit.append(records.Arming(armed=False))


def _confirm_patient(tick: Tick, _: OperatorCommand) -> None:
    tick.memory = replace(tick.memory, patient_confirmed=True)
    tick.audit.append(records.PatientConfirmed(patient=tick.settings.patient))


def _act(tick: Tick, command: OperatorCommand) -> None:
    if command.action is None:
        return
    wish = ActionRequest(action=command.action, source=Source.THERAPIST)
    if tick.now_ns - command.sent_ns > ACT_STALE_MS * NS_PER_MS:
        refuse(tick, wish, reason(RequestRefusal.KEY_EXPIRED))
    else:
        tick.wishes.append(wish)


def _torque_off(tick: Tick, _: OperatorCommand) -> None:
    """The joints are switched off when they have given way (see `step`), never out of stiffness."""
    if tick.memory.motion.mode is Mode.DAMPED:
        tick.memory = replace(tick.memory, torque_off=True)
    elif tick.memory.motion.mode is Mode.DISABLED:
        tick.drives = DriveOrder.DISABLE
    else:
        tick.memory = replace(
            tick.memory,
            refusal=reason(RequestRefusal.TORQUE_OFF_NEEDS_DAMPING),
            refusal_count=tick.memory.refusal_count + 1,
        )


def _shut_down(tick: Tick, _: OperatorCommand) -> None:
    _end(tick)


def _end(tick: Tick) -> None:
    if not tick.memory.ending_ns:
        tick.memory = replace(tick.memory, ending_ns=tick.now_ns)


_WORD: dict[OperatorKind, Callable[[Tick, OperatorCommand], None]] = {
    OperatorKind.ALIVE: _alive,
    OperatorKind.STOP: _stop,
    OperatorKind.ACKNOWLEDGE: _acknowledge,
    OperatorKind.ARM: _arm,
    OperatorKind.DISARM: _disarm,
    OperatorKind.ACT: _act,
    OperatorKind.TORQUE_OFF: _torque_off,
    OperatorKind.CONFIRM_PATIENT: _confirm_patient,
    OperatorKind.SHUT_DOWN: _shut_down,
}
