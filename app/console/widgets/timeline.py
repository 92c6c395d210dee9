"""A reviewed session: lanes over time, one row each, with a cursor; and everything about the moment at the cursor."""

from __future__ import annotations

import math
from enum import Enum

from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual import events
from textual.message import Message
from textual.reactive import reactive
from textual.strip import Strip
from textual.widget import Widget

from app.console.review_data import Instant, ReviewedSession, Span, visible
from app.console.widgets.panel import cells, padded
from app.console.widgets.patient_details import bar_of
from app.ipc.states import Effect, GaitState
from app.text.catalogue import tr
from app.text.recorded import render_recorded
from hal.joints.protocol import Joint
from logs.reason import Reason, sanitize_terminal, text_of
from logs.records import Comment, JointStatistics, Record
from logs.show import line_of

LABEL_WIDTH = 9
ANGLE_RANGE_RAD = (-0.5, 2.0)  # hip extension in walking to a knee that sits
NEAREST_S = 2.0  # the whole width at the strongest zoom
LANES = ("time", "state", "gesture", "press", "knee_left", "knee_right", "effect", "events")
MARKS = {"grave": "■", "caution": "▲", "": "·"}

CODES: dict[str, Enum] = {
    **{state.value: state for state in GaitState},
    **{effect.name.lower(): effect for effect in Effect},
}  # as a trail holds them


class Timeline(Widget):
    """Lanes over time. A click moves the cursor; the wheel zooms."""

    DEFAULT_CSS = f"Timeline {{ height: {len(LANES)}; width: 1fr; }}"

    class Moved(Message):
        """The cursor was put to a time."""

        def __init__(self, at_s: float) -> None:
            super().__init__()
            self.at_s = at_s

    cursor_s = reactive(0.0)

    def __init__(self) -> None:
        super().__init__(id="timeline")
        self._session: ReviewedSession | None = None
        self._begin_s = 0.0
        self._shown_s = NEAREST_S
        self._drawn: list[list[tuple[str, Style]]] = []

    def show(self, session: ReviewedSession) -> None:
        """Show a whole session."""
        self._session = session
        self._begin_s, self._shown_s = 0.0, max(session.duration_s, NEAREST_S)
        self._redraw()

    def watch_cursor_s(self, at_s: float) -> None:
        """The view follows the cursor."""
        if not self._begin_s <= at_s <= self._begin_s + self._shown_s:
            self._begin_s = at_s - self._shown_s / 2
            self._redraw()

    def zoom(self, factor: float) -> None:
        """Show `factor` times as much time around the cursor."""
        if self._session is None:
            return
        whole = max(self._session.duration_s, NEAREST_S)
        shown = min(max(self._shown_s * factor, NEAREST_S), whole)
        share = (self.cursor_s - self._begin_s) / self._shown_s
        self._begin_s = min(max(self.cursor_s - share * shown, 0.0), whole - shown)
        self._shown_s = shown
        self._redraw()

    @property
    def column_s(self) -> float:
        """How much time one column stands for."""
        return self._shown_s / self._columns

    def render_line(self, y: int) -> Strip:
        """One lane, on the theme's background: without it a terminal shows its own."""
        if not self._drawn or y >= len(LANES):
            return Strip.blank(self.size.width, self.rich_style)
        label = Segment(padded(tr(f"reviewing.{LANES[y]}"), LABEL_WIDTH), Style(dim=True))
        cursor = self._column(self.cursor_s)
        segments = [
            Segment(text, style + Style(reverse=True) if column == cursor else style)
            for column, (text, style) in enumerate(self._drawn[y])
        ]
        return Strip([label, *segments]).crop(0, self.size.width).apply_style(self.rich_style)

    def on_resize(self) -> None:
        """Draw for the new width."""
        self._redraw()

    def on_click(self, event: events.Click) -> None:
        """Ask for the cursor there."""
        x = event.x - LABEL_WIDTH
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
        self._drawn = [  # in the order of LANES
            self._times(),
            self._bands(lanes.state, "primary"),
            self._bands(lanes.gesture, "secondary"),
            self._bands(lanes.press, "success"),
            self._angles(session, Joint.LEFT_KNEE),
            self._angles(session, Joint.RIGHT_KNEE),
            self._bands(lanes.effect, "warning"),
            self._marks(lanes.event),
        ]
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
            row[first : last + 1] = [(cell, style) for cell in _in_cells(as_text(span.label), last + 1 - first)]
        return row

    def _angles(self, session: ReviewedSession, joint: Joint) -> list[tuple[str, Style]]:
        row = self._blank()
        low, high = ANGLE_RANGE_RAD
        for column in range(self._columns):
            at_s = self._begin_s + (column + 0.5) * self.column_s
            statistics = session.joints_at(at_s) if at_s <= session.duration_s else None
            angle = statistics.angle_mean_rad[joint] if statistics else None
            if angle is not None and math.isfinite(angle):
                row[column] = (bar_of((angle - low) / (high - low)), Style())
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
                row[first] = (MARKS[span.weight], Style(color=colour, bold=True))
        return row


