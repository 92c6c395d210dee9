"""Rows of the table of events: what the operator says, and what has not been said or shown yet."""

from __future__ import annotations

from app.control.events.row import GESTURES, Latch, Row
from app.ipc.states import Effect, Event

E, F = Event, Effect
SESSION = (
    Row(
        event=E.STOP,
        effect=F.HOLD,
        latch=Latch.ALWAYS,
        present=lambda f: f.session.stop_presses == 1,
    ),
    Row(
        event=E.STOP_AGAIN,
        effect=F.DAMP,
        latch=Latch.ALWAYS,
        present=lambda f: f.session.stop_presses > 1,
    ),
    Row(
        event=E.SHUTTING_DOWN,
        effect=F.HOLD,
        present=lambda f: f.session.ending and not f.session.ending_slack,
    ),
    Row(
        event=E.SHUTDOWN_DAMPING,
        effect=F.DAMP,
        present=lambda f: f.session.ending_slack,
    ),
    Row(
        event=E.NOT_ARMED,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: not f.session.armed,
    ),
    Row(
        event=E.NO_PATIENT,
        effect=F.REFUSE,
        present=lambda f: not f.session.patient_confirmed,
    ),
    Row(
        event=E.NO_PREFLIGHT,
        effect=F.REFUSE,
        present=lambda f: f.session.uncleared,
    ),
)
