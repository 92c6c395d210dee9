"""The gait as a map: places, the ways out of them with their gesture, where the legs are and where they are going."""

from __future__ import annotations

from app.console.state import SessionState
from app.console.widgets.canvas import Canvas
from app.console.widgets.gesture import FINGERS
from app.console.widgets.panel import DrawnPanel, Line, Lines, bar, cells, fitted, padded, plain, wrapped
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import GESTURE_OF, Action, GaitState
from app.text.catalogue import render, tr

G = GaitState
A = Action

# Where each action leads; a crossing passes through this place and ends standing. tests/app/console/test_gait_map.py
# compares it with control's table.
LEADS_TO = {
    A.INITIALISE: G.STANDING,
    A.STAND_UP: G.STANDING,
    A.SIT_DOWN: G.SITTING,
    A.STEP_RIGHT_FIRST: G.RIGHT_FORWARD,
    A.STEP_LEFT: G.LEFT_FORWARD,
    A.STEP_RIGHT: G.RIGHT_FORWARD,
    A.STEP_END: G.STANDING,
    A.WALK: G.LEFT_FORWARD,
    A.WALK_END: G.STANDING,
    A.STAIR_UP: G.RIGHT_HIGH_STEP,
    A.STAIR_DOWN: G.RIGHT_LOW_STEP,
    A.OBSTACLE: G.RIGHT_OBSTACLE,
}
# The map: a row of it is the place on the left, the way between it and standing, the way on the right, its place.
# A way that leads to standing points to it; `None` leaves a gap.
_LEFT: tuple[tuple[GaitState | None, Action | None], ...] = (
    (G.UNPOWERED, A.INITIALISE),
    (None, None),
    (G.SITTING, A.SIT_DOWN),
    (None, A.STAND_UP),
    (None, None),
    (G.BETWEEN, A.INITIALISE),
    (None, None),
    (None, None),
)
_RIGHT: tuple[tuple[Action, GaitState | None], ...] = (
    (A.STEP_RIGHT_FIRST, G.RIGHT_FORWARD),
    (A.STEP_END, None),
    (A.WALK, None),
    (A.WALK_END, G.LEFT_FORWARD),
    (A.STAIR_UP, G.RIGHT_HIGH_STEP),
    (A.STAIR_DOWN, G.RIGHT_LOW_STEP),
    (A.OBSTACLE, G.RIGHT_OBSTACLE),
)
_BETWEEN_STEPS = ((1, A.STEP_LEFT, "▼"), (2, A.STEP_RIGHT, "▲"))  # row, and the way's direction on the map
_HOME = (A.STEP_END, A.WALK_END, A.INITIALISE, A.STAND_UP)
MAP_ROWS = len(_LEFT)
LEAST_EDGE = 9  # a gesture's name with a stroke on both sides
LIT, DARK, RUNNING, HERE = "bold $success", "$foreground-muted", "bold $accent", "bold reverse $primary"


def gait_lines(state: SessionState, width: int, height: int) -> Lines:
    """The map where there is room for it, else a signpost: the place, and the ways that are lit."""
    snapshot = state.snapshot
    if snapshot is None:
        style = "bold $error" if state.fault else "$foreground-muted"
        return tuple(plain(part, style) for part in wrapped(state.fault or tr("machine.waiting"), width))[:height]
    if not state.snapshot_fresh:
        silent = (plain(f" {part}", "bold $error") for part in wrapped(tr("machine.silent"), width - 1))
        return (_here(snapshot, width), *silent)[:height]
    why = _why_not(snapshot, width)
    full = gait_map(snapshot, width) if height >= MAP_ROWS + 1 + len(why) else ()
    body = full or signpost(snapshot, width, height - 1 - len(why))
    now = (plain(""),) if full and snapshot.action is None else _now(snapshot, width)  # the map says where
    return (*now, *why, *body)[:height]


def _here(snapshot: ControlSnapshot, width: int) -> Line:
    return fitted([(f" ● {tr(snapshot.state)} ", HERE)], width)


