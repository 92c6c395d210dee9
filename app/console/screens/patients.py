"""The patients' list: type to search, s sorts, Enter begins; nothing is ever deleted."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import ClassVar, TypeVar

import msgspec
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.events import Resize
from textual.screen import Screen
from textual.widgets import DataTable, Input, Label, Static

from app.console import keys
from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import AskText, History, Question
from app.console.screens.patient_form import PatientForm
from app.console.screens.start import StartSession
from app.console.session_index import SessionRecord
from app.console.state import SessionState
from app.console.widgets.patient_details import PatientOrder, describe, in_order, last_cells
from app.system.errors import AppError
from app.system.operators import Permission
from app.text.catalogue import render, tr
from logs.reading.regular import path_named
from profiles.schema import DEMO_PATIENT, Profile
from profiles.store import Change

T = TypeVar("T")

HEADED_FROM = 8  # rows of the terminal, from which the list has room for its header
# What an observer may not do.
CHANGES = {"new", "edit", "duplicate", "archive", "import_profile", "begin", "training", "calibrate", "vocabulary"}


class PatientsScreen(ConsoleScreen):
    """All patients, details of the one under the cursor, and what can be done."""

    HELP_PAGE = "patients"
    BINDINGS: ClassVar[list[BindingType]] = list(keys.PATIENTS)

    def __init__(self) -> None:
        super().__init__()
        self._profiles: dict[str, Profile] = {}
        self._sessions: dict[str, tuple[SessionRecord, ...]] = {}
        self._search = ""
        self._order = PatientOrder.IDENTIFIER
        self._title_shown = ""
        self._shown = ""  # whose details stand beside the list

    def compose(self) -> ComposeResult:
        yield Label(id="title")
        yield Input(
            placeholder=tr("patients.search", **self.console_app.key_names), id="search", compact=True, max_length=200
        )
        with Horizontal(id="patients"):
            yield DataTable[str](id="list", cursor_type="row", zebra_stripes=True)
            with VerticalScroll(id="details", can_focus=False):
                yield Static(id="about")
        yield Static(id="broken", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.fill()
        self.query_one(DataTable).focus()

    def on_resize(self, event: Resize) -> None:
        """Where there is room for one row, it is a patient's."""
        self.query_one(DataTable).show_header = event.size.height >= HEADED_FROM

    def fill(self) -> None:
        """Columns, rows, and the patient that the cursor was on."""
        table = self.query_one(DataTable)
        for name in ("identifier", "last", "steps", "sex", "stature", "mass", "hand"):
            table.add_column(tr(f"patients.{name}"), key=name)
        self._title_shown = ""
        self.reload()

    def on_screen_resume(self) -> None:
        if self._profiles:
            self.reload()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        operator = self.console_app.signed_in
        who = "" if operator is None else f" · {operator.name}, {tr(operator.role or '')}"
        title = f"{tr('patients.title', order=tr(self._order), **self.console_app.key_names)}{who}"
        if title != self._title_shown:
            self._title_shown = title
            self.query_one("#title", Label).update(title)

    def reload(self) -> None:
        """Read the folder again."""
        listing, before = self.console_app.store.list(archived=True), self._profiles.keys()
        self._profiles = {profile.identifier: profile for profile in listing.profiles}
        added = self._profiles.keys() - before
        if before and len(added) == 1:  # made just now, and what comes next is meant for this patient
            (self._shown,) = added
            made = self._profiles[self._shown]
            if made not in self._found():  # the search was for somebody else; only one by name finds who is archived
                self._search = self.query_one("#search", Input).value = made.identifier if made.archived else ""
        faults = [error for _, error in listing.broken] + self._read_sessions()
        broken = "\n".join(f"✗ {render(error)}" for error in faults)
        self.query_one("#broken", Static).update(broken)
        self.query_one("#broken").display = bool(broken)
        self._fill()

    def _read_sessions(self) -> list[Exception]:
        """What each patient's sessions came to; the faults of files that can't be read."""
        faults: list[Exception] = []
        self._sessions = {}
        for name in self._profiles:
            try:
                self._sessions[name] = self.console_app.sessions.of(name)
            except AppError as error:
                faults.append(error)
        return faults

    def on_input_changed(self, event: Input.Changed) -> None:
        self._search = event.value
        self._fill()

    def on_input_submitted(self) -> None:
        self.query_one(DataTable).focus()

    def key_escape(self) -> None:
        """From the search field back to the list, as after Enter."""
        self.query_one(DataTable).focus()

    def on_data_table_row_highlighted(self) -> None:
        self._show_details()

    def on_data_table_row_selected(self) -> None:
        self.action_begin()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """An observer changes nothing; letters typed into the search are letters."""
        return not (self.console_app.read_only and action in CHANGES)

    def action_begin(self) -> None:
        """On with the patient under the cursor: hardware, then the session."""
        if profile := self._stored():
            self.app.push_screen(StartSession(profile))

    async def action_new(self) -> None:
        """A new patient."""
        await self._edit(PatientForm)

    async def action_edit(self) -> None:
        """Change the patient under the cursor."""
        if profile := self._stored():
            await self._edit(lambda: PatientForm(profile))

    async def action_duplicate(self) -> None:
        """A copy under another identifier."""
        if profile := self._chosen():
            name = profile.identifier
            asked = (lambda: tr("patients.duplicate_title"), lambda: tr("patients.duplicate_text", name=name))
            await self._edit(lambda: AskText(*asked), self._duplicate)

    async def action_archive(self) -> None:
        """Out of the daily list, or back into it."""
        profile = self._chosen()
        if profile is None:
            return
        key, name = "patients.unarchive" if profile.archived else "patients.archive", profile.identifier
        asked = (lambda: tr(f"{key}_title"), lambda: tr(f"{key}_text", name=name))
        await self._edit(lambda: Question(*asked), self._archive)

    def action_history(self) -> None:
        """What changed, when, by whom."""
        if profile := self._chosen():
            with self.notify_errors():
                changes = self.console_app.store.history(profile.identifier)
                self.app.push_screen(History(profile.identifier, changes))

    def action_outcomes(self) -> None:
        """What the sessions came to, over time."""
        from app.console.screens.outcomes import OutcomesPage  # MCAP: only for who asks for it

        if profile := self._chosen():
            self.app.push_screen(OutcomesPage(self.console_app.home, profile.identifier))

    def action_export(self) -> None:
        """A copy as a file."""
        if profile := self._chosen():
            name = profile.identifier
            asked = (lambda: tr("patients.export_title"), lambda: tr("patients.export_text", name=name))
            self.app.push_screen(AskText(*asked, f"{name}.toml"), self._export)

    async def action_import_profile(self) -> None:
        """Take in an exported file."""
        asked = (lambda: tr("patients.import_title"), lambda: tr("patients.import_text"))
        await self._edit(lambda: AskText(*asked), self._import)

    async def action_calibrate(self) -> None:
        """The patient's palm before the configured camera."""
        if profile := self._stored():
            await self.console_app.calibrate(profile)

    async def action_vocabulary(self) -> None:
        """Which gestures this patient can make."""
        if profile := self._stored():
            await self.console_app.begin_enrolment(profile)

    async def action_training(self) -> None:
        """The twelve gestures with the patient's hand, before any motor is on."""
        if profile := self._stored() if self._chosen() else DEMO_PATIENT:
            await self.console_app.begin_training(profile)

    def action_review(self) -> None:
        """Earlier sessions."""
        from app.console.screens.review import ReviewScreen

        self.app.push_screen(ReviewScreen(self.console_app.home))

    def action_order(self) -> None:
        """Another order; the cursor goes to the first."""
        orders = list(PatientOrder)
        self._order = orders[(orders.index(self._order) + 1) % len(orders)]
        self._fill()
        self.query_one(DataTable).move_cursor(row=0)

    def action_search(self) -> None:
        """To the search field."""
        self.query_one("#search", Input).focus()

    async def _edit(self, make: Callable[[], Screen[T]], then: Callable[[T | None], None] | None = None) -> None:
        """Open what changes patients, for those who may."""
        app = self.console_app
        await app.permitted(Permission.EDIT_PATIENTS, lambda: app.push_screen(make(), then))

    def _chosen(self) -> Profile | None:
        table = self.query_one(DataTable)
        if not table.row_count:
            return None
        return self._profiles.get(str(table.coordinate_to_cell_key(table.cursor_coordinate).row_key.value))

    def _stored(self) -> Profile | None:
        """The one under the cursor as it is now: the command line may have changed it since the list was read."""
        if profile := self._chosen():
            with self.notify_errors():
                return self.console_app.store.load(profile.identifier)
        return None

    def _fill(self) -> None:
        table, shown = self.query_one(DataTable), self._shown
        table.clear()
        now = datetime.now(UTC)
        for profile in self._found():
            sessions = self._sessions.get(profile.identifier, ())
            table.add_row(*_row(profile, last_cells(sessions, now)), key=profile.identifier)
        if shown in table.rows:  # the rows before it may be others now
            table.move_cursor(row=table.get_row_index(shown))
        self._show_details()

    def _found(self) -> list[Profile]:
        wanted = self._search.casefold().split()
        last_at = {name: of[-1].at if (of := self._sessions.get(name)) else "" for name in self._profiles}
        profiles = [self._profiles[name] for name in in_order(self._order, last_at)]
        return [
            profile
            for profile in profiles
            if all(part in f"{profile.identifier} {profile.note}".casefold() for part in wanted)
            and (not profile.archived or wanted)
        ]

    def _show_details(self) -> None:
        profile = self._chosen()
        about = self.query_one("#about", Static)
        if profile is None:
            about.update(tr("patients.nobody"))
            return
        self._shown = profile.identifier
        changes: tuple[Change, ...] = ()
        with self.notify_errors():
            changes = self.console_app.store.history(profile.identifier)
        sessions = self._sessions.get(profile.identifier, ())
        about.update(describe(profile, changes, sessions, datetime.now(UTC)))

    def _duplicate(self, name: str | None) -> None:
        if name and (profile := self._chosen()):
            # Calibrations and evidence prove something of this person's hand.
            copy = msgspec.structs.replace(profile, identifier=name, archived=False, calibrations=(), evidence=None)
            with self.notify_errors():
                self.console_app.store.create(copy, by=self.console_app.authority, at=datetime.now(UTC))
            self.reload()

    def _archive(self, yes: bool | None) -> None:
        if yes and (profile := self._chosen()):
            with self.notify_errors():
                app, archived = self.console_app, not profile.archived
                app.store.archive(profile.identifier, by=app.authority, at=datetime.now(UTC), archived=archived)
            self.reload()

    def _export(self, typed: str | None) -> None:
        if typed and (profile := self._chosen()):
            with self.notify_errors():
                path = path_named(typed)
                self.console_app.store.export(profile.identifier, path)
                self.notify(tr("patients.exported", path=path.absolute()))

    def _import(self, typed: str | None) -> None:
        if typed:
            with self.notify_errors():
                path = path_named(typed)
                profile = self.console_app.store.import_file(path, by=self.console_app.authority, at=datetime.now(UTC))
                self.notify(tr("patients.imported", name=profile.identifier))
            self.reload()


def _row(profile: Profile, last: tuple[str, str]) -> tuple[str, ...]:
    archived = f" ({tr('patients.archived')})" if profile.archived else ""
    return (
        profile.identifier + archived,
        *last,
        tr(profile.sex),
        f"{profile.stature_m * 100:.0f} cm",
        f"{profile.mass_kg:.0f} kg",
        tr(profile.hand),
    )
