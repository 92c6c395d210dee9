"""Rows of the table of events: the computer, its clocks and the processes beside control."""

from __future__ import annotations

from app.control.diagnostics import Diagnostics, LinkFigure, exceeded_figure, link_values
from app.control.events.row import GESTURES, Above, Compared, Latch, Row
from app.control.inputs import HOST_SUSPENDED_S
from app.control.stop_inputs import READER_LATE_NS
from app.ipc.states import Effect, Event
from app.ipc.streams import AUDIT_HEALTH, GUARDIAN, NS_PER_MS, OPERATOR, TRIGGER

AUDIT_WAITING_LIMIT = 2_000  # records; a tenth of the queue, about ten seconds of a busy session
TICK_LATE_MS = 2.0  # a whole tick
CONTROL_LATE_MS = 20.0
CONTROL_STALLED_MS = 50.0  # docs/safety.md, "How long commands may be missing"
BLIND_WALK_MS = 1_000.0  # a walk goes on for so long although the gesture that ends it could not be seen
CLOCK_STEP_S = 0.5

_FRAME_AGE = Above("frame_age_ms", lambda d: d.programs.frame_age_ms, TRIGGER.stale_ms)
_GUARDIAN_AGE = Above("message_age_ms", lambda d: d.programs.guardian_age_ms, GUARDIAN.stale_ms)
_LATE = Above("late_ms", lambda d: d.clocks.late_ms, TICK_LATE_MS)

E, F, P = Event, Effect, Latch.POWERED
STREAMS = (
    Row(
        E.CAMERA_STALE,
        F.REFUSE,
        lambda d: d.programs.camera_fault is not None or _FRAME_AGE(d),
        compares=_FRAME_AGE.compared,
        detail=lambda d: {"detail": d.programs.camera_fault or ""},
        blocks=GESTURES,
        walk_ends_after_ms=BLIND_WALK_MS,
    ),
    Row(
        E.PERCEPTION_TIMEOUT,
        F.REFUSE,
        lambda d: d.programs.perception_age_ms > d.programs.perception_limit_ms,
        compares=lambda d: Compared("message_age_ms", d.programs.perception_age_ms, d.programs.perception_limit_ms),
        blocks=GESTURES,
        walk_ends_after_ms=BLIND_WALK_MS,
    ),
    Row(
        E.PERCEPTION_STARTING,
        F.REFUSE,
        lambda d: d.programs.perception_starting,
        blocks=GESTURES,
        walk_ends_after_ms=BLIND_WALK_MS,
    ),
    Row(E.CONSOLE_TIMEOUT, F.PAUSE, Above("message_age_ms", lambda d: d.programs.console_age_ms, OPERATOR.stale_ms)),
    Row(
        E.AUDIT_BACKLOG,
        F.REFUSE,
        Above("waiting_records", lambda d: d.programs.audit_waiting, AUDIT_WAITING_LIMIT),
        detail=lambda d: {"count": d.programs.audit_waiting},
    ),
    Row(E.AUDIT_QUEUE_FULL, F.HOLD, lambda d: d.programs.audit_full, P),
    Row(E.AUDIT_TIMEOUT, F.REFUSE, Above("message_age_ms", lambda d: d.programs.audit_age_ms, AUDIT_HEALTH.stale_ms)),
    Row(
        E.AUDIT_WRITE_FAILED,
        F.REFUSE,
        lambda d: d.programs.audit_fault is not None,
        detail=lambda d: {"detail": d.programs.audit_fault or ""},
    ),
)
CLOCKS = (
    Row(
        E.TICK_LATE,
        F.NOTE,
        lambda d: d.clocks.missed_ticks > 0 or _LATE(d),
        compares=_LATE.compared,
        detail=lambda d: {"late_ms": d.clocks.late_ms, "missed": d.clocks.missed_ticks},
    ),
    Row(
        E.CONTROL_LATE,
        F.PAUSE,
        lambda d: CONTROL_LATE_MS < d.clocks.late_ms <= CONTROL_STALLED_MS,
        compares=lambda d: Compared("late_ms", d.clocks.late_ms, CONTROL_LATE_MS),
        detail=lambda d: {"late_ms": d.clocks.late_ms},
    ),
    Row(
        E.CONTROL_STALLED,
        F.HOLD,
        Above("late_ms", lambda d: d.clocks.late_ms, CONTROL_STALLED_MS),
        P,
        lambda d: {"late_ms": d.clocks.late_ms},
    ),
    Row(
        E.STOP_INPUTS_LATE,
        F.PAUSE,
        Above("reader_age_ms", lambda d: d.clocks.reader_age_ms, READER_LATE_NS / NS_PER_MS),
    ),
    Row(
        E.HOST_SUSPENDED,
        F.HOLD,
        Above("slept_s", lambda d: d.clocks.slept_s, HOST_SUSPENDED_S),
        P,
        lambda d: {"duration_s": d.clocks.slept_s},
    ),
    Row(
        E.CLOCK_JUMP,
        F.NOTE,
        Above("step_s", lambda d: abs(d.clocks.step_s), CLOCK_STEP_S),
        detail=lambda d: {"step_s": d.clocks.step_s},
    ),
)


def _poor(d: Diagnostics) -> LinkFigure | None:
    return exceeded_figure(d.programs.link)


def _poor_compared(d: Diagnostics) -> Compared | None:
    figure = _poor(d)
    return None if figure is None else Compared(figure.quantity.value, figure.value, figure.limit)


HELPERS = (
    Row(
        E.GUARDIAN_TIMEOUT,
        F.REFUSE,
        lambda d: _GUARDIAN_AGE(d) or d.programs.guardian_fault is not None,
        compares=_GUARDIAN_AGE.compared,
        detail=lambda d: {"detail": d.programs.guardian_fault or ""},
    ),
    Row(E.GUARDIAN_ACTED, F.DAMP, lambda d: d.programs.guardian_acted, P),
    Row(E.PLANNER_STARTING, F.REFUSE, lambda d: not d.planning.ready),
    Row(E.PLANNER_TIMEOUT, F.NOTE, lambda d: d.planning.timed_out),
    Row(E.NEXT_STEP_MISSING, F.PAUSE, lambda d: d.planning.next_step_missing),
    Row(E.PAUSE_TOO_LONG, F.HOLD, lambda d: d.planning.pause_too_long, P),
    Row(E.MESSAGE_REJECTED, F.NOTE, Above("rejected_messages", lambda d: d.programs.rejected_messages, 0), counts=True),
    Row(
        E.FOREIGN_PEER,
        F.NOTE,
        Above("foreign_peers", lambda d: d.programs.foreign_peers, 0),
        detail=lambda d: {"count": d.programs.foreign_peers},
        counts=True,
    ),
    Row(
        E.LINK_POOR,
        F.REFUSE,
        lambda d: _poor(d) is not None,
        compares=_poor_compared,
        detail=lambda d: link_values(_poor(d)),
        blocks=GESTURES,
    ),
)
