"""The status line on top, the line of a guided test, the session's dose, and the list of events."""

from __future__ import annotations

from textual.message import Message

from app.console.guidance import legs_of, slack
from app.console.state import SessionState
from app.console.widgets.health import health_dot
from app.console.widgets.panel import Line, Lines, Part, StatePanel, bar, cells, fitted, padded, plain
from app.ipc.snapshot import ActiveEvent, ControlSnapshot, PauseSummary
from app.ipc.states import Effect
from app.outcomes.guided import GuidedRun
from app.text.catalogue import render, tr
from app.voice.signals import VoiceState

PAUSE_SHOWN_NS = 10_000_000_000
EFFECT_MARKS = {Effect.NOTE: "i", Effect.REFUSE: "-", Effect.PAUSE: "~", Effect.HOLD: "!", Effect.DAMP: "‼"}
EFFECT_STYLES = {
    Effect.NOTE: "$foreground-muted",
    Effect.REFUSE: "$warning",
    Effect.PAUSE: "$warning",
    Effect.HOLD: "bold $error",
    Effect.DAMP: "bold reverse $error",
}


def status_line(state: SessionState, width: int, health_key: str) -> Lines:
    """One line: what is needed most is kept longest where there is little room; health stands at its end."""
    snapshot, config = state.snapshot, state.setup.config
    dot, key = health_dot(state), f"{health_key} "
    kept = {name: part for name, part in _status_parts(state, snapshot) if part[0]}
    kind = config.joints.kind if not config.joints.host else "host"
    place = f"{tr(f'camera.{config.camera.kind}')} · {tr(f'joints.{kind}')}"
    kept["place"] = (f" {place} ", "$foreground-muted")
    kept["joints"] = (f" {tr(f'joints.{kind}')} ", "$foreground-muted")
    kept["joints_short"] = (f" {tr(f'joints_short.{kind}')} ", "$foreground-muted")
    if not state.has_stop_inputs:
        wording = tr("status.no_stop_input" if width >= _WIDE_CELLS else "status.no_stop_input_short")
        kept["button"] = (f" {wording} ", "$warning")
    if state.voice is not None:
        listening = state.voice is VoiceState.LISTENING
        wording = tr("status.voice" if listening else "status.no_voice")
        kept["voice"] = (f" {wording} ", "$success" if listening else "$warning")
    room, chosen = width - cells(dot[0] + key), set[str]()
    for name in _NEEDED:
        if name in kept and cells(kept[name][0]) <= room and chosen.isdisjoint(_INCLUDED_IN.get(name, ())):
            chosen.add(name)
            room -= cells(kept[name][0])
    line = [kept[name] for name in _ORDER if name in chosen]
    return ((*line, (" " * room, ""), dot, (key, "bold $accent")) if room >= 0 else tuple(line),)


# What the line holds, from left to right, and in the order in which it is given room.
_ORDER = (
    *("patient", "operator", "place", "joints", "joints_short"),
    *("arming", "pictures", "state", "effect", "silent", "button", "voice", "stop", "steps"),
)
_NEEDED = (
    *("silent", "effect", "arming", "pictures", "button", "voice", "patient", "state"),
    *("place", "joints", "joints_short", "steps", "stop", "operator"),
)
_INCLUDED_IN = {"joints": {"place"}, "joints_short": {"place", "joints"}}  # the same in more words
_WIDE_CELLS = 120  # from here on a missing stop button is told in full


def _status_parts(state: SessionState, snapshot: ControlSnapshot | None) -> list[tuple[str, Part]]:
    setup = state.setup
    parts: list[tuple[str, Part]] = [
        ("patient", (f" {setup.profile.identifier} ", "bold reverse $primary")),
        ("operator", (f" {setup.operator} " if setup.operator else "", "$foreground-muted")),
    ]
    if state.report is not None and state.report.pictures_recorded:
        parts.append(("pictures", (f" ● {tr('status.pictures')} ", "bold $error")))
    if snapshot is None:
        return [*parts, ("arming", (f" {tr('status.starting')} ", "$foreground-muted"))]
    parts += [
        ("arming", _arming(snapshot, fresh=state.snapshot_fresh)),
        ("state", (f" {tr(snapshot.state)} ", "bold")),
        ("steps", (f" {tr('health.steps')} {snapshot.steps}/{setup.profile.dose.steps} ", "")),
    ]
    if snapshot.effect >= Effect.HOLD or slack(snapshot):
        parts.append(("effect", (f" {tr(f'legs.{legs_of(snapshot)}').upper()} ", EFFECT_STYLES[Effect.DAMP])))
    if not state.snapshot_fresh:
        parts.append(("silent", (f" {tr('status.silent')} ", EFFECT_STYLES[Effect.DAMP])))
    if snapshot.stop_received_ns and snapshot.stop_command_ns:
        took_ms = (snapshot.stop_command_ns - snapshot.stop_received_ns) / 1e6
        parts.append(("stop", (f" {tr('status.stop_took', ms=f'{took_ms:.0f}')} ", "$foreground-muted")))
    return parts


