"""Compare: both ways to measure, side by side on the same pictures, as in the paper's Tables 5 and 6."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal

from app.console.screens.base import ConsoleScreen
from app.console.state import SessionState
from app.console.widgets.gesture import gauge
from app.console.widgets.panel import Lines, Panel, plain
from app.console.widgets.picture import Picture
from app.ipc.messages import TriggerReport
from app.text.catalogue import tr
from kgdfa.distance import DistanceSource


@dataclass(frozen=True, slots=True)
class Tally:
    """Presses counted since the view was opened."""

    pressed: bool = False
    presses: int = 0

    def after(self, pressed: bool) -> Tally:
        """The tally after a report."""
        return Tally(pressed, self.presses + (pressed and not self.pressed))


def measurement_lines(report: TriggerReport, tally: Tally, width: int, *, depth: bool) -> Lines:
    """One camera's column."""
    distance_m = report.depth_distance_m if depth else report.monocular_m
    pressed = report.pressed and decides(report, depth=depth)
    shown = tr("compare.no_measurement") if distance_m is None else f"{distance_m * 100:.1f} cm"
    if distance_m is not None and report.focal_assumed and not depth:
        shown += f"  {tr('distance.assumed')}"
    word = tr("button.pressed") if pressed else tr("button.released")
    return (
        plain(tr("compare.depth") if depth else tr("compare.monocular"), "bold $primary"),
        plain(shown, "bold"),
        plain(gauge(distance_m, 0.0, report.threshold_m, width)),
        plain(f"{'◉' if pressed else '○'} {word}", "bold $success" if pressed else "bold $error"),
        plain(tr("compare.presses", count=tally.presses)),
        plain(tr("compare.fps", fps=f"{report.fps:.0f}")),
    )


def decides(report: TriggerReport, *, depth: bool) -> bool:
    """Whether that source measured the distance by which the button decided."""
    return report.distance_source is (DistanceSource.DEPTH if depth else DistanceSource.MONOCULAR)


class CompareScreen(ConsoleScreen):
    """Opened over a session, which goes on beneath."""

    HELP_PAGE = "compare"
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,v", "back", "bind.cancel")]

    def __init__(self) -> None:
        super().__init__()
        self._sequence = -1
        self._tallies = (Tally(), Tally())

    def compose(self) -> ComposeResult:
        yield Panel(id="status")
        yield Picture(id="picture")
        with Horizontal(id="columns"):
            yield Panel(id="monocular", title=tr("compare.monocular"))
            yield Panel(id="depth", title=tr("compare.depth"))
        yield from self.compose_bottom()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        if state is None:
            return
        self.query_one("#status", Panel).lines = (plain(tr("compare.text"), "$text-muted"),)
        self.query_one(Picture).show(state)
        if state.report is not None and state.report.sequence != self._sequence:
            self._sequence = state.report.sequence
            self._show(state.report)

    def action_back(self) -> None:
        """To the session."""
        self.dismiss()

    def _show(self, report: TriggerReport) -> None:
        left, right = self._tallies
        self._tallies = (
            left.after(report.pressed and decides(report, depth=False)),
            right.after(report.pressed and decides(report, depth=True)),
        )
        for id_, tally, depth in (("monocular", left, False), ("depth", right, True)):
            panel = self.query_one(f"#{id_}", Panel)
            if depth and report.depth_distance_m is None and not right.presses:
                panel.lines = (plain(tr("compare.no_depth"), "$text-muted"),)
            else:
                panel.lines = measurement_lines(report, tally, max(10, panel.content_size.width), depth=depth)
