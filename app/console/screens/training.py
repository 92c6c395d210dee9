"""Training: the twelve gestures one after the other, before any motor is on. Gestures are never armed here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import Label, Static

from app.console import keys
from app.console.screens.session import HandKeys
from app.console.state import SessionState
from app.console.widgets.drawing import differences, draw_hand
from app.console.widgets.gesture import DistancePanel, GesturePanel
from app.console.widgets.panel import Lines, Panel, plain
from app.console.widgets.picture import Picture
from app.ipc.messages import TriggerReport
from app.ipc.states import ACTION_OF
from app.text.catalogue import render, tr
from kgdfa.gesture import Gesture

LESSONS = tuple(Gesture)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesson:
    """How far the learner is; `done` counts lessons, each ends with a released push of its gesture."""

    done: int = 0
    releases_before: int | None = None

    @property
    def target(self) -> Gesture | None:
        """The gesture to show now; None when all twelve are learnt."""
        return LESSONS[self.done] if self.done < len(LESSONS) else None


def advance(lesson: Lesson, report: TriggerReport) -> Lesson:
    """The lesson after a report: a new release of the wanted gesture completes it."""
    if lesson.releases_before is None or report.release_count < lesson.releases_before:
        return replace(lesson, releases_before=report.release_count)
    learnt = report.release_count > lesson.releases_before and report.released_gesture is lesson.target
    return Lesson(done=lesson.done + learnt, releases_before=report.release_count)


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
    if report.raw_gesture is None or report.raw_gesture is target:
        why = render(report.explanation) if report.explanation else tr("training.hold")
        return (plain(why, "$warning"),)
    wrong = differences(target, report.raw_gesture)
    return tuple(plain(f"✗ {tr(finger)}: {tr(f'training.{want.value}')}", "$warning") for finger, want in wrong)


class TrainingScreen(HandKeys):
    """Picture on the left, the hand to copy on the right."""

    HELP_PAGE = "training"
    BINDINGS: ClassVar[list[BindingType]] = [
        *keys.HAND,
        Binding("tab", "skip", "bind.training.skip"),
        Binding("e", "end_session", "bind.end"),
        Binding("escape", "end_session", "bind.end", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._lesson = Lesson()
        self._drawn: Gesture | str | None = ""

    def compose(self) -> ComposeResult:
        yield Label("", id="title")
        with Horizontal(id="training"):
            with Vertical(id="seen"):
                yield Picture(id="picture")
                yield GesturePanel(id="gesture", title=tr("panel.gesture"))
                yield DistancePanel(id="distance", title=tr("panel.distance"))
            with Vertical(id="wanted"):
                yield Static(id="hand", markup=False)
                yield Panel(id="feedback")
        yield from self.compose_bottom()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        if state is None:
            return
        if state.report is not None and state.report_fresh:
            self._lesson = advance(self._lesson, state.report)
        self.query_one(Picture).show(state)
        self.query_one(GesturePanel).show(state)
        self.query_one(DistancePanel).show(state)
        self.query_one("#feedback", Panel).lines = feedback(self._lesson, state.report)
        self._draw()

    def on_picture_resized(self, event: Picture.Resized) -> None:
        """Ask for a picture of just this size."""
        self.console_app.live_host().send_to_perception(event.wanted)

    def on_resize(self) -> None:
        self._drawn = ""  # draw anew

    def action_skip(self) -> None:
        """On to the next gesture."""
        if self._lesson.target is not None:
            self._lesson = replace(self._lesson, done=self._lesson.done + 1)

    async def action_end_session(self) -> None:
        """Back to the list; nothing moved, so nothing is asked."""
        await self.console_app.close_session()

    def _draw(self) -> None:
        target = self._lesson.target
        if target is self._drawn:
            return
        self._drawn = target
        title = tr("training.title", done=self._lesson.done, all=len(LESSONS))
        if target is not None:
            title += "  " + tr("training.lesson", gesture=tr(target), action=tr(ACTION_OF[target]))
        self.query_one("#title", Label).update(title)
        hand = self.query_one("#hand", Static)
        rows = max(6, min(18, self.size.height - 9))
        hand.update(draw_hand(target, rows * 5 // 3, rows) if target is not None else "")
