"""What perception measures: gesture with votes and reason, distance gauge, virtual button."""

from __future__ import annotations

import math

from app.console.state import NO_NOTE, PressNote, SessionState
from app.console.widgets.panel import DrawnPanel, Line, Lines, StatePanel, bar, cells, fitted, plain, wrapped
from app.console.widgets.push import TRACE_ROWS, Push, draw_push
from app.ipc.messages import TriggerReport
from app.ipc.states import ACTION_OF, RequestRefusal
from app.system.vocabulary import vocabulary_of
from app.text.catalogue import render, tr
from kgdfa.gesture import FINGER_STATES, Finger, FingerState
from kgdfa.press_zone import PressZone
from logs.reason import reason

# Fingers as strokes, thumb first: hand emoji are wide characters, which terminals measure differently.
_STROKES = {FingerState.FOLDED: "··", FingerState.OPEN: "\\|", FingerState.HOOKED: "??", FingerState.PINCHED: ">|"}
FINGERS = {
    gesture: "".join(_STROKES[state][finger != Finger.THUMB] for finger, state in zip(Finger, states, strict=True))
    for gesture, states in FINGER_STATES.items()
}
VOTES_NEEDED = 3  # the paper's vote

_ASIDE = "PerceptionNote.CALIBRATION_UNUSED"  # hands are recognised as well as ever beside it


def gesture_lines(state: SessionState, width: int) -> Lines:
    """What is shown, its votes, and the reason, which may take more than one line of this width."""
    report = state.report
    if report is None:
        return (plain(tr("gesture.waiting"), "$foreground-muted"),)
    if not state.report_fresh:
        return (plain(tr("gesture.stale"), "bold $error"),)
    if report.camera_fault:
        return (plain(tr("gesture.no_picture"), "bold $error"), plain(render(report.camera_fault)))
    foreign = report.gesture is not None and report.gesture not in vocabulary_of(state.setup.profile)
    refused = reason(RequestRefusal.NOT_IN_VOCABULARY, gesture=report.gesture) if foreign else report.hand_refusal
    # Without a hand the headline has said why.
    explained = report.explanation if report.gesture is None and report.hand else None
    aside = report.hint is not None and report.hint.code == _ASIDE
    why = refused or (explained or report.hint if aside else report.hint or explained)
    return (
        _headline(report, foreign=foreign),
        _votes(report, width),
        plain(render(why) if why else "", "$foreground-muted"),
    )


def _headline(report: TriggerReport, *, foreign: bool) -> tuple[tuple[str, str], ...]:
    if report.gesture is not None:
        name = tr(report.gesture)
        return (
            (f" {name} ", "bold reverse $primary"),
            (f" {FINGERS[report.gesture]} ", "bold"),
            (tr("gesture.foreign"), "bold $warning") if foreign else (tr(ACTION_OF[report.gesture]), "bold $primary"),
        )
    if report.hand_refusal is not None:
        return plain(tr("gesture.refused"), "bold $warning")
    return plain(tr("gesture.none") if report.hand else tr("gesture.no_hand"), "bold $foreground-muted")


def _votes(report: TriggerReport, width: int) -> tuple[tuple[str, str], ...]:
    votes = min(report.votes, VOTES_NEEDED)
    raw = tr(report.raw_gesture) if report.raw_gesture else "–"
    counted = tr("gesture.votes", raw=raw)
    dots, confidence = " ●" * votes + " ○" * (VOTES_NEEDED - votes) + "  ", f" {report.confidence:4.0%}"
    room = width - cells(counted + dots + confidence)  # what would not fit takes a line of the reason
    return (
        (counted, ""),
        (dots, "$primary"),
        (bar(report.confidence, BAR_CELLS) if room >= BAR_CELLS else "", "$primary"),
        (confidence, ""),
    )


class GesturePanel(StatePanel):
    """Gesture, votes, confidence, reason."""

    def show(self, state: SessionState) -> None:
        """Draw the newest report."""
        self.lines = gesture_lines(state, self.content_size.width)


BAR_CELLS = 8
SCALE_M = 0.70  # the paper's farthest


def distance_lines(state: SessionState, width: int, height: int, push: Push) -> Lines:
    """The figure, the push of the last seconds (a gauge where there is no room for it), and the button."""
    report, fresh = state.report, state.report_fresh
    if report is None or not fresh:
        return (plain("–", "$foreground-muted"), _button(None, state.press_note, width))
    figure = _fault(report, width) or (_figure(report, width),)
    zone = report.press_zone
    warning = _zone(report, width) if zone is not None and not zone.fits(report.threshold_m) else ()
    rows = height - 1 - len(figure) - len(warning)
    if rows < TRACE_ROWS:
        return (*figure, _gauge_line(report, width), _button(report, state.press_note, width), *_zone(report, width))
    trace = draw_push(push, state.now_ns, report.threshold_m, width, rows)
    return (*figure, *trace, _button(report, NO_NOTE, width), *warning)  # why a push gave nothing stands in the trace


def _fault(report: TriggerReport, width: int) -> Lines:
    """Why a depth camera that should measure does not."""
    if report.safe_distance_m is not None or not report.depth_fault:
        return ()
    return tuple(plain(part, "$warning") for part in wrapped(render(report.depth_fault), width))


