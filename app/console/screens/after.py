"""After the session: its figures, the therapist's note, the patient's ratings, the next targets."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import ClassVar

import msgspec
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Button, Input, Label, Select, Static

from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import ask
from app.console.session_index import SessionRecord
from app.console.state import SessionState
from app.console.widgets.text_field import TextField
from app.system.operators import Permission
from app.text.catalogue import tr
from app.text.recorded import result_text
from logs.records import Discomfort, Exertion, Note, Pain, Rating
from profiles.schema import Profile
from profiles.store import ChangeCause

# What the patient is asked for: field of SessionRecord, record of the trail, ratings.
RATINGS: tuple[tuple[str, type[Rating], range], ...] = (
    ("discomfort", Discomfort, range(11)),
    ("pain", Pain, range(11)),
    ("exertion", Exertion, range(6, 21)),
)
GROWTH = 1.1  # the next target after one that was reached: a tenth more; a proposal that the therapist may change


def summarise(state: SessionState, at: str) -> SessionRecord:
    """The session in figures."""
    snapshot = state.snapshot
    return SessionRecord(
        session=state.setup.session,
        patient=state.setup.profile.identifier,
        at=at,
        operator=state.setup.operator,
        steps=snapshot.steps if snapshot else 0,
        distance_m=snapshot.distance_walked_m if snapshot else 0.0,
        duration_s=state.elapsed_s,
        refusals=snapshot.refusal_count if snapshot else 0,
    )


def _wording(name: str, rating: int) -> str:
    return tr(f"borg.{rating}") if name == "exertion" else tr(f"rating.{rating}")


class AfterScreen(ConsoleScreen):
    """The joints are off; the trail is still open, so that note and rating are part of it."""

    HELP_PAGE = "after"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "save", "bind.after.save"),
        Binding("escape", "leave", "bind.form.leave", show=False),
    ]

    def __init__(self, state: SessionState) -> None:
        super().__init__()
        self._state = state
        self._added = self._saved = self._ending = False
        self._record = summarise(state, datetime.now(UTC).isoformat(timespec="seconds"))

    def compose(self) -> ComposeResult:
        profile = self._state.setup.profile
        target = profile.dose.steps
        steps = round(target * GROWTH) if self._record.steps >= target else target
        yield Label(tr("after.title", name=profile.identifier), id="title")
        yield Static(id="unwritten", classes="error", markup=False)
        with VerticalScroll(id="after"):
            yield Static(self._figures(profile), markup=False)
            for name, _, ratings in RATINGS:
                yield Label(tr(f"after.{name}"), classes="section")
                options = [(_wording(name, rating), rating) for rating in ratings]
                yield Select(options, prompt=tr("after.not_asked"), id=name, compact=True)
            yield Label(tr("after.note"), classes="section")
            yield TextField(id="note", max_length=2000, compact=True)
            yield Label(tr("after.next"), classes="section")
            locked = not self.console_app.may(Permission.EDIT_PATIENTS)
            yield Input(str(steps), id="steps", restrict="[0-9]*", max_length=6, compact=True, disabled=locked)
            yield Label(tr("after.report", session=self._state.setup.session), classes="hint")
            yield Button(tr("after.save"), id="save", variant="primary")
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        # No text field: the yes of a question that did not come is no note. What was done stays in sight.
        self.query_one(f"#{RATINGS[0][0]}").focus(scroll_visible=False)

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        fault = state.audit.fault if state is not None and state.audit is not None else None
        text, shown = tr("after.unwritten", why=fault) if fault else "", self.query_one("#unwritten", Static)
        if state is not None and state.audit_silent:
            text = tr("after.no_trail")
        shown.display = bool(text)
        if shown.content != text:
            shown.update(text)

    async def on_button_pressed(self) -> None:
        await self.action_save()

    async def action_save(self) -> None:
        """Save note, rating and targets, then end the session's last processes; what can't be saved stays here."""
        if self._save():
            await self._close()

    async def action_leave(self) -> None:
        """As saving does; where that fails, without it, after asking."""
        if self._save():
            await self._close()
        else:
            ask(self.app, lambda: tr("form.leave_title"), lambda: tr("form.leave_text"), self._close)

    def keep(self) -> bool:
        if self._save() and not self._ending:
            self._tell_trail()
        return self._saved

    def _save(self) -> bool:
        """Whether all is in the files."""
        with self.notify_errors():
            self._save_targets()  # first: while they are refused, the note may still be changed
            self._add()
            self._saved = True
        return self._saved

    def _add(self) -> None:
        if not self._added:
            record = msgspec.structs.replace(self._record, note=self._note(), **self._ratings())
            self.console_app.sessions.add(record)
            self._added = True

    async def _close(self) -> None:
        """To the list; it may take seconds until the trail's process has ended."""
        if not self._ending:
            self.discard()
            await self.console_app.close_session()

    def discard(self) -> None:
        """Only the targets: the session belongs in the list all the same."""
        if not self._ending:
            with self.notify_errors():
                self._add()
            self._tell_trail()

    def _tell_trail(self) -> None:
        """Note and ratings into the trail too."""
        self._ending = True
        if note := self._note():
            self.console_app.trail.emit(Note(text=note))
        given = self._ratings()
        for name, record, _ in RATINGS:
            if name in given:
                self.console_app.trail.emit(record(rating=given[name]))

    def _note(self) -> str:
        return self.query_one("#note", Input).value.strip()

    def _ratings(self) -> dict[str, int]:
        """Those that were asked for."""
        chosen = {name: self.query_one(f"#{name}", Select).value for name, *_ in RATINGS}
        return {name: rating for name, rating in chosen.items() if isinstance(rating, int)}

    def _save_targets(self) -> None:
        app, field, profile = self.console_app, self.query_one("#steps", Input), self._state.setup.profile
        if field.disabled or not field.value.isdigit() or int(field.value) == profile.dose.steps:
            return
        now = app.store.load(profile.identifier)
        dose = msgspec.structs.replace(now.dose, steps=int(field.value))
        changed = msgspec.structs.replace(now, dose=dose)
        app.store.save(changed, by=app.authority, at=datetime.now(UTC), why=ChangeCause.TARGETS.key)

    def _figures(self, profile: Profile) -> str:
        record, dose = self._record, profile.dose
        lines = [
            tr("after.steps", done=record.steps, target=dose.steps),
            tr("after.distance", done_m=record.distance_m, target_m=dose.distance_m),
            tr("after.time", done_min=record.duration_s / 60, target_min=dose.duration_s / 60),
            tr("after.refusals", count=record.refusals),
        ]
        lines += [result_text(result) for result in self.console_app.guided.results]
        reports = self._state.snapshot.reports if self._state.snapshot else ()
        lines += [f"  {tr(one.action)}: {tr(one.outcome)}" for one in reports[-5:]]
        return "\n".join(lines)
