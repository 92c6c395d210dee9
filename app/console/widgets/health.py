"""How well the chain runs, and how far the session is against its dose."""

from __future__ import annotations

from app.console.state import SessionState
from app.console.widgets.panel import Line, Lines, StatePanel, bar, cells, plain
from app.text.catalogue import tr


def describe(state: SessionState, width: int) -> Lines:
    """Dose against target, then latency, pictures and lateness."""
    if state.snapshot is None:
        return (plain(tr("health.waiting"), "$text-muted"),)
    dose, snapshot = state.setup.profile.dose, state.snapshot
    return (
        _dose(tr("health.steps"), snapshot.steps, dose.steps, f"{snapshot.steps}/{dose.steps}", width),
        _dose(
            tr("health.distance"),
            snapshot.distance_walked_m,
            dose.distance_m,
            f"{snapshot.distance_walked_m:.1f}/{dose.distance_m:.0f} m",
            width,
        ),
        _dose(
            tr("health.time"),
            state.elapsed_s,
            dose.duration_s,
            f"{_minutes(state.elapsed_s)}/{_minutes(dose.duration_s)}",
            width,
        ),
        _chain(state),
        _ticks(state),
    )


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def _dose(name: str, done: float, target: float, figures: str, width: int) -> Line:
    room = max(4, min(24, width - cells(name) - cells(figures) - 3))
    return ((f"{name} ", ""), (bar(done / target if target else 1.0, room), "$primary"), (f" {figures}", "bold"))


def _chain(state: SessionState) -> Line:
    report, snapshot = state.report, state.snapshot
    fps = f"{report.fps:.0f}" if report is not None and state.report_fresh else "–"
    age = f"{snapshot.report_age_ms:.0f}" if snapshot is not None else "–"
    return plain(tr("health.chain", fps=fps, age=age))


def _ticks(state: SessionState) -> Line:
    assert state.snapshot is not None
    late, real_time = state.snapshot.lateness, state.snapshot.real_time
    words = tr("health.ticks", p99=f"{late.p99_ms:.2f}", worst=f"{late.max_ms:.1f}", missed=late.missed)
    privilege = "" if real_time.fifo else f" {tr('health.no_fifo')}"
    return ((words, "$warning" if late.missed else ""), (privilege, "$warning"))


class HealthPanel(StatePanel):
    """Dose and health of the chain."""

    def show(self, state: SessionState) -> None:
        """Draw the newest state."""
        self.show_lines(describe(state, self.content_size.width))
