"""The patients' list and one patient's history: type to search, Enter to begin; nothing is ever deleted."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import ClassVar, TypeVar

import msgspec
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.screen import Screen
from textual.widgets import DataTable, Input, Label, Static

from app.console import keys
from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import AskText, Lists, Question
from app.console.screens.patient_form import PatientForm
from app.console.screens.start import StartSession
from app.console.state import SessionState
from app.console.widgets.panel import Lines, plain
from app.console.widgets.patient_details import describe, field_name
from app.system.operators import Permission
from app.text.catalogue import knows, render, tr
from profiles.schema import DEMO_PATIENT, Profile
from profiles.store import Change

T = TypeVar("T")

# What an observer may not do.
CHANGES = {"new", "edit", "duplicate", "archive", "import_profile", "begin", "training", "calibrate", "vocabulary"}


class PatientsScreen(ConsoleScreen):
    """All patients, details of the one under the cursor, and what can be done."""

    HELP_PAGE = "patients"
    BINDINGS: ClassVar[list[BindingType]] = list(keys.PATIENTS)

    def __init__(self) -> None:
        super().__init__()
        self._profiles: dict[str, Profile] = {}
        self._search = ""
        self._operator_shown = ""
        self._shown = ""  # whose details stand beside the list

    def compose(self) -> ComposeResult:
        yield Label(tr("patients.title"), id="title")
        yield Input(placeholder=tr("patients.search"), id="search", compact=True, max_length=200)
        with Horizontal(id="patients"):
            yield DataTable[str](id="list", cursor_type="row", zebra_stripes=True)
            with VerticalScroll(id="details", can_focus=False):
                yield Static(id="about")
        yield Static(id="broken", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.fill()
        self.query_one(DataTable).focus()

    def fill(self) -> None:
        """Columns, rows, and the patient that the cursor was on."""
        table, chosen = self.query_one(DataTable), self._shown
        for name in ("identifier", "sex", "stature", "mass", "hand"):
            table.add_column(tr(f"patients.{name}"), key=name)
        self._operator_shown = ""
        self.reload()
        if chosen in table.rows:
            table.move_cursor(row=table.get_row_index(chosen))

    def on_screen_resume(self) -> None:
        if self._profiles:
            self.reload()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        operator = self.console_app.signed_in
        who = "" if operator is None else f" · {operator.name}, {tr(operator.role or '')}"
        if who != self._operator_shown:
            self._operator_shown = who
            self.query_one("#title", Label).update(tr("patients.title") + who)

    def reload(self) -> None:
        """Read the folder again."""
        listing = self.console_app.store.list(archived=True)
        self._profiles = {profile.identifier: profile for profile in listing.profiles}
        broken = "\n".join(f"✗ {render(error)}" for _, error in listing.broken)
        self.query_one("#broken", Static).update(broken)
        self._fill()

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
        changes = {
            "new",
            "edit",
            "duplicate",
            "archive",
            "import_profile",
            "begin",
            "training",
            "calibrate",
            "vocabulary",
        }
        return not (self.console_app.read_only and action in changes)

    def action_begin(self) -> None:
        """On with the patient under the cursor: hardware, then the session."""
        profile = self._chosen()
        if profile is not None:
            self.app.push_screen(StartSession(profile))

    async def action_new(self) -> None:
        """A new patient."""
        await self._edit(PatientForm)

    async def action_edit(self) -> None:
        """Change the patient under the cursor."""
        profile = self._chosen()
        if profile is not None:
            await self._edit(lambda: PatientForm(profile))

    async def action_duplicate(self) -> None:
        """A copy under another identifier."""
        profile = self._chosen()
        if profile is not None:
            text = tr("patients.duplicate_text", name=profile.identifier)
            await self._edit(lambda: AskText(tr("patients.duplicate_title"), text), self._duplicate)

    async def action_archive(self) -> None:
        """Out of the daily list, or back into it."""
        profile = self._chosen()
        if profile is None:
            return
        name = "unarchive" if profile.archived else "archive"
        title, text = tr(f"patients.{name}_title"), tr(f"patients.{name}_text", name=profile.identifier)
        await self._edit(lambda: Question(title, text), self._archive)

    def action_history(self) -> None:
        """What changed, when, by whom."""
        profile = self._chosen()
        if profile is not None:
            with self.notify_errors():
                changes = self.console_app.store.history(profile.identifier)
                self.app.push_screen(History(profile.identifier, changes))

    def action_outcomes(self) -> None:
        """What the sessions came to, over time."""
        from app.console.screens.outcomes import OutcomesPage  # MCAP: only for who asks for it

        profile = self._chosen()
        if profile is not None:
            self.app.push_screen(OutcomesPage(self.console_app.home, profile.identifier))

    def action_export(self) -> None:
        """A copy as a file."""
        profile = self._chosen()
        if profile is not None:
            text = tr("patients.export_text", name=profile.identifier)
            start = f"{profile.identifier}.toml"
            self.app.push_screen(AskText(tr("patients.export_title"), text, start), self._export)

    async def action_import_profile(self) -> None:
        """Take in an exported file."""
        await self._edit(lambda: AskText(tr("patients.import_title"), tr("patients.import_text")), self._import)

    async def action_calibrate(self) -> None:
        """The patient's palm before the configured camera."""
        profile = self._chosen()
        if profile is not None:
            await self.console_app.calibrate(profile)

    async def action_vocabulary(self) -> None:
        """Which gestures this patient can make."""
        profile = self._chosen()
        if profile is not None:
            await self.console_app.begin_enrolment(profile)

    async def action_training(self) -> None:
        """The twelve gestures with the patient's hand, before any motor is on."""
        await self.console_app.begin_training(self._chosen() or DEMO_PATIENT)

    def action_review(self) -> None:
        """Earlier sessions."""
        self.console_app.open_review()

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

    def _fill(self) -> None:
        table = self.query_one(DataTable)
        table.clear()
        for profile in self._found():
            table.add_row(*_row(profile), key=profile.identifier)
        self._show_details()

    def _found(self) -> list[Profile]:
        wanted = self._search.casefold().split()
        return [
            profile
            for profile in self._profiles.values()
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
        with self.notify_errors():
            changes = self.console_app.store.history(profile.identifier)
            about.update(describe(profile, changes, self.console_app.sessions.of(profile.identifier)))

    def _duplicate(self, name: str | None) -> None:
        profile = self._chosen()
        if name and profile is not None:
            copy = msgspec.structs.replace(profile, identifier=name, archived=False, calibrations=())
            with self.notify_errors():
                self.console_app.store.create(copy, by=self.console_app.authority, at=datetime.now(UTC))
            self.reload()

    def _archive(self, yes: bool | None) -> None:
        profile = self._chosen()
        if yes and profile is not None:
            with self.notify_errors():
                self.console_app.store.archive(
                    profile.identifier,
                    by=self.console_app.authority,
                    at=datetime.now(UTC),
                    archived=not profile.archived,
                )
            self.reload()

    def _export(self, typed: str | None) -> None:
        profile = self._chosen()
        if typed and profile is not None:
            with self.notify_errors():
                path = Path(typed).expanduser()
                self.console_app.store.export(profile.identifier, path)
                self.notify(tr("patients.exported", path=path.absolute()))

    def _import(self, typed: str | None) -> None:
        if typed:
            with self.notify_errors():
                path = Path(typed).expanduser()
                profile = self.console_app.store.import_file(path, by=self.console_app.authority, at=datetime.now(UTC))
                self.notify(tr("patients.imported", name=profile.identifier))
            self.reload()


def _row(profile: Profile) -> tuple[str, ...]:
    archived = f" ({tr('patients.archived')})" if profile.archived else ""
    return (
        profile.identifier + archived,
        tr(profile.sex),
        f"{profile.stature_m * 100:.0f} cm",
        f"{profile.mass_kg:.0f} kg",
        tr(profile.hand),
    )


class History(Lists):
    """What changed in a profile, when and by whom, newest first."""

    HELP_PAGE = "history"

    def __init__(self, name: str, changes: tuple[Change, ...]) -> None:
        super().__init__()
        self._patient = name
        self._lines = history_lines(changes)

    def title_and_text(self) -> tuple[str, str]:
        """The patient."""
        return tr("history.title", name=self._patient), ""

    def lines_of(self, state: SessionState | None) -> Lines:  # noqa: ARG002 - a history has no session
        """Every change."""
        return self._lines


def history_lines(changes: tuple[Change, ...]) -> Lines:
    """A head and a line a field for each change."""
    lines: list[tuple[tuple[str, str], ...]] = []
    for change in reversed(changes):
        who = change.by or tr("history.nobody")
        lines.append(
            (
                (f"{change.at[:16].replace('T', ' ')}  {who}", "bold $primary"),
                (f"  {tr(change.why) if knows(change.why) else change.why}", "$text-muted"),
            )
        )
        lines += [
            ((f"  {field_name(field)}: ", ""), (f"{_shown(old)} → {_shown(new)}", "bold"))
            for field, (old, new) in change.changes.items()
        ]
    return tuple(lines) or (plain(tr("history.none"), "$text-muted"),)


def _shown(value: object) -> str:
    return "–" if value is None else str(value)
