"""Rows of the table of events: what the operator commanded, and what is still missing before motion."""

from __future__ import annotations

from collections.abc import Callable

from app.control.diagnostics import Diagnostics
from app.control.events.row import GESTURES, Above, Latch, Row
from app.control.joint_diagnostics import FOLLOWING_WARN_RAD
from app.ipc.states import Effect, Event
from hal.inputs.device import InputRole
from logs.reason import Value, reason_of


def _opened(role: InputRole) -> Callable[[Diagnostics], bool]:
    return lambda d: any(one.open and one.role is role for one in d.stop_inputs)


def _which(role: InputRole) -> Callable[[Diagnostics], dict[str, Value]]:
    """The first input of the role that stops, and what is known of its silence."""

    def values(d: Diagnostics) -> dict[str, Value]:
        one = next(one for one in d.stop_inputs if one.open and one.role is role)
        return {"input": one.name, "detail": "" if one.fault is None else reason_of(one.fault)}

    return values


def _stops(event: Event, role: InputRole) -> Row:
    """As STOP. Bouncing and a second press stay a hold: neither a broken wire nor a reflex may drop the wearer."""
    return Row(event, Effect.HOLD, _opened(role), Latch.ALWAYS, _which(role), acknowledged_when_gone=True)


def _unpressed(d: Diagnostics) -> dict[str, Value]:
    return {"input": next((one.name for one in d.stop_inputs if not one.pressed_once), "")}


def _sank(d: Diagnostics) -> bool:
    """The drives' supply is cut: whoever gives it back must not find stiff joints with a target far away."""
    return d.joints.following_rad > FOLLOWING_WARN_RAD and _opened(InputRole.EMERGENCY_STOP)(d)


E, F = Event, Effect
SESSION = (
    Row(E.STOP, F.HOLD, lambda d: d.session.stop_presses == 1, Latch.ALWAYS),
    Row(E.STOP_AGAIN, F.DAMP, Above("stop_presses", lambda d: d.session.stop_presses, 1), Latch.ALWAYS),
    Row(E.VOICE_STOP, F.HOLD, lambda d: d.session.voice_stopped, Latch.ALWAYS),
    _stops(E.HARDWIRED_STOP, InputRole.EMERGENCY_STOP),
    _stops(E.WEARER_STOP, InputRole.WEARER),
    _stops(E.THERAPIST_STOP, InputRole.THERAPIST),
    Row(E.HARDWIRED_STOP_SANK, F.DAMP, _sank, Latch.ALWAYS),
    Row(E.SHUTTING_DOWN, F.HOLD, lambda d: d.session.ending and not d.session.ending_damped),
    Row(E.SHUTDOWN_DAMPING, F.DAMP, lambda d: d.session.ending_damped),
    Row(E.NOT_ARMED, F.REFUSE, lambda d: not d.session.armed, blocks=GESTURES),
    Row(E.NO_PATIENT, F.REFUSE, lambda d: not d.session.patient_confirmed),
    Row(
        E.STOP_INPUT_UNPRESSED,
        F.REFUSE,
        lambda d: any(not one.pressed_once for one in d.stop_inputs),
        detail=_unpressed,
    ),
    Row(E.NO_PREFLIGHT, F.REFUSE, lambda d: d.session.lacks_preflight),
)
