"""Rows of the table of events: what the operator says, and what has not been said or shown yet."""

from __future__ import annotations

from app.control.events.row import GESTURES, Event, Latch, Row
from app.ipc.states import Effect

E, F = Event, Effect
SESSION = (
    Row(
        event=E.STOP,
        effect=F.HOLD,
        latch=Latch.ALWAYS,
        present=lambda f: f.session.stop_presses == 1,
        text="STOP: the legs are held. Look at the wearer, then acknowledge.",
    ),
    Row(
        event=E.STOP_AGAIN,
        effect=F.DAMP,
        latch=Latch.ALWAYS,
        present=lambda f: f.session.stop_presses > 1,
        text="STOP twice: the joints give way slowly. Support the wearer; then torque off or acknowledge.",
    ),
    Row(
        event=E.SHUTTING_DOWN,
        effect=F.HOLD,
        present=lambda f: f.session.ending and not f.session.ending_slack,
        text="The session ends: the legs are held, then the joints give way slowly and are switched off.",
    ),
    Row(
        event=E.GIVING_WAY,
        effect=F.DAMP,
        present=lambda f: f.session.ending_slack,
        text="The session ends: the joints give way slowly and are switched off.",
    ),
    Row(
        event=E.NOT_ARMED,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: not f.session.armed,
        text="Gestures are not armed: arm them when the wearer is ready.",
    ),
    Row(
        event=E.NO_PATIENT,
        effect=F.REFUSE,
        present=lambda f: not f.session.patient_confirmed,
        text="No patient is confirmed: check who wears the device, then confirm.",
    ),
    Row(
        event=E.NO_PREFLIGHT,
        effect=F.REFUSE,
        present=lambda f: f.session.uncleared,
        text="No passed pre-flight of this action with this profile: run `rleex simulate all --preflight`.",
    ),
)