def _arming(snapshot: ControlSnapshot, *, fresh: bool) -> Part:
    """Armed gestures stay armed through a STOP or a fault, but none acts until it is over or acknowledged."""
    if not snapshot.armed:
        return f" {tr('status.not_armed')} ", "reverse $warning"
    if snapshot.effect >= Effect.REFUSE or not fresh:
        return f" {tr('status.waits')} ", "reverse $warning"
    return f" {tr('status.armed')} ", "bold reverse $success"


def guided_line(run: GuidedRun, key: str, width: int) -> Lines:
    """The guided test that runs, what matters most first; a part that does not fit is left out whole."""
    parts = [(f" {tr(run.test)} ", "bold reverse $accent")]
    if run.began_ns:
        parts.append((f" {_minutes(run.duration_s)} ", "bold"))
        parts += [(f" {left} ", "bold $primary") for left in _left(run)]
    else:
        parts.append((f" {tr('guided.waits')} ", "bold $primary"))
    parts.append((f" {run.distance_m:.1f} m ", ""))
    parts.append((f" {tr('guided.steps', steps=run.steps)} ", ""))
    parts.append((f" {tr('guided.key', key=key)} ", "$foreground-muted"))
    return (fitted(parts, width),)


def _left(run: GuidedRun) -> list[str]:
    if run.remaining_m:
        return [tr("guided.left_m", left_m=run.remaining_m)]
    if run.procedure.until_seated:
        return [tr("guided.sit")]
    return [] if run.remaining_s is None else [tr("guided.left_s", left=_minutes(run.remaining_s))]


def event_lines(state: SessionState) -> Lines:
    """The link's fault, one line an event, then the newest refusal."""
    fault: Lines = ()
    if state.link is not None and state.link.fault is not None:
        fault = (plain(render(state.link.fault), "bold $error"),)
    if state.snapshot is None:
        return fault
    lines = tuple(_line(event, state.now_ns) for event in state.events)
    if not state.snapshot_fresh:
        return (*(fault or (plain(tr("events.silent"), "bold $error"),)), *lines)
    lines = (*fault, *lines)
    if state.snapshot.refusal:
        lines = (*lines, plain(tr("events.refused", reason=render(state.snapshot.refusal)), "$warning"))
    return (*lines, *_pause(state.snapshot.pauses, state.now_ns))


def _pause(pauses: PauseSummary, now_ns: int) -> Lines:
    """The newest pause, for a while: nothing has to be done about it."""
    if pauses.cause is None or not pauses.resumed or now_ns - pauses.ended_ns > PAUSE_SHOWN_NS:
        return ()
    return (plain(tr("events.paused", duration_s=pauses.duration_s, cause=pauses.cause), "$foreground-muted"),)


def _line(event: ActiveEvent, now_ns: int) -> Line:
    settled = event.acknowledged and not event.present  # what is still there still acts, seen or not
    style = "$foreground-muted" if settled else EFFECT_STYLES[event.effect]
    observed = "✓" if settled else EFFECT_MARKS[event.effect]
    gone = "" if event.present else tr("events.gone")
    age = f"{max(0, now_ns - event.since_ns) // 1_000_000_000} s"
    return (
        (f"{observed} {tr(event.effect)} ", style),
        (render(event.reason), ""),
        (f" {gone}{age}", "$foreground-muted"),
    )


class EventsPanel(StatePanel):
    """As high as it has something to tell; a click asks for the acknowledgement."""

    class Clicked(Message):
        """The list was clicked."""

    def show(self, state: SessionState) -> None:
        """Draw the newest snapshot."""
        before, self.lines = len(self.lines), event_lines(state)
        self.set_class(not self.lines, "-quiet")
        if len(self.lines) != before:
            self.refresh(layout=True)

    def on_click(self) -> None:
        self.post_message(self.Clicked())


def dose_lines(state: SessionState, width: int) -> Lines:
    """Steps, distance and time against what the session aims at."""
    if state.snapshot is None:
        return (plain(tr("health.waiting"), "$foreground-muted"),)
    dose, snapshot, elapsed_s = state.setup.profile.dose, state.snapshot, state.elapsed_s
    walked_m = snapshot.distance_walked_m
    doses = (
        ("health.steps", snapshot.steps, dose.steps, f"{snapshot.steps}/{dose.steps}"),
        ("health.distance", walked_m, dose.distance_m, f"{walked_m:.1f}/{dose.distance_m:.0f} m"),
        ("health.time", elapsed_s, dose.duration_s, f"{_minutes(elapsed_s)}/{_minutes(dose.duration_s)}"),
    )
    names = max(cells(tr(name)) for name, *_ in doses)
    figures = max(cells(figures) for *_, figures in doses)
    return tuple(
        _dose(padded(tr(name), names), done, target, padded(text, figures), width) for name, done, target, text in doses
    )


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def _dose(name: str, done: float, target: float, figures: str, width: int) -> Line:
    room = max(4, width - cells(name) - cells(figures) - 3)
    share = (bar(done / target if target else 1.0, room), "$primary")
    return fitted([(f" {figures} ", "bold"), (name, ""), (" ", ""), share], width)


class DosePanel(StatePanel):
    """How far the session has come."""

    def show(self, state: SessionState) -> None:
        """Draw the newest state."""
        self.lines = dose_lines(state, self.content_size.width)
