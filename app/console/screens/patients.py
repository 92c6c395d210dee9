"""What is done with patients: begin, edit, copy, archive, hand on, calibrate, train; nothing is ever deleted."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import ClassVar, TypeVar

import msgspec
from textual.binding import BindingType
from textual.screen import Screen

from app.console import keys
from app.console.screens.dialogs import AskText, History, Question
from app.console.screens.patient_form import PatientForm
from app.console.screens.patient_list import PatientList
from app.console.screens.start import StartSession
from app.system.operators import Permission
from app.text.catalogue import tr
from logs.reading.regular import path_named
from profiles.schema import DEMO_PATIENT

T = TypeVar("T")

# What an observer may not do.
CHANGES = {"new", "edit", "duplicate", "archive", "import_profile", "begin", "training", "calibrate", "vocabulary"}


class PatientsScreen(PatientList):
    """The list, and what can be done with the patient under the cursor."""

    HELP_PAGE = "patients"
    BINDINGS: ClassVar[list[BindingType]] = list(keys.PATIENTS)

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

    async def _edit(self, make: Callable[[], Screen[T]], then: Callable[[T | None], None] | None = None) -> None:
        """Open what changes patients, for those who may."""
        app = self.console_app
        await app.permitted(Permission.EDIT_PATIENTS, lambda: app.push_screen(make(), then))

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
