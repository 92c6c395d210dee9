"""Guided enrolment of the gestures that a patient can make. Nothing is armed; the result is kept only on Ctrl-S."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.widgets import Label

from app.console import keys
from app.console.lessons import wrong_fingers
from app.console.screens.hand_keys import HandKeys
from app.console.state import SessionState
from app.console.widgets.gesture import GesturePanel
from app.console.widgets.hand import draw_hand
from app.console.widgets.panel import DrawnPanel, Line, Lines, Panel, bar, plain
from app.console.widgets.picture import Picture
from app.ipc.messages import TriggerReport
from app.system.operators import Permission
from app.system.vocabulary import enrolment_record, recognition_hash, with_evidence
from app.text.catalogue import render, tr
from kgdfa.gesture import Explanation, HandRefusal
from kgdfa.vocabulary import (
    LEAD_FRAMES,
    PARTS,
    Frame,
    GestureCounts,
    VocabularyEnrolment,
    VocabularyFault,
    VocabularyProof,
    abandon,
    leave_out,
    prove,
    update_enrolment,
)
from logs.reason import key_of, reason_of
from profiles.schema import HandUsed, Profile
from profiles.store import ChangeCause

OTHER_HANDS = {
    key_of(one) for one in (HandRefusal.TWO_HANDS, HandRefusal.OTHER_SIDE, HandRefusal.OTHER_ARM, HandRefusal.OVERLAP)
}
# The hand in view may be another one: it gives no gesture in a session, and so proves none here.
UNKNOWN_HANDS = {key_of(one) for one in (HandRefusal.SIDE_UNCLEAR, HandRefusal.JUMPED)}
BAR_CELLS = 20


def frame_of(report: TriggerReport) -> Frame:
    """What the enrolment counts of a report."""
    refused = report.hand_refusal.code if report.hand_refusal is not None else ""
    return Frame(
        hand=report.hand and refused not in OTHER_HANDS | UNKNOWN_HANDS,
        gesture=report.raw_gesture,
        other_hand=refused in OTHER_HANDS,
    )


def guide_lines(state: VocabularyEnrolment, report: TriggerReport | None) -> Lines:
    """What to show now, and how far the part is."""
    sample = state.sample
    what = tr("vocabulary.show", gesture=tr(sample.gesture)) if sample.gesture else tr("vocabulary.idle")
    lines = [plain(what, "bold $primary")]
    if report is None or not frame_of(report).hand:
        refusal = report.hand_refusal if report is not None else None
        lines.append(plain(render(refusal) if refusal else tr("gesture.no_hand"), "$warning"))
    elif state.lead < LEAD_FRAMES:
        lines.append(plain(tr("vocabulary.form"), "$foreground-muted"))
    else:
        lines.append(plain(f"{bar(sample.frames / sample.wanted, BAR_CELLS)} {sample.frames}/{sample.wanted}"))
    if sample.gesture is not None:
        lines.append(plain(tr("vocabulary.leave_out"), "$foreground-muted"))
    return tuple(lines)


def result_lines(result: VocabularyProof | Explanation) -> Lines:
    """What is proven with its bounds, or why nothing is."""
    if isinstance(result, Explanation):
        return (plain(f"✗ {render(reason_of(result))}", "bold $error"), plain(tr("vocabulary.old_stays")))
    counts = (_counts_line(one, commands=one.gesture in result.vocabulary) for one in result.gestures)
    taken, frames, bound = result.idle_taken, result.idle_frames, result.idle_at_most
    idle = plain(tr("vocabulary.idle_result", taken=taken, frames=frames, bound=bound))
    return (plain(tr("vocabulary.result"), "bold"), *counts, idle, plain(tr("vocabulary.keep"), "bold $success"))


def _counts_line(one: GestureCounts, *, commands: bool) -> Line:
    counts = tr(
        "vocabulary.counts",
        recognised=one.recognised,
        frames=one.frames,
        least=one.recognised_at_least,
        mistaken=one.mistaken,
        most=one.mistaken_at_most,
    )
    mark, style = ("✓", "bold $success") if commands else ("✗", "bold $warning")
    return ((f" {mark} {tr(one.gesture):>4}  ", style), (counts, ""))


class VocabularyScreen(HandKeys):
    """Image on the left, what to show on the right. Tab leaves a gesture out, Ctrl-S keeps, Escape leaves."""

    HELP_PAGE = "vocabulary"
    BINDINGS: ClassVar[list[BindingType]] = [
        *keys.HAND,
        Binding("tab", "leave_out", "bind.vocabulary.leave_out"),
        Binding("ctrl+s", "keep", "bind.vocabulary.keep"),
        Binding("escape", "end_enrolment", "bind.end"),
    ]

    def __init__(self, profile: Profile) -> None:
        super().__init__()
        self._profile = profile
        self._enrolment = VocabularyEnrolment()
        self._captured_ns = 0
        self._result: VocabularyProof | Explanation | None = None
        self._recorded = False  # kept or refused

    def compose(self) -> ComposeResult:
        yield Label("", id="title")
        with Horizontal(id="training"):
            with Vertical(id="seen"):
                yield Picture(id="picture")
                yield GesturePanel(id="gesture", title=tr("panel.gesture"))
            with Vertical(id="wanted"):
                yield DrawnPanel(id="hand")
                yield Panel(id="enrolment")
        yield from self.compose_bottom()

    def follow(self, state: SessionState) -> None:
        report = state.report
        fresh = report is not None and state.report_fresh and report.detector_ready
        if report is not None and fresh and report.captured_ns > self._captured_ns:
            self._captured_ns = report.captured_ns
            self._take(update_enrolment(self._enrolment, frame_of(report)))
        self.query_one(GesturePanel).show(state)
        lines = result_lines(self._result) if self._result is not None else guide_lines(self._enrolment, report)
        self.query_one("#enrolment", Panel).lines = lines
        self._draw(state)

    def action_leave_out(self) -> None:
        """The patient can't make this gesture: it is not tried any more."""
        self._take(leave_out(self._enrolment))

    async def action_keep(self) -> None:
        """Into the profile, with its evidence."""
        result = self._result
        if not isinstance(result, VocabularyProof):
            self.notify(tr("vocabulary.nothing"), severity="warning")
            return
        await self.console_app.permitted(Permission.EDIT_PATIENTS, lambda: self._keep(result))

    async def action_end_enrolment(self) -> None:
        """Back to the list; what was not kept is recorded as refused."""
        self.discard()
        await self.console_app.close_session()

    def keep(self) -> bool:
        return self._recorded or not isinstance(self._result, VocabularyProof)

    def discard(self) -> None:
        self._take(abandon(self._enrolment))
        if not self._recorded:
            self._refuse(Explanation(VocabularyFault.ABANDONED))

    async def _keep(self, proof: VocabularyProof) -> None:
        app, now = self.console_app, datetime.now(UTC)
        with self.notify_errors():
            setup = app.live_setup()
            model, hand = recognition_hash(setup.config), setup.profile.hand
            profile = with_evidence(app.store.load(self._profile.identifier), proof, model, now, hand)
            app.store.save(profile, by=app.authority, at=now, why=ChangeCause.ENROLLED.key)
            app.trail.emit(enrolment_record(profile))
            self._recorded = True
            self.notify(tr("vocabulary.kept"))
            await app.close_session()

    def _take(self, enrolment: VocabularyEnrolment) -> None:
        """The newest state; at its end the result, and a refusal into the trail, once."""
        self._enrolment = enrolment
        if not enrolment.ended or self._result is not None:
            return
        self._result = enrolment.fault or prove(enrolment.samples)
        if isinstance(self._result, Explanation):
            self._refuse(self._result)

    def _refuse(self, why: Explanation) -> None:
        self._recorded = True
        self.console_app.trail.emit(enrolment_record(self._profile, why))

    def _draw(self, state: SessionState) -> None:
        target = None if self._result is not None else self._enrolment.sample.gesture
        place, name = min(self._enrolment.place + 1, len(PARTS)), self._profile.identifier
        self.query_one("#title", Label).update(tr("vocabulary.title", name=name, part=place, parts=len(PARTS)))
        hand = self.query_one("#hand", DrawnPanel)
        self.set_class(self._result is not None, "-result")
        if target is None:
            hand.lines = ()
        if target is None or not hand.content_size.area:
            return
        report = state.report if state.report_fresh else None
        hand.lines = draw_hand(
            target,
            *hand.content_size,
            wrong_fingers(target, report),
            right=report is not None and report.raw_gesture is target,
            left_hand=self._profile.hand is HandUsed.LEFT,
        )
