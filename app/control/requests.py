"""Action requests, by a gesture or by the therapist: which are timely, and which of them are granted."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from app.control.events.row import Compared
from app.control.events.table import RaisedEvent, blocker, compared_fields
from app.control.gait import machine as gait_machine
from app.control.gait.machine import Answer, Change, Gait, Ignored, Latched, Refused, Started
from app.control.inputs import ActionRequest, new_release
from app.control.running_action import RunningAction, command_record, new_report, plan_request
from app.control.state import Tick
from app.ipc.snapshot import ActionReport
from app.ipc.states import GESTURE_OF, Action, RequestRefusal, Source
from app.ipc.streams import NS_PER_MS, TRIGGER
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import Reason, reason

FUTURE_MS = 50.0  # a capture time farther ahead of now than this is invalid
ACT_STALE_MS = 500  # a key pressed longer ago requests nothing any more; STOP never expires


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
    resting = tick.state.gait.running is None
    return resting and any(request.action in uncleared(tick.inputs.cleared) for request in tick.requests)


def uncleared(cleared: frozenset[Action] | None) -> tuple[Action, ...]:
    """The actions that need a pre-flight and have not passed it. None: the joints need none."""
    if cleared is None:
        return ()
    return tuple(action for action in Action if action not in cleared and action is not Action.WALK_END)


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
