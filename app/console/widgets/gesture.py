"""The gesture panel: what the hand says, how sure, how many votes, and when none, why."""

from __future__ import annotations

from app.console.sentences import sentence
from app.console.state import SessionState
from app.console.terms import FINGERS, action_of, gesture_name
from app.console.widgets.panel import Lines, StatePanel, bar, plain
from app.ipc.messages import TriggerReport
from app.text.catalogue import tr

VOTES_NEEDED = 3  # the paper's vote


def describe(state: SessionState) -> Lines:
    """Four lines; the last two are the reason."""
    report = state.report
    if report is None:
        return (plain(tr("gesture.waiting"), "$text-muted"),)
    if not state.report_fresh:
        return (plain(tr("gesture.stale"), "bold $error"),)
    if report.camera_fault:
        return (plain(tr("gesture.no_picture"), "bold $error"), plain(sentence(report.camera_fault)))
    why = report.hint or (report.explanation if report.gesture is None else "")
    return (_headline(report), _votes(report), plain(sentence(why), "$text-muted"))


def _headline(report: TriggerReport) -> tuple[tuple[str, str], ...]:
    if report.gesture is not None:
        name = gesture_name(report.gesture)
        return (
            (f" {name} ", "bold reverse $primary"),
            (f" {FINGERS[report.gesture]} ", "bold"),
            (action_of(report.gesture), "bold $primary"),
        )
    return plain(tr("gesture.none") if report.hand else tr("gesture.no_hand"), "bold $text-muted")


def _votes(report: TriggerReport) -> tuple[tuple[str, str], ...]:
    votes = min(report.votes, VOTES_NEEDED)
    raw = gesture_name(report.raw_gesture) if report.raw_gesture else "–"
    return (
        (tr("gesture.votes", raw=raw), ""),
        (" ●" * votes + " ○" * (VOTES_NEEDED - votes) + "  ", "$primary"),
        (bar(report.confidence, 8), "$primary"),
        (f" {report.confidence:4.0%}", ""),
    )


class GesturePanel(StatePanel):
    """Gesture, votes, confidence, reason."""

    def show(self, state: SessionState) -> None:
        """Draw the newest report."""
        self.show_lines(describe(state))