def _now(snapshot: ControlSnapshot, width: int) -> Lines:
    """Where the legs are; while they move, what is being done, where it leads, how far it has come."""
    if snapshot.action is None:
        return (_here(snapshot, width),)
    name = (f" ▸ {tr(snapshot.action)} ", "bold reverse $accent")
    share = f" {snapshot.progress:4.0%}"
    room = max(4, min(20, width - cells(name[0]) - cells(share) - 1))
    latched = f"  {tr('machine.pending', action=tr(snapshot.pending))}" if snapshot.pending else ""
    parts = [name, (" ", ""), (bar(snapshot.progress, room), "$accent"), (share, "bold"), (latched, "bold $warning")]
    return (fitted(parts, width),)


def _why_not(snapshot: ControlSnapshot, width: int) -> Lines:
    """Why nothing is allowed, unless an event beside says the same."""
    if snapshot.allowed or snapshot.action is not None or not snapshot.why_not:
        return ()
    if any(event.reason == snapshot.why_not for event in snapshot.events):
        return ()
    return tuple(plain(f" {part}", "$warning") for part in wrapped(render(snapshot.why_not), width - 1))


def signpost(snapshot: ControlSnapshot, width: int, height: int) -> Lines:
    """Every way that is open now: with its fingers where there is room for all, else without, else in columns."""
    if snapshot.action is not None:
        return _leads(snapshot, width)[-max(1, height) :]
    edges = [_edge(action, snapshot, fingers=True) for action in snapshot.allowed]
    if edges and len(edges) <= height and max(map(cells, edges)) + 3 <= width:
        joints = ["┬", *"├" * (len(edges) - 2), "╰"] if len(edges) > 1 else ["╰"]
        return tuple(((f" {joint}━", "$success"), (edge, LIT)) for joint, edge in zip(joints, edges, strict=True))
    rows = _columns([_edge(action, snapshot, fingers=False) for action in snapshot.allowed], width)
    return tuple(plain(row, LIT) for row in rows[: max(1, height)])


def _leads(snapshot: ControlSnapshot, width: int) -> Lines:
    """From where to where: side by side, or one below the other, so that the goal is never cut off."""
    here, goal = f" ● {tr(snapshot.state)} ", f"▶ ◎ {tr(_goal(snapshot))}"
    if cells(here) + cells(goal) + 2 <= width:
        return (plain(""), ((here, ""), ("━━", RUNNING), (goal, RUNNING)))
    return (fitted([(here, "")], width), fitted([(f" ╰━{goal}", RUNNING)], width))


def _goal(snapshot: ControlSnapshot) -> GaitState:
    """Where the running action leads next."""
    assert snapshot.action is not None
    goal = LEADS_TO[snapshot.action]
    if goal is snapshot.state:
        return G.RIGHT_FORWARD if snapshot.action is A.WALK else G.STANDING
    return goal


def _edge(action: Action, snapshot: ControlSnapshot, *, fingers: bool) -> str:
    drawn = f" {FINGERS[GESTURE_OF[action]]}" if fingers else ""
    if action in snapshot.by_key_only:
        drawn = " " * cells(drawn)
    return f"{commanded_by(action, snapshot):>4}{drawn} ▶ {tr(action)}"


def commanded_by(action: Action, snapshot: ControlSnapshot) -> str:
    """What commands it: its gesture, or only a key."""
    return tr("machine.by_key") if action in snapshot.by_key_only else tr(GESTURE_OF[action])


