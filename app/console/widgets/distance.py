"""The distance gauge and the virtual button: word, shape and colour say the same."""

from __future__ import annotations

from app.console.sentences import sentence
from app.console.state import PushNote, SessionState
from app.console.terms import gesture_name
from app.console.widgets.panel import Line, Lines, StatePanel, cells, plain
from app.ipc.messages import PressRange, TriggerReport
from app.text.catalogue import tr

SCALE_M = 0.70  # the paper's farthest


def describe(state: SessionState, width: int) -> Lines:
    """The figure, the gauge, and the button."""
    report = state.report
    if report is None or not state.report_fresh:
        return (plain("–", "$text-muted"), plain(gauge(None, 0.0, 0.20, width)), _button(None, state.push))
    return (_figure(report, width), _gauge_line(report, width), _button(report, state.push), *_zone(report.press_zone))


def gauge(distance_m: float | None, sd_m: float, threshold_m: float, width: int, blind_m: float = 0.0) -> str:
    """A scale from the camera (left) to SCALE_M: `┃` threshold, `●` hand, `░` its uncertainty (±2 sd).

    blind_m: nearer the camera loses the hand (`╌`).
    """

    def at(metres: float) -> int:
        return max(0, min(width - 1, round(metres / SCALE_M * (width - 1))))

    drawn = ["╌"] * min(width, at(blind_m) if blind_m else 0)
    drawn += ["─"] * (width - len(drawn))
    if distance_m is not None:
        for index in range(at(distance_m - 2 * sd_m), at(distance_m + 2 * sd_m) + 1):
            drawn[index] = "░"
    drawn[at(threshold_m)] = "┃"
    if distance_m is not None:
        drawn[at(distance_m)] = "●"
    return "".join(drawn)


def _figure(report: TriggerReport, width: int) -> Line:
    limit = tr("distance.threshold", cm=f"{report.threshold_m * 100:.0f}")
    if report.distance_m is None:
        return ((tr("distance.none"), "$text-muted"), (limit, "$text-muted"))
    figure = f"{report.distance_m * 100:5.1f} ± {report.distance_sd_m * 200:.1f} cm  "
    if cells(figure + limit) > width:
        limit = f"< {report.threshold_m * 100:.0f}"  # a second line would push the button out of the panel
    return ((figure, "bold"), (limit, "$text-muted"))


def _gauge_line(report: TriggerReport, width: int) -> Line:
    style = "$success" if report.pressed else "$primary"
    blind_m = report.press_zone.followed_from_m if report.press_zone else 0.0
    return plain(gauge(report.distance_m, report.distance_sd_m, report.threshold_m, width, blind_m), style)


def _button(report: TriggerReport | None, push: PushNote) -> Line:
    if report is not None and report.pressed:
        name = gesture_name(report.gesture) if report.gesture else ""
        return (
            (f" ◉ {tr('button.pressed')} ", "bold reverse $success"),
            (" " + tr("button.withdraw", gesture=name), "$success"),
        )
    return (
        (f" ○ {tr('button.released')} ", "bold reverse $error"),
        (f" {_why(push)}" if push.said else "", "$warning"),
    )


def _why(push: PushNote) -> str:
    said = sentence(push.said)
    return tr("button.cancelled", reason=said) if push.cancelled else said


def _zone(zone: PressRange | None) -> Lines:
    """Where a press works before this camera; it stands below the button, where there is room for it."""
    if zone is None:
        return ()
    style = "$text-muted" if zone.fits else "bold $warning"
    return (plain(zone_words(zone), style),)


def zone_words(zone: PressRange) -> str:
    """Where a press works, in a line."""
    if not zone.possible:
        return tr("distance.zone_impossible", near=f"{zone.followed_from_m * 100:.0f}")
    near, proposed = f"{zone.followed_from_m * 100:.0f}", f"{zone.threshold_m * 100:.0f}"
    words = tr("distance.zone", near=near, far=f"{zone.seen_to_m * 100:.0f}")
    return words if zone.fits else f"{words} · {tr('distance.proposed', cm=proposed)}"


class DistancePanel(StatePanel):
    """Distance, gauge and button."""

    def show(self, state: SessionState) -> None:
        """Draw the newest report."""
        self.show_lines(describe(state, max(10, self.content_size.width)))
