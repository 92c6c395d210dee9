"""After a hold, in the middle of the screen: what happened, what the legs do now, and the next key."""

from __future__ import annotations

from collections.abc import Mapping

from app.console.guidance import ENDINGS, in_mid_movement, legs_of, may_switch_off, needs_torque_off, process_ended
from app.console.state import SessionState
from app.console.widgets.curves import joint_fault
from app.console.widgets.panel import Lines, Panel, cells, plain, wrapped
from app.console.widgets.status import EFFECT_STYLES, EventsPanel
from app.ipc.snapshot import ActionReport, ControlSnapshot
from app.ipc.states import Effect, Event, Outcome
from app.text.catalogue import render, tr
from hal.joints.device import Joint

RECENT_NS = 60_000_000_000  # an action that ended longer before has nothing to do with it
Moment = tuple[int, str]


def held(state: SessionState) -> bool:
    """Whether the middle of the screen belongs to what happened."""
    return state.snapshot is not None and state.snapshot_fresh and state.snapshot.effect >= Effect.HOLD


def hold_lines(state: SessionState, keys: Mapping[str, str], width: int, height: int, *, watching: bool) -> Lines:
    """The sequence with times from the first event that holds; then the legs; then the key."""
    snapshot = state.snapshot
    if snapshot is None or width < 8:
        return ()
    style = EFFECT_STYLES[Effect.HOLD]
    legs = wrapped(tr(f"hold.{legs_of(snapshot)}"), width - 2)
    next_key = wrapped(tr(_next(state, snapshot, watching=watching), **keys), width - 2)
    below = [*((f"■ {legs[0]}", style), *((f"  {part}", style) for part in legs[1:]))]
    below += [(f"▶ {next_key[0]}", "bold $accent"), *((f"  {part}", "bold $accent") for part in next_key[1:])]
    room = height - len(below)
    happened = [(text, "") for text in _sequence(state, snapshot, width)]
    happened += [(part, "bold $error") for line in _joints(snapshot) for part in wrapped(line, width)]
    if len(happened) > room:  # the newest matter most
        happened = happened[-room:] if room > 0 else []
    gap = [("", "")] * min(2, max(0, room - len(happened)))
    middle = len(legs)
    lines = [*happened, *gap[:1], *below[:middle], *gap[1:], *below[middle:]]
    return tuple(plain(text, style) for text, style in lines[-height:])


_KEYS = {
    "held": "hold.held_key",
    "damped": "hold.damped_key",
    "unconfirmed": "hold.damped_key",
    "off": "hold.off_key",
}
# A key that was pressed is over, whatever the row says; the guardian's damping ends with the joints' power.
_BY_KEYS = (Event.STOP, Event.STOP_AGAIN, Event.GUARDIAN_ACTED)


def _next(state: SessionState, snapshot: ControlSnapshot, *, watching: bool) -> str:
    """Name of the text that says what comes next."""
    if any(event.event in ENDINGS for event in state.events):
        return "guide.ending"
    if watching:
        return "hold.watching"
    if process_ended(state):
        return "guide.process_ended"
    legs = legs_of(snapshot)
    if needs_torque_off(state):
        return "hold.torque_off_key" if may_switch_off(snapshot) else "guide.drive_held"
    if any(event.present and event.effect >= Effect.HOLD and event.event not in _BY_KEYS for event in state.events):
        return "hold.wait"
    return "hold.off_key" if legs == "held" and not in_mid_movement(snapshot) else _KEYS[legs]


def _sequence(state: SessionState, snapshot: ControlSnapshot, width: int) -> list[str]:
    """A line a moment, later ones below; what does not fit goes on under its own beginning."""
    holding = [event for event in state.events if event.effect >= Effect.HOLD]
    begun_ns = min((event.since_ns for event in holding), default=snapshot.stop_received_ns)
    moments: list[Moment] = [(event.since_ns, render(event.reason)) for event in holding]
    report = snapshot.reports[-1] if snapshot.reports else None
    if report is not None and (not report.ended_ns or begun_ns - report.ended_ns < RECENT_NS):
        moments += _action(report)
    if holding and snapshot.stop_command_ns >= begun_ns and snapshot.stop_received_ns:
        took_ms = (snapshot.stop_command_ns - snapshot.stop_received_ns) / 1e6
        moments.append((snapshot.stop_command_ns, tr("hold.commanded", ms=f"{took_ms:.0f}")))
    lines: list[str] = []
    for at_ns, text in sorted(moments, key=lambda moment: moment[0]):
        time = f"{(at_ns - begun_ns) / 1e9:+8.2f} s  " if at_ns != begun_ns else f"{'0.00':>8} s  "
        for part in wrapped(text, width - cells(time)):
            lines.append(f"{time}{part}")
            time = " " * cells(time)
    return lines


def _joints(snapshot: ControlSnapshot) -> list[str]:
    """What is wrong with which joints: the panel stands where small screens show the joints."""
    found: dict[str, list[str]] = {}
    for joint in Joint:
        if wrong := joint_fault(snapshot.joints[joint]):
            found.setdefault(wrong, []).append(tr(f"joints.{joint.name.lower()}").rstrip())
    return [f"‼ {tr('list.separator').join(names)}: {wrong}" for wrong, names in found.items()]


def _action(report: ActionReport) -> list[Moment]:
    """From its acceptance to its end."""
    found = [(report.accepted_ns, tr(f"hold.{report.source.name.lower()}", action=tr(report.action)))]
    if report.first_motion_ns:
        found.append((report.first_motion_ns, tr("hold.moved")))
    if report.ended_ns and report.outcome is Outcome.STOPPED:
        found.append((report.ended_ns, tr("hold.stopped", action=tr(report.action))))
    return [moment for moment in found if moment[0]]


class HoldPanel(Panel):
    """Takes the place of map and push while the legs are held; a click asks for the acknowledgement."""

    def show(self, state: SessionState, keys: Mapping[str, str], *, watching: bool) -> None:
        """Tell the newest."""
        width, height = self.content_size
        if width and height:
            self.lines = hold_lines(state, keys, width, height, watching=watching)

    def on_click(self) -> None:
        self.post_message(EventsPanel.Clicked())
