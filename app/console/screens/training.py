"""Training: the twelve gestures one after the other, before any motor is on. Gestures are never armed here."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import zip_longest
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import Label

from app.console import keys
from app.console.lessons import LESSONS, Lesson, Score, advance, wrong_fingers
from app.console.screens.hand_keys import HandKeys
from app.console.session_index import TrainingRecord
from app.console.state import SessionState
from app.console.widgets.gesture import DistancePanel, GesturePanel
from app.console.widgets.hand import draw_hand
from app.console.widgets.letters import large
from app.console.widgets.panel import DrawnPanel, Lines, Panel, cells, fitted, padded, plain
from app.console.widgets.picture import Picture
from app.ipc.messages import TriggerReport
from app.ipc.states import ACTION_OF
from app.text.catalogue import render, tr
from kgdfa.gesture import FINGER_STATES
from profiles.schema import HandUsed


def feedback(lesson: Lesson, report: TriggerReport | None) -> Lines:
    """What to do next, down to the finger."""
    target = lesson.target
    if target is None:
        return (plain(tr("training.finished"), "bold $success"),)
    if report is None or not report.hand:
        refusal = report.hand_refusal if report is not None else None
        return (plain(render(refusal) if refusal else tr("training.show", gesture=tr(target)), "bold $primary"),)
    if report.gesture is target and report.pressed:
        return (plain(tr("training.withdraw"), "bold $success"),)
    if report.gesture is target:
        return (plain(tr("training.push"), "bold $success"),)
    wrong = tuple(finger for finger, _ in wrong_fingers(target, report))
    named = tuple(
        plain(f"✗ {tr(finger)}: {tr(f'training.{FINGER_STATES[target][finger].value}')}", "bold $warning")
        for finger in wrong
    )
    if report.raw_gesture in (None, target):  # nearly right: what the rules measured
        why = render(report.explanation) if report.explanation else tr("training.hold")
        return (*named, plain(why, "$warning"))
    return named


_LARGE_ROWS = 3  # the least that a large figure takes
_FIGURE = 0.4  # of the width, at most


def score_lines(score: Score, width: int, height: int) -> Lines:
    """Gestures in a row as a large figure, and the best so far beside it; in a line where there is no room."""
    best = plain(
        tr("training.record" if score.record else "training.best", best=score.best),
        "bold $success" if score.record else "",
    )
    former = plain("" if score.former is None else tr("training.former", best=score.former), "$foreground-muted")
    row = plain(tr("training.row"), "bold $primary")
    figure = large(str(score.row), round(_FIGURE * width), height)
    if height < _LARGE_ROWS or not figure:
        parts = (plain(str(score.row), "bold $primary"), row, best, former)
        return (fitted([(f"{part[0][0]}  ", part[0][1]) for part in parts], width),)
    across = max(map(cells, figure)) + 2
    return tuple(
        ((padded(drawn or "", across), "bold $primary"), *fitted(beside or (), width - across))
        for drawn, beside in zip_longest(figure, (row, best, former))
    )


class TrainingScreen(HandKeys):
    """Picture on the left, the hand to copy on the right, the score below it."""

    HELP_PAGE = "training"
    BINDINGS: ClassVar[list[BindingType]] = [
        *keys.HAND,
        Binding("tab", "skip", "bind.training.skip"),
        Binding("e", "end_session", "bind.end"),
        Binding("escape", "end_session", "bind.end", show=False),
    ]

    def __init__(self, patient: str) -> None:
        """patient: whose score it is."""
        super().__init__()
        self._patient = patient
        self._lesson = Lesson()

    def compose(self) -> ComposeResult:
        yield Label("", id="title")
        with Horizontal(id="training"):
            with Vertical(id="seen"):
                yield Picture(id="picture")
                yield GesturePanel(id="gesture", title=tr("panel.gesture"))
                yield DistancePanel(id="distance", title=tr("panel.distance"))
            with Vertical(id="wanted"):
                yield DrawnPanel(id="hand")
                yield Panel(id="feedback")
                yield DrawnPanel(id="score")
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        with self.notify_errors():
            former = max((record.best for record in self.console_app.trainings.of(self._patient)), default=None)
            self._lesson = Lesson(score=Score(former=former))

    def on_unmount(self) -> None:
        """Keep the score, however the training ends; one without a gesture is none."""
        lesson = self._lesson
        if lesson.learnt:
            at = datetime.now(UTC).isoformat(timespec="seconds")
            record = TrainingRecord(patient=self._patient, at=at, best=lesson.score.best, learnt=lesson.learnt)
            with self.notify_errors():
                self.console_app.trainings.add(record)

    def follow(self, state: SessionState) -> None:
        if state.report is not None and state.report_fresh:
            self._lesson = advance(self._lesson, state.report)
        self.query_one(GesturePanel).show(state)
        self.query_one(DistancePanel).show(state)
        self._draw(state)

    def action_skip(self) -> None:
        """On to the next gesture, after the last one to another round."""
        self._lesson = self._lesson.skipped()

    async def action_end_session(self) -> None:
        """Back to the list; nothing moved, so nothing is asked."""
        await self.console_app.close_session()

    def _draw(self, state: SessionState) -> None:
        lesson, target = self._lesson, self._lesson.target
        report = state.report if state.report_fresh else None
        title = tr("training.title", patient=self._patient, done=lesson.done, all=len(LESSONS))
        if target is not None:
            title += "  " + tr("training.lesson", gesture=tr(target), action=tr(ACTION_OF[target]))
        self.query_one("#title", Label).update(title)
        hand, score = self.query_one("#hand", DrawnPanel), self.query_one("#score", DrawnPanel)
        self.query_one("#feedback", Panel).lines = feedback(lesson, report)
        score.lines = score_lines(lesson.score, *score.content_size)
        if target is None or not hand.content_size.area:
            hand.lines = ()
            return
        hand.lines = draw_hand(
            target,
            *hand.content_size,
            wrong_fingers(target, report),
            right=report is not None and report.gesture is target,
            left_hand=state.setup.profile.hand is HandUsed.LEFT,
        )
