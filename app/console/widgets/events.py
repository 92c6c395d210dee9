"""Events in force: unacknowledged ones on top, each with what it does and what to do."""

from __future__ import annotations

from textual.message import Message

from app.console.sentences import sentence
from app.console.state import SessionState
from app.console.terms import EFFECT_MARKS, EFFECT_STYLES, effect_name, event_text
from app.console.widgets.panel import Line, Lines, StatePanel, plain
from app.ipc.messages import ActiveEvent
from app.text.catalogue import tr


def describe(state: SessionState) -> Lines:
    """One line an event, then the newest refusal."""
    if state.snapshot is None:
        return (plain(tr("events.waiting"), "$text-muted"),)
    if not state.snapshot_fresh:
        return (plain(tr("events.silent"), "bold $error"), *(_line(event, state.now_ns) for event in state.events))
    lines = tuple(_line(event, state.now_ns) for event in state.events)
    if state.snapshot.refusal:
        lines = (*lines, plain(tr("events.refused", reason=sentence(state.snapshot.refusal)), "$warning"))
    return lines or (plain(tr("events.none"), "$text-muted"),)


def _line(event: ActiveEvent, now_ns: int) -> Line:
    settled = event.acknowledged and not event.present  # what is still there still acts, seen or not
    style = "$text-muted" if settled else EFFECT_STYLES[event.effect]
    seen = "✓" if settled else EFFECT_MARKS[event.effect]
    gone = "" if event.present else tr("events.gone")
    age = f"{max(0, now_ns - event.since_ns) // 1_000_000_000} s"
    return ((f"{seen} {effect_name(event.effect)} ", style), (event_text(event), ""), (f" {gone}{age}", "$text-muted"))


class EventsPanel(StatePanel):
    """A click asks for the acknowledgement."""

    class Clicked(Message):
        """The list was clicked."""

    def show(self, state: SessionState) -> None:
        """Draw the newest snapshot."""
        self.show_lines(describe(state))

    def on_click(self) -> None:
        self.post_message(self.Clicked())
