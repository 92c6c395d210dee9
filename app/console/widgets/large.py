"""The session in large letters, for who stands three metres away: state, gesture, distance, what is allowed, a stop."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import ceil, floor

from app.console.guidance import guidance_line, legs_of
from app.console.state import SessionState
from app.console.widgets.canvas import Canvas
from app.console.widgets.gesture import FINGERS
from app.console.widgets.hold import hold_lines
from app.console.widgets.letters import large
from app.console.widgets.panel import DrawnPanel, Lines, plain, wrapped
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import GESTURE_OF, Effect
from app.text.catalogue import tr

_QUIET, _STRONG = "$foreground-muted", "bold $primary"
_TEXT_ROWS = 4  # below the name of a stop: what the legs do, and the next key
_LEAST_ROWS = 3  # of a large letter
_STOP = "STOP"  # as on every red bar, where the font lacks the letters of a language


def large_lines(state: SessionState, keys: Mapping[str, str], width: int, height: int, *, watching: bool) -> Lines:
    """All of it in `height` rows: where the legs are, the hand, what is allowed; a stop takes the room of all three."""
    snapshot = state.snapshot
    if snapshot is None or not state.snapshot_fresh:
        line = guidance_line(state, dict(keys), watching=watching)
        return _text(line[0][0][0], line[0][0][1], width, height)
    if snapshot.effect >= Effect.HOLD:
        room, legs = max(1, height - _TEXT_ROWS), f"legs.{legs_of(snapshot)}"
        rows = large(tr(legs), width, room) or large(_STOP, width, room)
        name = tuple(plain(row, "bold $error") for row in rows) or _text(tr(legs), "bold $error", width, room)
        below = hold_lines(state, keys, width, height - len(name) - 1, watching=watching)
        return (*name, plain(""), *below)[:height]
    place = max(_LEAST_ROWS, round(0.3 * height))
    signs = max(_LEAST_ROWS + 2, round(0.35 * height))
    hand = height - place - signs
    parts = [_fill(_place(snapshot, width, place), place)]
    if hand >= _LEAST_ROWS:
        parts.append(_fill(_hand(state, width, hand), hand))
    parts.append(_allowed(snapshot, width, signs - 1))
    return tuple(line for part in parts for line in part)[:height]


def _fill(lines: Lines, rows: int) -> Lines:
    """So many rows, the last one empty where there is room for that."""
    return (*lines, *(plain("") for _ in range(rows - len(lines))))[:rows]


def _text(text: str, style: str, width: int, height: int) -> Lines:
    """In large letters, or in usual ones where the font has not all of them."""
    rows = large(text.strip("▶· .。"), width, height)
    if rows:
        return tuple(plain(row, style) for row in rows)
    return tuple(plain(f" {part}", f"{style} reverse") for part in wrapped(text, max(8, width - 1)))[:height]


def _place(snapshot: ControlSnapshot, width: int, rows: int) -> Lines:
    """Where the legs are; while they move, what is being done and how far it has come."""
    if snapshot.action is not None:
        return _text(f"{tr(snapshot.action)} {snapshot.progress:.0%}", "bold $accent", width, rows - 1)
    return _text(tr(snapshot.state), "bold", width, rows - 1)


def _hand(state: SessionState, width: int, rows: int) -> Lines:
    """The voted gesture on the left, the distance and its threshold on the right, or that the button is pressed."""
    report, half = state.report, width // 2
    if report is None or not state.report_fresh or report.camera_fault:
        return _text(tr("gesture.stale"), "bold $error", width, rows - 1)
    canvas, tall = Canvas(width, rows), max(_LEAST_ROWS, rows - 2)
    if report.gesture is None:
        canvas.text(1, rows // 2, tr("gesture.none") if report.hand else tr("gesture.no_hand"), _QUIET)
    else:
        _put(canvas, 1, large(sign_of(report.gesture.value), half // 2, tall), _STRONG)
        canvas.text(1, tall, f"{tr(report.gesture)}  {FINGERS[report.gesture]}", "bold")
    if report.pressed:
        pressed = large(tr("button.pressed"), half - 1, tall) or (f"◉ {tr('button.pressed')}",)
        _put(canvas, half, pressed, "bold $success")
    elif report.safe_distance_m is not None:
        _put(canvas, half, large(f"{whole_cm(report.safe_distance_m, report.threshold_m)}", half - 1, tall), "bold")
        threshold = tr("distance.threshold", cm=f"{report.threshold_m * 100:.1f}".removesuffix(".0"))
        canvas.text(half, tall, threshold, _QUIET)
    return canvas.lines()


def _allowed(snapshot: ControlSnapshot, width: int, rows: int) -> Lines:
    """The gestures that act now, each over what it does."""
    if not snapshot.armed:
        return _text(tr("status.not_armed"), "bold $warning", width, rows)
    allowed = tuple(action for action in snapshot.allowed if action not in snapshot.by_key_only)
    if not allowed:
        return ()
    room = width // len(allowed)
    canvas, tall = Canvas(width, rows), max(_LEAST_ROWS, rows - 2)
    signs = [large(sign_of(GESTURE_OF[action].value), max(4, room - 2), tall) for action in allowed]
    least = min(map(len, signs))  # all of one size
    for at, action in enumerate(allowed):
        x = at * room + 1
        sign = large(sign_of(GESTURE_OF[action].value), max(4, room - 2), least)
        _put(canvas, x, sign or (sign_of(GESTURE_OF[action].value),), "bold $success")
        for row, part in enumerate(wrapped(tr(action), room - 1)[: rows - least]):
            canvas.text(x, least + row, part, "$success")
    return canvas.lines()


def whole_cm(distance_m: float, threshold_m: float) -> int:
    """In whole centimetres, and never on the threshold's other side."""
    return floor(distance_m * 100) if distance_m < threshold_m else ceil(distance_m * 100)


def sign_of(gesture: str) -> str:
    """A gesture's key as its sign: its digit, L or R."""
    return gesture[0].upper()


def _put(canvas: Canvas, column: int, rows: Iterable[str], style: str) -> None:
    for row, text in enumerate(rows):
        canvas.text(column, row, text, style)


class LargePanel(DrawnPanel):
    """The whole session in large letters."""

    DRAWN_HZ = 8.0

    def follow(self, state: SessionState, keys: Mapping[str, str], *, watching: bool) -> None:
        """Draw the newest state, where it is on the screen."""
        width, height = self.content_size
        now = state.snapshot
        at_once = now and (now.state, now.action, now.effect, now.enabled, now.damped, now.armed, now.allowed)
        if width and height and self.due(state.now_ns, (at_once, state.snapshot_fresh)):
            self.lines = large_lines(state, keys, width, height, watching=watching)
