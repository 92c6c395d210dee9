"""The gait machine, drawn: where the legs are, what may come next, and by which gesture."""

from __future__ import annotations

from app.console.state import SessionState
from app.console.widgets.gesture import FINGERS
from app.console.widgets.panel import Line, Lines, StatePanel, bar, cells, padded, plain
from app.console.widgets.status import event_lines
from app.ipc.messages import ControlSnapshot
from app.ipc.states import GESTURE_OF, Action, GaitState
from app.text.catalogue import render, tr

G = GaitState
A = Action

# The paper's machine as rows of a drawing: states in turn, and the actions that lead from each to the next.
_ROWS: tuple[tuple[GaitState | Action, ...], ...] = (
    (G.UNPOWERED, A.INITIALISE, G.STANDING, A.SIT_DOWN, G.SITTING, A.STAND_UP, G.STANDING),
    (G.STANDING, A.STEP_RIGHT_FIRST, G.RIGHT_FORWARD, A.STEP_LEFT, G.LEFT_FORWARD, A.STEP_RIGHT, G.RIGHT_FORWARD),
    (G.RIGHT_FORWARD, A.STEP_END, G.STANDING),
    (G.STANDING, A.WALK, G.LEFT_FORWARD, A.WALK_END, G.STANDING),
    (G.STANDING, A.STAIR_UP, G.RIGHT_HIGH_STEP),
    (G.STANDING, A.STAIR_DOWN, G.RIGHT_LOW_STEP),
    (G.STANDING, A.OBSTACLE, G.RIGHT_OBSTACLE),
)


def gait_lines(state: SessionState, width: int, height: int, *, alone: bool = False) -> Lines:
    """The drawing where there is room for it, else what is allowed as a list; alone, with what the events would say."""
    snapshot = state.snapshot
    if snapshot is None:
        return (plain(state.fault or tr("machine.waiting"), "bold $error" if state.fault else "$text-muted"),)
    if not state.snapshot_fresh:
        return (_now(snapshot, width), plain(f" {tr('machine.silent')}", "bold $error"))
    drawn = height >= len(_ROWS) + 2 and width >= 72
    why = event_lines(state)[: max(1, height // 2)] if alone and state.events else _why_not(snapshot)
    body = tuple(_row(row, snapshot) for row in _ROWS) if drawn else _allowed(snapshot, width, height - 1 - len(why))
    return (_now(snapshot, width), *((plain(""),) if drawn else ()), *why, *body)


def _now(snapshot: ControlSnapshot, width: int) -> Line:
    head = (f" ● {tr(snapshot.state)} ", "bold reverse $primary")
    if snapshot.action is None:
        return (head,)
    share = bar(snapshot.progress, max(6, min(20, width - 50)))
    latched = f"  {tr('machine.pending', action=tr(snapshot.pending))}" if snapshot.pending else ""
    return (head, (f" ▸ {tr(snapshot.action)} ", "bold $accent"), (share, "$accent"), (latched, "$warning"))


def _why_not(snapshot: ControlSnapshot) -> Lines:
    """Why nothing is allowed, unless an event beside says the same."""
    if snapshot.allowed or snapshot.action is not None or not snapshot.why_not:
        return ()
    known = any(event.reason == snapshot.why_not for event in snapshot.events)
    return () if known else (plain(f" {render(snapshot.why_not)}", "$warning"),)


def _allowed(snapshot: ControlSnapshot, width: int, height: int) -> Lines:
    """Every allowed action: with its fingers where there is room for all, else without."""
    for fingers in (True, False):
        rows = _columns([_item(action, fingers=fingers) for action in snapshot.allowed], width)
        if len(rows) <= height:
            break
    return tuple(plain(row, "$success") for row in rows[: max(1, height)])


def _item(action: Action, *, fingers: bool) -> str:
    drawn = f" {FINGERS[GESTURE_OF[action]]}" if fingers else ""
    return f"{tr(GESTURE_OF[action]):>4}{drawn} {tr(action)}"


def _columns(items: list[str], width: int) -> list[str]:
    if not items:
        return []
    columns = max(1, width // (max(map(cells, items)) + 1))
    return [
        "".join(padded(item, width // columns) for item in items[at : at + columns])
        for at in range(0, len(items), columns)
    ]


def _row(row: tuple[GaitState | Action, ...], snapshot: ControlSnapshot) -> Line:
    parts: list[tuple[str, str]] = []
    for item in row:
        parts.append(_state(item, snapshot) if isinstance(item, GaitState) else _arrow(item, snapshot))
    return tuple(parts)


def _state(state: GaitState, snapshot: ControlSnapshot) -> tuple[str, str]:
    here = state is snapshot.state
    return (f"{'●' if here else '○'} {tr(state)}", "bold $primary" if here else "$text-muted")


def _arrow(action: Action, snapshot: ControlSnapshot) -> tuple[str, str]:
    if action is snapshot.action:
        return (f" ━━{tr(GESTURE_OF[action])}━▶ ", "bold $accent")
    if action in snapshot.allowed:
        return (f" ━━{tr(GESTURE_OF[action])}━▶ ", "bold $success")
    return (f" ──{tr(GESTURE_OF[action])}─▷ ", "$text-muted")


class MachinePanel(StatePanel):
    """State, running action, allowed actions."""

    def show(self, state: SessionState) -> None:
        """Draw the newest snapshot."""
        alone = self.screen.has_class("-narrow")  # the events have no panel there
        self.lines = gait_lines(state, self.content_size.width, self.content_size.height, alone=alone)