def as_text(recorded: str) -> str:
    """A recorded state or effect in the language in use; whatever else as it was recorded."""
    return tr(CODES[recorded]) if recorded in CODES else sanitize_terminal(recorded)


def _in_cells(text: str, width: int) -> list[str]:
    """The text, filled or cut to so many cells; the second cell of a wide character is empty."""
    return [part for letter in padded(text, width) for part in (letter, "")[: cells(letter)]]


def about(instant: Instant, comments: list[Comment]) -> Text:
    """Everything about one moment."""
    minutes, seconds = divmod(instant.at_s, 60)
    text = Text(f"{tr('reviewing.moment')}  {int(minutes)}:{seconds:06.3f}\n", "bold")
    rows = (
        ("state", instant.state),
        ("gesture", instant.gesture),
        ("press", "●" if instant.pressed else ""),
        ("effect", instant.effect),
        ("events", " ".join(text_of(span.cause, render_recorded) or span.label for span in instant.events)),
    )
    for name, value in rows:
        text.append(f"{tr(f'reviewing.{name}')}: ", "dim")
        text.append(f"{as_text(value) or '–'}\n")
    if instant.joints is not None:
        _add_joints(text, instant.joints)
    text.append("\n")
    text.append(_fields(instant))
    for comment in comments:
        text.append(f"\n✎ {sanitize_terminal(comment.text)}", "italic")
    return text


def _add_joints(text: Text, joints: JointStatistics) -> None:
    titles = (tr(f"reviewing.{name}") for name in ("angle", "target", "torque", "temperature"))
    text.append(f"{'':<8}" + "".join(f"{title:>9}" for title in titles) + "\n", "dim")
    for joint in Joint:
        values = (
            _number(joints.angle_mean_rad[joint], math.degrees(1), "°"),
            _number(joints.target_mean_rad[joint], math.degrees(1), "°"),
            _number(joints.torque_mean_nm[joint], 1, " Nm"),
            _number(joints.temperature_c[joint], 1, " °C"),
        )
        text.append(padded(tr(f"joints.{joint.name.lower()}"), 8) + "".join(f"{value:>9}" for value in values) + "\n")


def _number(value: float | None, scale: float, unit: str) -> str:
    return "–" if value is None else f"{value * scale:.1f}{unit}"


def _fields(instant: Instant) -> Text:
    """The record at the cursor, field by field."""
    record = instant.record
    if not isinstance(record, Record):
        return line_of(record, render_recorded)
    text = Text(f"#{record.sequence} {record.process} {sanitize_terminal(record.operator)}\n", "bold")
    for name in record.body.__struct_fields__:
        value = getattr(record.body, name)
        shown = text_of(value, render_recorded) if isinstance(value, Reason) else str(value)
        text.append(f"{name}: ", "dim")
        text.append(f"{sanitize_terminal(shown)}\n")
    text.append(f"hash {record.hash[:16]}…\n", "dim")
    return text
