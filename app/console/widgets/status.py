"""The status line on top, the dose and health panel, and the list of events."""

from __future__ import annotations

from textual.message import Message

from app.console.state import SessionState
from app.console.widgets.panel import Line, Lines, Part, StatePanel, bar, cells, padded, plain
from app.ipc.messages import ActiveEvent, ControlSnapshot, PauseSummary
from app.ipc.states import Effect
from app.text.catalogue import render, tr

PAUSE_SHOWN_NS = 10_000_000_000
EFFECT_MARKS = {Effect.NOTE: "i", Effect.REFUSE: "-", Effect.PAUSE: "~", Effect.HOLD: "!", Effect.DAMP: "‼"}
EFFECT_STYLES = {
    Effect.NOTE: "$text-muted",
    Effect.REFUSE: "$warning",
    Effect.PAUSE: "$warning",
    Effect.HOLD: "bold $error",
    Effect.DAMP: "bold reverse $error",
}


def status_line(state: SessionState) -> Lines:
    """One line."""
    snapshot, config = state.snapshot, state.setup.config
    operator = (f" {state.setup.operator} ", "$text-muted")
    parts = [
        (f" {state.setup.profile.identifier} ", "bold reverse $primary"),
        *((operator,) if state.setup.operator else ()),
        (f" {tr(f'camera.{config.camera.kind}')} · {tr(f'joints.{config.joints.kind}')} ", "$text-muted"),
    ]
    if snapshot is None:
        return ((*parts, (tr("status.starting"), "$text-muted")),)
    parts.append(_arming(snapshot, fresh=state.snapshot_fresh))
    parts.append((f" {tr(snapshot.state)} ", "bold"))
    if snapshot.effect >= Effect.HOLD:
        parts.append((f" {tr(snapshot.effect).upper()} ", EFFECT_STYLES[Effect.DAMP]))
    if not state.snapshot_fresh:
        parts.append((f" {tr('status.silent')} ", EFFECT_STYLES[Effect.DAMP]))
    if snapshot.stop_received_ns and snapshot.stop_command_ns:
        took_ms = (snapshot.stop_command_ns - snapshot.stop_received_ns) / 1e6
        parts.append((f" {tr('status.stop_took', ms=f'{took_ms:.0f}')}", "$text-muted"))
    return (tuple(parts),)


def _arming(snapshot: ControlSnapshot, *, fresh: bool) -> Part:
    """Armed gestures stay armed through a STOP or a fault, but none acts until it is over or acknowledged."""
    if not snapshot.armed:
        return f" {tr('status.not_armed')} ", "reverse $warning"
    if snapshot.effect >= Effect.REFUSE or not fresh:
        return f" {tr('status.waits')} ", "reverse $warning"
    return f" {tr('status.armed')} ", "bold reverse $success"


def event_lines(state: SessionState) -> Lines:
    """One line an event, then the newest refusal."""
    if state.snapshot is None:
        return (plain(tr("events.waiting"), "$text-muted"),)
    if not state.snapshot_fresh:
        return (plain(tr("events.silent"), "bold $error"), *(_line(event, state.now_ns) for event in state.events))
    lines = tuple(_line(event, state.now_ns) for event in state.events)
    if state.snapshot.refusal:
        lines = (*lines, plain(tr("events.refused", reason=render(state.snapshot.refusal)), "$warning"))
    lines = (*lines, *_pause(state.snapshot.pauses, state.now_ns))
    return lines or (plain(tr("events.none"), "$text-muted"),)


def _pause(pauses: PauseSummary, now_ns: int) -> Lines:
    """The newest pause, for a while: nothing has to be done about it."""
    if pauses.cause is None or not pauses.resumed or now_ns - pauses.ended_ns > PAUSE_SHOWN_NS:
        return ()
    return (plain(tr("events.paused", duration_s=pauses.duration_s, cause=pauses.cause), "$text-muted"),)


def _line(event: ActiveEvent, now_ns: int) -> Line:
    settled = event.acknowledged and not event.present  # what is still there still acts, seen or not
    style = "$text-muted" if settled else EFFECT_STYLES[event.effect]
    observed = "✓" if settled else EFFECT_MARKS[event.effect]
    gone = "" if event.present else tr("events.gone")
    age = f"{max(0, now_ns - event.since_ns) // 1_000_000_000} s"
    return (
        (f"{observed} {tr(event.effect)} ", style),
        (render(event.reason), ""),
        (f" {gone}{age}", "$text-muted"),
    )


class EventsPanel(StatePanel):
    """A click asks for the acknowledgement."""

    class Clicked(Message):
        """The list was clicked."""

    def show(self, state: SessionState) -> None:
        """Draw the newest snapshot."""
        self.lines = event_lines(state)

    def on_click(self) -> None:
        self.post_message(self.Clicked())


def health_lines(state: SessionState, width: int) -> Lines:
    """Dose against target, then latency, frame rate and lateness."""
    if state.snapshot is None:
        return (plain(tr("health.waiting"), "$text-muted"),)
    dose, snapshot, elapsed_s = state.setup.profile.dose, state.snapshot, state.elapsed_s
    walked_m = snapshot.distance_walked_m
    doses = (
        ("health.steps", snapshot.steps, dose.steps, f"{snapshot.steps}/{dose.steps}"),
        ("health.distance", walked_m, dose.distance_m, f"{walked_m:.1f}/{dose.distance_m:.0f} m"),
        ("health.time", elapsed_s, dose.duration_s, f"{_minutes(elapsed_s)}/{_minutes(dose.duration_s)}"),
    )
    name_width = max(cells(tr(name)) for name, *_ in doses)
    lines = (_dose(padded(tr(name), name_width), done, target, figures, width) for name, done, target, figures in doses)
    return (*lines, _chain(state), _ticks(state))


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
    text = tr("health.ticks", p99=f"{late.p99_ms:.2f}", worst=f"{late.max_ms:.1f}", missed=late.missed)
    privilege = "" if real_time.fifo else f" {tr('health.no_fifo')}"
    return ((text, "$warning" if late.missed else ""), (privilege, "$warning"))


class HealthPanel(StatePanel):
    """Dose and health of the chain."""

    def show(self, state: SessionState) -> None:
        """Draw the newest state."""
        self.lines = health_lines(state, self.content_size.width)
