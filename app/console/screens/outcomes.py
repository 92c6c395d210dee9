"""A patient's page: what sessions came to, each measure over sessions, beside the smallest change that means something.

Sessions are measured one by one in a thread, as a recording takes seconds; what was measured before is there at once.
"""

from __future__ import annotations

import asyncio

from textual import work
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.widgets import Static

from app.console.screens.base import Dialog
from app.console.widgets.panel import Lines, Panel
from app.console.widgets.progress import progress_lines
from app.outcomes.history import Refused, kept_outcomes, trails_of
from app.outcomes.session import SessionOutcomes
from app.outcomes.table import remarks, series_of, sources
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render, tr
from logs.errors import AuditError


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
        first, last = self._found[0].began[:10], self._found[-1].began[:10]
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