def gauge(
    distance_m: float | None,
    sd_m: float,
    threshold_m: float,
    width: int,
    *,
    blind_m: float = 0.0,
    best_m: float | None = None,
) -> str:
    """A scale from the camera (left) to SCALE_M: `┃` threshold, `●` hand, `░` its uncertainty (±2 sd).

    blind_m: nearer the camera loses the hand (`╌`). best_m: the best guess that is uncertain by sd_m; None: distance_m.
    """

    def at(metres: float) -> int:
        return max(0, min(width - 1, round(metres / SCALE_M * (width - 1))))

    drawn = ["╌"] * min(width, at(blind_m) if blind_m else 0)
    drawn += ["─"] * (width - len(drawn))
    if distance_m is not None:
        middle_m = distance_m if best_m is None else best_m
        for index in range(at(middle_m - 2 * sd_m), at(middle_m + 2 * sd_m) + 1):
            drawn[index] = "░"
    mark = at(threshold_m)
    drawn[mark] = "┃"
    if distance_m is not None:
        hand = at(distance_m)
        if hand == mark:  # beside it, on its side
            hand += -1 if distance_m < threshold_m else 1
        drawn[max(0, min(width - 1, hand))] = "●"
    return "".join(drawn)


def _figure(report: TriggerReport, width: int) -> Line:
    """The safe distance, by which the button decides, its threshold, and the best guess as far as there is room."""
    threshold_cm = f"{report.threshold_m * 100:.1f}".removesuffix(".0")
    limit = tr("distance.threshold", cm=threshold_cm)
    if report.safe_distance_m is None:
        return ((tr("distance.none"), "$foreground-muted"), (limit, "$foreground-muted"))
    figure = f"{_on_its_side(report.safe_distance_m, report.threshold_m):5.1f} cm  "
    assumed = f"{tr('distance.assumed')}  " if report.focal_assumed else ""
    if cells(figure + assumed + limit) > width:
        limit = f"< {threshold_cm}"  # a second line would push the button out of the panel
    if cells(figure + assumed + limit) > width:
        assumed = "≈ "  # nothing but the sign fits
    best = "" if report.distance_m is None else f"{report.distance_m * 100:.1f} ± {report.distance_sd_m * 200:.1f}"
    best = f"  {tr('distance.best', figure=best)}" if best else ""
    source = f"  {tr(report.distance_source)}" if report.distance_source and _has_depth(report) else ""
    if cells(figure + assumed + limit + source + best) > width:
        best = ""
    if cells(figure + assumed + limit + source) > width:
        source = ""
    return (
        (figure, "bold"),
        (assumed, "$warning"),
        (limit, "$foreground-muted"),
        (source, "$primary"),
        (best, "$foreground-muted"),
    )


def _has_depth(report: TriggerReport) -> bool:
    """Whether there is a depth camera, so that one asks which source measured."""
    return report.depth_distance_m is not None or report.depth_fault is not None


def _on_its_side(distance_m: float, threshold_m: float) -> float:
    """In cm, rounded to a millimetre, but never over to the threshold's other side."""
    millimetres = distance_m * 1000
    return (math.floor(millimetres) if distance_m < threshold_m else math.ceil(millimetres)) / 10


def _gauge_line(report: TriggerReport, width: int) -> Line:
    style = "$success" if report.pressed else "$primary"
    blind_m = report.press_zone.followed_from_m if report.press_zone else 0.0
    safe_m, best_m, sd_m = report.safe_distance_m, report.distance_m, report.distance_sd_m
    return plain(gauge(safe_m, sd_m, report.threshold_m, width, blind_m=blind_m, best_m=best_m), style)


def _button(report: TriggerReport | None, press_note: PressNote, width: int) -> Line:
    if report is not None and report.pressed:
        withdraw = tr("button.withdraw", gesture=tr(report.gesture) if report.gesture else "")
        return fitted([(f" ◉ {tr('button.pressed')} ", "bold reverse $success"), (f" {withdraw}", "$success")], width)
    released = (f" ○ {tr('button.released')} ", "bold $foreground-muted")
    return (released, *(plain(f" {part}", "$warning")[0] for part in wrapped(why_nothing(press_note), width - 14)[:1]))


def why_nothing(press_note: PressNote) -> str:
    """Why a push gave no command."""
    if press_note.reason is None:
        return ""
    return tr("button.cancelled", reason=press_note.reason) if press_note.cancelled else render(press_note.reason)


def _zone(report: TriggerReport, width: int) -> Lines:
    """Where a press works before this camera; it stands below the button, where there is room for it."""
    zone = report.press_zone
    if zone is None:
        return ()
    style = "$foreground-muted" if zone.fits(report.threshold_m) else "bold $warning"
    return tuple(plain(part, style) for part in wrapped(zone_text(zone, report.threshold_m), width))


def zone_text(zone: PressZone, threshold_m: float) -> str:
    """Where a press works, in a line."""
    if not zone.possible:
        return tr("distance.zone_impossible", near=f"{zone.followed_from_m * 100:.0f}")
    near, proposed = f"{zone.followed_from_m * 100:.0f}", f"{zone.threshold_m * 100:.0f}"
    text = tr("distance.zone", near=near, far=f"{zone.visible_to_m * 100:.0f}")
    return text if zone.fits(threshold_m) else f"{text} · {tr('distance.proposed', cm=proposed)}"


class DistancePanel(DrawnPanel):
    """Distance, push and button."""

    DRAWN_HZ = 8.0

    def __init__(self, id: str | None = None, title: str = "") -> None:  # noqa: A002 - Textual's own name
        super().__init__(id, title)
        self._push = Push()

    def show(self, state: SessionState) -> None:
        """Draw the newest report."""
        report, why = state.report, why_nothing(state.press_note)
        if report is not None:
            self._push.take(report, why)
        pressed = report is not None and (report.pressed, report.release_count)
        if self.due(state.now_ns, (pressed, why, state.report_fresh)):
            width, height = self.content_size
            self.lines = distance_lines(state, max(10, width), height, self._push)
