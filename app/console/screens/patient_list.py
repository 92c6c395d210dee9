"""The patients' list: type to search, s sorts; beside it the details of the patient under the cursor."""

from __future__ import annotations

from datetime import UTC, datetime

from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.events import Resize
from textual.widgets import DataTable, Input, Label, Static

from app.console.screens.base import ConsoleScreen
from app.console.session_index import SessionRecord
from app.console.state import SessionState
from app.console.widgets.patient_details import PatientOrder, describe, in_order, last_cells
from app.system.errors import AppError
from app.text.catalogue import render, tr
from profiles.schema import Profile
from profiles.store import Change

HEADED_FROM = 8  # rows of the terminal, from which the list has room for its header


class PatientList(ConsoleScreen):
    """All patients, and details of the one under the cursor."""

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

    def action_order(self) -> None:
        """Another order; the cursor goes to the first."""
        orders = list(PatientOrder)
        self._order = orders[(orders.index(self._order) + 1) % len(orders)]
        self._fill()
        self.query_one(DataTable).move_cursor(row=0)

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