def _columns(items: list[str], width: int) -> list[str]:
    if not items:
        return []
    columns = max(1, width // (max(map(cells, items)) + 1))
    return [
        "".join(padded(item, width // columns) for item in items[at : at + columns])
        for at in range(0, len(items), columns)
    ]


def gait_map(snapshot: ControlSnapshot, width: int) -> Lines:
    """All places and ways; nothing where they need more than `width` cells."""
    left = max(cells(tr(place)) for place, _ in _LEFT if place) + 2
    right = max(cells(tr(place)) for _, place in _RIGHT if place) + 2
    middle = cells(tr(G.STANDING)) + 6
    edge = (width - left - right - middle - 5) // 2
    if edge < LEAST_EDGE:
        return ()
    edges = _Edges(snapshot, edge)
    canvas = Canvas(width, MAP_ROWS)
    box, beyond = left + edge + 2, left + middle + 2 * edge + 4
    for row in range(MAP_ROWS):
        for x in (box, box + middle - 1):
            canvas.text(x, row, "┃", "bold $primary" if snapshot.state is G.STANDING else "$secondary")
    name, style = _place(G.STANDING, snapshot)
    canvas.text(box + 1, MAP_ROWS // 2 - 1, padded(f" {name}", middle - 2), style)
    for row, (place, action) in enumerate(_LEFT):
        if place is not None:
            canvas.text(0, row, *_place(place, snapshot))
        if action is not None:
            source = place if action is A.INITIALISE else None
            canvas.text(left + 1, row, *edges.drawn(action, source))
    for row, (action, place) in enumerate(_RIGHT):
        canvas.text(box + middle + 1, row, *edges.drawn(action))
        if place is not None:
            canvas.text(beyond, row, *_place(place, snapshot))
    for row, action, arrow in _BETWEEN_STEPS:
        style = edges.style(action)
        canvas.text(beyond + 2, row, f"{'┃' if style != DARK else '│'}{arrow} {commanded_by(action, snapshot)}", style)
    return canvas.lines()


class _Edges:
    """How a way is drawn: heavy where it is open, double where the legs are on it, thin where it is closed."""

    def __init__(self, snapshot: ControlSnapshot, width: int) -> None:
        self._snapshot = snapshot
        self._width = width

    def style(self, action: Action, source: GaitState | None = None) -> str:
        """Of this action, from this place (None: from any that it has)."""
        if source is not None and self._snapshot.state is not source:
            return DARK
        if action is self._snapshot.action:
            return RUNNING
        return LIT if action in self._snapshot.allowed else DARK

    def drawn(self, action: Action, source: GaitState | None = None) -> tuple[str, str]:
        """The way with its gesture, its fingers where it is open, its name where there is room."""
        style = self.style(action, source)
        stroke = {RUNNING: "═", LIT: "━"}.get(style, "─")
        gesture = commanded_by(action, self._snapshot)
        drawn = "" if action in self._snapshot.by_key_only else f" {FINGERS[GESTURE_OF[action]]}"
        labels = (f"{gesture}{drawn} {tr(action)}", f"{gesture}{drawn}")
        label = next(
            (f" {text} " for text in labels if cells(text) + 6 <= self._width and style != DARK), f" {gesture} "
        )
        rest = self._width - cells(label) - 1
        line = f"{stroke * (rest // 2)}{label}{stroke * (rest - rest // 2)}"
        to_left = action in (*_HOME, A.SIT_DOWN) and not (source or action is A.STAND_UP)
        head = ("◀" if to_left else "▶") if style != DARK else ("◁" if to_left else "▷")
        return (f"{head}{line}" if to_left else f"{line}{head}", style)


def _place(place: GaitState, snapshot: ControlSnapshot) -> tuple[str, str]:
    if place is snapshot.state:
        return (f"● {tr(place)}", HERE)
    if snapshot.action is not None and place is _goal(snapshot):
        return (f"◎ {tr(place)}", RUNNING)
    return (f"○ {tr(place)}", DARK)


class GaitPanel(DrawnPanel):
    """State, running action, allowed actions."""

    DRAWN_HZ = 5.0  # of a progress; a change of state is drawn at once

    def show(self, state: SessionState) -> None:
        """Draw the newest snapshot."""
        now = state.snapshot
        at_once = now and (now.state, now.action, now.pending, now.allowed, now.why_not)
        events = now and tuple(event.identity for event in now.events)
        if self.due(state.now_ns, (at_once, events, state.snapshot_fresh, state.fault)):
            self.lines = gait_lines(state, self.content_size.width, self.content_size.height)
