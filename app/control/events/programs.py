"""Rows of the table of events: the computer, its clocks and the programs beside control."""

from __future__ import annotations

from app.control.events.row import GESTURES, Latch, Row
from app.ipc.states import Effect, Event
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
        present=lambda f: f.programs.camera_fault is not None or f.programs.picture_age_ms > TRIGGER.stale_ms,
        detail=lambda f: {"detail": f.programs.camera_fault or ""},
    ),
    Row(
        event=E.PERCEPTION_TIMEOUT,
        effect=F.REFUSE,
        blocks=GESTURES,
        present=lambda f: f.programs.perception_age_ms > TRIGGER.stale_ms,
    ),
    Row(
        event=E.CONSOLE_TIMEOUT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.programs.console_age_ms > OPERATOR.stale_ms,
    ),
    Row(
        event=E.AUDIT_BACKLOG,
        effect=F.REFUSE,
        present=lambda f: f.programs.audit_waiting > AUDIT_WAITING_LIMIT,
        detail=lambda f: {"count": f.programs.audit_waiting},
    ),
    Row(
        event=E.AUDIT_QUEUE_FULL,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.programs.audit_full,
    ),
    Row(
        event=E.AUDIT_TIMEOUT,
        effect=F.REFUSE,
        present=lambda f: f.programs.audit_age_ms > AUDIT_HEALTH.stale_ms,
    ),
    Row(
        event=E.AUDIT_WRITE_FAILED,
        effect=F.REFUSE,
        present=lambda f: f.programs.audit_fault is not None,
        detail=lambda f: {"detail": f.programs.audit_fault or ""},
    ),
)
CLOCKS = (
    Row(
        event=E.TICK_LATE,
        effect=F.NOTE,
        present=lambda f: f.clocks.missed_ticks > 0 or f.clocks.late_ms > TICK_LATE_MS,
        detail=lambda f: {"late_ms": f.clocks.late_ms, "missed": f.clocks.missed_ticks},
    ),
    Row(
        event=E.CONTROL_STALLED,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.clocks.late_ms > TICK_STALLED_MS,
        detail=lambda f: {"late_ms": f.clocks.late_ms},
    ),
    Row(
        event=E.HOST_SUSPENDED,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.clocks.slept_s > HOST_SLEPT_S,
        detail=lambda f: {"duration_s": f.clocks.slept_s},
    ),
    Row(
        event=E.CLOCK_JUMP,
        effect=F.NOTE,
        present=lambda f: abs(f.clocks.step_s) > CLOCK_STEP_S,
        detail=lambda f: {"step_s": f.clocks.step_s},
    ),
)
HELPERS = (
    Row(
        event=E.GUARDIAN_TIMEOUT,
        effect=F.REFUSE,
        present=lambda f: f.programs.guardian_age_ms > GUARDIAN.stale_ms or f.programs.guardian_fault is not None,
        detail=lambda f: {"detail": f.programs.guardian_fault or ""},
    ),
    Row(
        event=E.GUARDIAN_ACTED,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.programs.guardian_acted,
    ),
    Row(
        event=E.PLANNER_STARTING,
        effect=F.REFUSE,
        present=lambda f: not f.planning.ready,
    ),
    Row(
        event=E.PLANNER_TIMEOUT,
        effect=F.REFUSE,
        latch=Latch.POWERED,
        present=lambda f: f.planning.silent,
    ),
    Row(
        event=E.NEXT_STEP_MISSING,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.planning.walk_plan_missing,
    ),
    Row(
        event=E.MESSAGE_REJECTED,
        effect=F.NOTE,
        present=lambda f: f.programs.rejected_messages > 0,
    ),
)
