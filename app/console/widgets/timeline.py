"""The session drawn as lanes over time, one row each, with a cursor."""

from __future__ import annotations

import math
from collections.abc import Callable

from rich.segment import Segment
from rich.style import Style
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from app.console.review_data import ReviewedSession, Span, visible
from app.text.catalogue import tr
from logs.sanitize import sanitize_terminal

LABEL_WIDTH = 9
BARS = "▁▂▃▄▅▆▇█"
ANGLE_RANGE_RAD = (-0.5, 2.0)  # hip extension in walking to a knee that sits
NEAREST_S = 2.0  # the whole width at the strongest zoom
LANES = ("time", "state", "gesture", "press", "knee L", "knee R", "effect", "events")
_MARK = {"grave": "■", "caution": "▲", "": "·"}


class Timeline(Widget):
    """Where things happened. Clicking or dragging moves the cursor; the wheel zooms."""

    DEFAULT_CSS = f"Timeline {{ height: {len(LANES)}; width: 1fr; }}"

    class Moved(Message):
        """The cursor was put to a time."""

        def __init__(self, at_s: float) -> None:
            super().__init__()
            self.at_s = at_s

    def __init__(self) -> None:
        super().__init__(id="timeline")
        self._session: ReviewedSession | None = None
        self._cursor_s = 0.0
        self._begin_s = 0.0
        self._shown_s = NEAREST_S
        self._drawn: list[list[tuple[str, Style]]] = []

    def show(self, session: ReviewedSession) -> None:
        """Take a session and show it whole."""
        self._session = session
        self._begin_s, self._shown_s = 0.0, max(session.duration_s, NEAREST_S)
        self._redraw()

    def put_cursor(self, at_s: float) -> None:
        """Move the cursor; the view follows."""
        self._cursor_s = at_s
        if not self._begin_s <= at_s <= self._begin_s + self._shown_s:
            self._begin_s = at_s - self._shown_s / 2
        self._redraw()

    def zoom(self, factor: float) -> None:
        """Show `factor` times as much time around the cursor."""
        if self._session is None:
            return
        whole = max(self._session.duration_s, NEAREST_S)
        shown = min(max(self._shown_s * factor, NEAREST_S), whole)
        share = (self._cursor_s - self._begin_s) / self._shown_s
        self._begin_s = min(max(self._cursor_s - share * shown, 0.0), whole - shown)
        self._shown_s = shown
        self._redraw()

    @property
    def column_s(self) -> float:
        """How much time one column stands for."""
        return self._shown_s / self._columns

    @property
    def shown_s(self) -> float:
        """How much time is in view."""
        return self._shown_s

    def render_line(self, y: int) -> Strip:
        """One lane."""
        if not self._drawn or y >= len(LANES):
            return Strip.blank(self.size.width)
        name = LANES[y] if LANES[y] in ("time", "knee L", "knee R") else tr(f"reviewing.{LANES[y]}")
        label = Segment(f"{name:<{LABEL_WIDTH}.{LABEL_WIDTH}}", Style(dim=True))
        cursor = self._column(self._cursor_s)
        segments = [
            Segment(text, style + Style(reverse=True) if column == cursor else style)
            for column, (text, style) in enumerate(self._drawn[y])
        ]
        return Strip([label, *segments]).crop(0, self.size.width)

    def on_resize(self) -> None:
        """Draw for the new width."""
        self._redraw()

    def on_click(self, event: object) -> None:
        """Put the cursor there."""
        x = getattr(event, "x", 0) - LABEL_WIDTH
        self.post_message(self.Moved(self._begin_s + (x + 0.5) * self.column_s))

    def on_mouse_scroll_up(self) -> None:
        """Closer."""
        self.zoom(0.5)

    def on_mouse_scroll_down(self) -> None:
        """Wider."""
        self.zoom(2.0)

    @property
    def _columns(self) -> int:
        return max(self.size.width - LABEL_WIDTH, 1)

    def _column(self, at_s: float) -> int:
        return int((at_s - self._begin_s) / self.column_s)

    def _redraw(self) -> None:
        session = self._session
        if session is None or self.size.width <= LABEL_WIDTH:
            return
        lanes = session.lanes
        draw: dict[str, Callable[[], list[tuple[str, Style]]]] = {
            "time": self._times,
            "state": lambda: self._bands(lanes.state, "primary"),
            "gesture": lambda: self._bands(lanes.gesture, "secondary"),
            "press": lambda: self._bands(lanes.press, "success"),
            "knee L": lambda: self._angles(session, 1),
            "knee R": lambda: self._angles(session, 3),
            "effect": lambda: self._bands(lanes.effect, "warning"),
            "events": lambda: self._marks(lanes.event),
        }
        self._drawn = [draw[lane]() for lane in LANES]
        self.refresh()

    def _blank(self) -> list[tuple[str, Style]]:
        return [(" ", Style())] * self._columns

    def _times(self) -> list[tuple[str, Style]]:
        row = self._blank()
        for column in range(0, self._columns, 12):
            at_s = self._begin_s + column * self.column_s
            text = f"{int(at_s // 60):d}:{at_s % 60:04.1f}"
            for offset, character in enumerate(text[: self._columns - column]):
                row[column + offset] = (character, Style(dim=True))
        return row

    def _bands(self, spans: list[Span], colour: str) -> list[tuple[str, Style]]:
        """Each span a band with its label in it; neighbours differ in shade, so that their border shows."""
        row = self._blank()
        variables = self.app.get_css_variables()
        shades = (variables.get(colour, "blue"), variables.get(f"{colour}-darken-2", variables.get(colour, "blue")))
        text_colour = variables.get("background", "black")
        for number, span in enumerate(visible(spans, self._begin_s, self._begin_s + self._shown_s)):
            first = max(self._column(span.begin_s), 0)
            last = min(self._column(span.end_s), self._columns - 1)
            style = Style(color=text_colour, bgcolor=shades[number % 2])
            label = sanitize_terminal(span.label)
            for column in range(first, last + 1):
                place = column - first
                row[column] = (label[place] if place < len(label) else " ", style)
        return row

    def _angles(self, session: ReviewedSession, joint: int) -> list[tuple[str, Style]]:
        row = self._blank()
        low, high = ANGLE_RANGE_RAD
        for column in range(self._columns):
            at_s = self._begin_s + (column + 0.5) * self.column_s
            statistics = session.joints_at(at_s) if at_s <= session.duration_s else None
            angle = statistics.angle_mean_rad[joint] if statistics else None
            if angle is not None and math.isfinite(angle):
                share = min(max((angle - low) / (high - low), 0.0), 0.999)
                row[column] = (BARS[int(share * len(BARS))], Style())
        return row

    def _marks(self, spans: list[Span]) -> list[tuple[str, Style]]:
        row = self._blank()
        variables = self.app.get_css_variables()
        for span in visible(spans, self._begin_s, self._begin_s + self._shown_s):
            colour = variables.get("error" if span.weight == "grave" else "warning", "red")
            first = max(self._column(span.begin_s), 0)
            for column in range(first, min(self._column(span.end_s), self._columns - 1) + 1):
                row[column] = ("─", Style(color=colour))
            if first < self._columns:
                row[first] = (_MARK[span.weight], Style(color=colour, bold=True))
        return row
