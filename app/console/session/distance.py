"""The distance gauge and the virtual button: word, shape and colour say the same."""

from __future__ import annotations

from app.console.language import tr
from app.console.session.panel import Line, Lines, plain
from app.console.session.state import SessionState
from app.console.session.state_panel import StatePanel
from app.console.session.words import gesture_name
from app.messages import TriggerReport

SCALE_M = 0.70  # the paper's farthest


def describe(state: SessionState, width: int) -> Lines:
    """The figure, the gauge, and the button."""
    report = state.report
    if report is None or not state.report_fresh:
        return (plain("–", "$text-muted"), plain(gauge(None, 0.0, 0.20, width)), _button(None))
    return (_figure(report), _gauge_line(report, width), _button(report))


def gauge(distance_m: float | None, sd_m: float, threshold_m: float, width: int) -> str:
    """A scale from the camera (left) to SCALE_M: `┃` threshold, `●` hand, `░` its uncertainty (±2 sd)."""

    def cell(metres: float) -> int:
        return max(0, min(width - 1, round(metres / SCALE_M * (width - 1))))

    cells = ["─"] * width
    if distance_m is not None:
        for index in range(cell(distance_m - 2 * sd_m), cell(distance_m + 2 * sd_m) + 1):
            cells[index] = "░"
    cells[cell(threshold_m)] = "┃"
    if distance_m is not None:
        cells[cell(distance_m)] = "●"
    return "".join(cells)


def _figure(report: TriggerReport) -> Line:
    limit = tr("distance.threshold", cm=f"{report.threshold_m * 100:.0f}")
    if report.distance_m is None:
        return ((tr("distance.none"), "$text-muted"), (limit, "$text-muted"))
    return (
        (f"{report.distance_m * 100:5.1f} ± {report.distance_sd_m * 200:.1f} cm  ", "bold"),
        (limit, "$text-muted"),
    )


def _gauge_line(report: TriggerReport, width: int) -> Line:
    style = "$success" if report.pressed else "$primary"
    return plain(gauge(report.distance_m, report.distance_sd_m, report.threshold_m, width), style)


def _button(report: TriggerReport | None) -> Line:
    if report is not None and report.pressed:
        name = gesture_name(report.gesture) if report.gesture else ""
        return (
            (f" ◉ {tr('button.pressed')} ", "bold reverse $success"),
            (" " + tr("button.withdraw", gesture=name), "$success"),
        )
    said = tr("button.cancelled", reason=report.cancel_reason) if report and report.cancel_reason else ""
    return ((f" ○ {tr('button.released')} ", "bold reverse $error"), (f" {said}", "$text-muted"))


class DistancePanel(StatePanel):
    """Distance, gauge and button."""

    def show(self, state: SessionState) -> None:
        """Draw the newest report."""
        self.show_lines(describe(state, max(10, self.content_size.width)))
