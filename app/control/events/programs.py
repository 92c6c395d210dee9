"""Rows of the table of events: the computer, its clocks and the programs beside control."""

from __future__ import annotations

from app.control.events.row import GESTURES, Event, Latch, Row
from app.ipc.states import Effect
from app.ipc.streams import AUDIT_HEALTH, GUARDIAN, OPERATOR, TRIGGER

AUDIT_WAITING_LIMIT = 2_000  # records; a tenth of the queue, about ten seconds of a busy session
TICK_LATE_MS = 2.0  # a whole tick
TICK_STALLED_MS = 20.0
CLOCK_STEP_S = 0.5
HOST_SLEPT_S = 0.1

E, F = Event, Effect
STREAMS = (
    Row(
        event=E.CAMERA_STALE,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: f.programs.camera_fault != "" or f.programs.picture_age_ms > TRIGGER.stale_ms,
        text="The camera gives no fresh picture: check its cable and light. The therapist's keys still act.",
        detail=lambda f: f.programs.camera_fault,
    ),
    Row(
        event=E.PERCEPTION_GONE,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: f.programs.perception_age_ms > TRIGGER.stale_ms,
        text="Gesture recognition has gone silent; it is started again. The therapist's keys still act.",
    ),
    Row(
        event=E.CONSOLE_SILENT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.programs.console_age_ms > OPERATOR.stale_ms,
        text="The console was silent and STOP could not have been heard: the legs are held.",
    ),
    Row(
        event=E.AUDIT_BEHIND,
        effect=F.REFUSE,
        present=lambda f: f.programs.audit_waiting > AUDIT_WAITING_LIMIT,
        text="The audit trail can't keep up: wait until it has written what is queued.",
        detail=lambda f: f"{f.programs.audit_waiting} records",
    ),
    Row(
        event=E.AUDIT_FULL,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.programs.audit_full,
        text="The audit queue is full, records were lost: the legs are held. End the session.",
    ),
    Row(
        event=E.AUDIT_GONE,
        effect=F.REFUSE,
        present=lambda f: f.programs.audit_age_ms > AUDIT_HEALTH.stale_ms,
        text="Nobody writes the audit trail: no new action without a record. End the session.",
    ),
    Row(
        event=E.AUDIT_FAULT,
        effect=F.REFUSE,
        present=lambda f: f.programs.audit_fault != "",
        text="The audit trail can't be written: free some space on the disk or end the session.",
        detail=lambda f: f.programs.audit_fault,
    ),
)
CLOCKS = (
    Row(
        event=E.TICK_LATE,
        effect=F.NOTE,
        present=lambda f: f.clocks.missed_ticks > 0 or f.clocks.late_ms > TICK_LATE_MS,
        text="Control was late by a tick or more: close other programs if it happens again.",
        detail=lambda f: f"{f.clocks.late_ms:.1f} ms late, {f.clocks.missed_ticks} left out",
    ),
    Row(
        event=E.TICK_STALLED,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.clocks.late_ms > TICK_STALLED_MS,
        text="Control stood still for a moment: the legs are held. Close other programs.",
        detail=lambda f: f"{f.clocks.late_ms:.0f} ms",
    ),
    Row(
        event=E.HOST_SLEPT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.clocks.slept_s > HOST_SLEPT_S,
        text="The computer slept: the legs are held. Switch its sleep off.",
        detail=lambda f: f"{f.clocks.slept_s:.1f} s",
    ),
    Row(
        event=E.CLOCK_JUMP,
        effect=F.NOTE,
        present=lambda f: abs(f.clocks.step_s) > CLOCK_STEP_S,
        text="The wall clock was moved: times in the audit trail step here.",
        detail=lambda f: f"{f.clocks.step_s:+.1f} s",
    ),
)
HELPERS = (
    Row(
        event=E.GUARDIAN_GONE,
        effect=F.REFUSE,
        present=lambda f: f.programs.guardian_age_ms > GUARDIAN.stale_ms or f.programs.guardian_fault != "",
        detail=lambda f: f.programs.guardian_fault,
        text="The guardian is gone, nobody would stop the joints if control died: end the session.",
    ),
    Row(
        event=E.GUARDIAN_ACTED,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.programs.guardian_acted,
        text="Control was silent: the guardian lets the joints give way. Support the wearer; torque off, acknowledge.",
    ),
    Row(
        event=E.PLANNER_STARTING,
        effect=F.REFUSE,
        present=lambda f: not f.planning.ready,
        text="The planner is getting ready: a few seconds yet.",
    ),
    Row(
        event=E.PLANNER_SILENT,
        effect=F.REFUSE,
        latch=Latch.POWERED,
        present=lambda f: f.planning.silent,
        text="The planner did not answer: the action was given up. Acknowledge and try again.",
    ),
    Row(
        event=E.WALK_BROKEN,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.planning.walk_plan_missing,
        text="The next step was not planned in time: the legs are held. Acknowledge, then gesture 0.",
    ),
    Row(
        event=E.MESSAGE_REJECTED,
        effect=F.NOTE,
        present=lambda f: f.programs.rejected_messages > 0,
        text="A message between the programs did not make sense and was left out.",
    ),
)
