"""Rows of the table of events: what the operator commanded, and what is still missing before motion."""

from __future__ import annotations

from app.control.events.row import GESTURES, Above, Latch, Row
from app.ipc.states import Effect, Event

E, F = Event, Effect
SESSION = (
    Row(E.STOP, F.HOLD, lambda d: d.session.stop_presses == 1, Latch.ALWAYS),
    Row(E.STOP_AGAIN, F.DAMP, Above("stop_presses", lambda d: d.session.stop_presses, 1), Latch.ALWAYS),
    Row(E.SHUTTING_DOWN, F.HOLD, lambda d: d.session.ending and not d.session.ending_damped),
    Row(E.SHUTDOWN_DAMPING, F.DAMP, lambda d: d.session.ending_damped),
    Row(E.NOT_ARMED, F.REFUSE, lambda d: not d.session.armed, blocks=GESTURES),
    Row(E.NO_PATIENT, F.REFUSE, lambda d: not d.session.patient_confirmed),
    Row(E.NO_PREFLIGHT, F.REFUSE, lambda d: d.session.lacks_preflight),
)
