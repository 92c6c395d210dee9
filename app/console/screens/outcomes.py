"""A patient's page: what sessions came to, each measure over sessions, beside the smallest change that means something.

Sessions are measured one by one in a thread, as a recording takes seconds; what was measured before is there at once.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from itertools import pairwise

from textual import work
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.widgets import Static

from app.console.screens.base import Dialog
from app.console.widgets.canvas import Canvas
from app.console.widgets.panel import Line, Lines, Panel, cells, fitted, padded, plain
from app.console.widgets.patient_details import local_text
from app.outcomes.history import Refused, kept_outcomes, trails_of
from app.outcomes.session import SessionOutcomes
from app.outcomes.table import Series, remarks, series_of, sources
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render, tr
from logs.errors import AuditError

ROWS = 2  # of a plot
LEAST_WIDTH = 24  # of a plot with its labels


class OutcomesPage(Dialog[None]):
    """All sessions of one patient."""

    HELP_PAGE = "outcomes"

    def __init__(self, home: Home, patient: str) -> None:
        super().__init__()
        self._home = home
        self._patient = patient
        self._found: list[SessionOutcomes] = []
        self._refused: list[Refused] | None = None  # None: not measured yet

    def compose(self) -> ComposeResult:
        with VerticalScroll(classes="dialog page") as box:
            box.border_title = tr("outcomes.title", patient=self._patient)
            yield Static(tr("outcomes.page.opens"), id="state", markup=False)
            yield Panel(id="measures")
            yield Static(id="notes", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        """Begin to measure."""
        super().on_mount()
        self._measure()

    def fill(self) -> None:
        """What was measured."""
        if self._refused is not None:
            self._tell(self._span())
            self.query_one("#notes", Static).update("\n\n".join(self._notes(self._refused)))
            self.call_after_refresh(self._draw)

    def on_resize(self) -> None:
        """Plots as wide as the page."""
        self.call_after_refresh(self._draw)

    @work(exclusive=True)
    async def _measure(self) -> None:
        with self.notify_errors():
            trails, refused = await asyncio.to_thread(trails_of, self._home.logs, self._patient)
            for number, trail in enumerate(trails, start=1):
                self._tell(tr("outcomes.page.measures", number=number, total=len(trails)))
                try:
                    self._found.append(await asyncio.to_thread(kept_outcomes, self._home.outcomes, trail))
                except (AppError, AuditError) as error:
                    refused.append(error)
            self._refused = refused
            self.fill()

    def _span(self) -> str:
        if not self._found:
            return tr("outcomes.page.none")
        first, last = (local_text(one.began)[:10] for one in (self._found[0], self._found[-1]))
        return tr("outcomes.page.sessions", count=len(self._found), first=first, last=last)

    def _notes(self, refused: list[Refused]) -> list[str]:
        """Why something is missing, and where the smallest changes come from."""
        notes = [f"✗ {render(error)}" for error in refused]
        notes += [tr(code, **values) for code, values in remarks(self._found)]
        return notes + (list(sources()) if self._found else [])

    def _tell(self, text: str) -> None:
        self.query_one("#state", Static).update(text)

    def _draw(self) -> None:
        panel = self.query_one("#measures", Panel)
        lines: Lines = progress_lines(series_of(self._found), panel.content_size.width) if self._found else ()
        if lines != panel.lines:
            panel.lines = lines
            panel.refresh(layout=True)


def progress_lines(measures: Sequence[Series], width: int) -> Lines:
    """Each measure below the other: name and figures, what its change means, its plot."""
    lines: list[Line] = []
    for series in measures:
        lines.extend(_figures(series, width))
        if series.smallest is not None:
            lines.append(_meaning(series, width))
        if width >= LEAST_WIDTH and len(series.values) > 1:
            lines.extend(plot(series, width))
        lines.append(plain(""))
    return tuple(lines)


def plot(series: Series, width: int) -> Lines:
    """A point a session, joined where two follow each other; dotted: the smallest change, up and down from the first.

    The scale's ends stand before it. No measure is negative, so a dotted line below 0 is left out.
    """
    around = [] if series.least is None else [series.known[0] - series.least, series.known[0] + series.least]
    dotted = [line for line in around if line >= 0]
    shown = [*series.known, *dotted]
    bottom, top = min(shown), max(shown)
    labels = (format(top, series.form), format(bottom, series.form))
    if top == bottom:  # in the middle
        bottom, top = bottom - 1, top + 1
    axis = max(map(cells, labels)) + 1
    canvas = Canvas(width, ROWS)

    def at(number: int, value: float) -> tuple[float, float]:
        share = number / (len(series.values) - 1)
        return 2 * axis + share * (canvas.width - 1 - 2 * axis), (top - value) / (top - bottom) * (canvas.height - 1)

    canvas.pen = "$accent"
    for line in dotted:
        canvas.line(*at(0, line), *at(len(series.values) - 1, line), every=4)
    canvas.pen = "bold $primary"
    points = [None if value is None else at(number, value) for number, value in enumerate(series.values)]
    for point in points:
        if point is not None:
            canvas.dot(round(point[0]), round(point[1]))
    for a, b in pairwise(points):
        if a is not None and b is not None:
            canvas.line(*a, *b)
    canvas.text(0, 0, labels[0], "$foreground-muted")
    if labels[0] != labels[1]:
        canvas.text(0, ROWS - 1, labels[1], "$foreground-muted")
    return canvas.lines()


def _figures(series: Series, width: int) -> Lines:
    """On one line, else the figures below the name."""
    known, form = series.known, series.form
    parts = [(f"{known[-1]:{form}}", "bold")]
    if series.change is not None:
        parts = [(f"{known[0]:{form}} → ", "$foreground-muted"), *parts, (f"  ({series.change:+{form}})", "")]
    name = (f"{series.name}  ", "bold")
    if sum(cells(text) for text, _ in (name, *parts)) <= width:
        return ((name, *parts),)
    return (plain(padded(series.name, min(width, cells(series.name))), "bold"), fitted(parts, width))


def _meaning(series: Series, width: int) -> Line:
    assert series.smallest is not None
    assert series.least is not None
    least = f"±{series.least:{series.form}}"
    kind = tr(series.smallest.kind)
    if series.change is None:
        return fitted([(tr("outcomes.page.smallest", change=kind, least=least), "$foreground-muted")], width)
    reached = abs(series.change) >= series.least
    code = "outcomes.page.reached" if reached else "outcomes.page.not_reached"
    return fitted([(tr(code, change=kind, least=least), "bold $success" if reached else "$foreground-muted")], width)
