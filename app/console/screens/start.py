"""Between the list and the live screen: is this the patient, which camera, which joints."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import ClassVar, cast, get_args

import msgspec
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Button, Input, Label, Select, Static

from app.console.screens.base import ConsoleScreen
from app.console.screens.checks import Preflight
from app.console.widgets.patient_details import identity, vocabulary_text
from app.system.config import CameraKind, Config, JointsKind, with_camera, with_choices
from app.system.operators import Permission
from app.system.vocabulary import status_now
from app.text.catalogue import tr
from profiles.schema import DistanceUsed, Profile
from profiles.store import ChangeCause


class StartSession(ConsoleScreen):
    """Everything is set as last time: Enter goes on."""

    HELP_PAGE = "start"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "begin", "bind.start.begin"),
        Binding("f5", "preflight", "bind.checklist.preflight"),
        Binding("escape", "dismiss", "bind.start.back"),
    ]

    def __init__(self, profile: Profile) -> None:
        super().__init__()
        self._profile = profile
        self._camera = ""  # the kind that was chosen; empty: the configured one

    def compose(self) -> ComposeResult:
        config = self.console_app.config
        yield Label(tr("start.title", name=self._profile.identifier), id="title")
        with VerticalScroll(id="start"):
            yield Static(identity(self._profile), markup=False, classes="dialog-text")
            status = status_now(self._profile, config)
            if text := vocabulary_text(self._profile, status, self.console_app.key_names):
                yield Static(text, markup=False, id="vocabulary", classes="dialog-text")
            yield Label(tr("start.camera"), classes="section")
            cameras = [(tr(f"camera.{kind}"), kind) for kind in get_args(CameraKind)]
            camera = self._camera or config.camera.kind
            yield Select(cameras, value=camera, allow_blank=False, id="camera", compact=True)
            yield Input(config.camera.device, placeholder=tr("start.device"), id="device", compact=True)
            yield Label(tr("start.distance"), classes="section")
            distances = [(tr(used), used) for used in DistanceUsed]
            yield Select(
                distances, value=self._profile.distance_source, allow_blank=False, id="distance-source", compact=True
            )
            yield Label(tr("start.joints"), classes="section")
            joints = [(tr(f"joints.{kind}"), kind) for kind in get_args(JointsKind)]
            if config.joints.host:
                joints = [(f"{tr('joints.host')}: {config.joints.host}", config.joints.kind)]
            yield Select(joints, value=config.joints.kind, allow_blank=False, id="joints-kind", compact=True)
            if not config.joints.host:
                yield Label(tr("start.preflight"), classes="hint")
            yield Button(tr("start.begin"), id="begin", variant="primary")
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.query_one("#begin").focus(scroll_visible=False)  # who it is stays in sight

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Another computer's joints go by the pre-flights that it has on record, for its own device."""
        return action != "preflight" or not self.console_app.config.joints.host

    @on(Select.Changed, "#camera")
    def show_device(self, event: Select.Changed) -> None:
        """The configured device belongs to the configured camera; what was typed, to the one that it was typed for."""
        own = self.console_app.config.camera
        if event.value != (self._camera or own.kind):
            self._camera = str(event.value)
            self.query_one("#device", Input).value = own.device if event.value == own.kind else ""

    async def on_button_pressed(self) -> None:
        await self.action_begin()

    async def action_begin(self) -> None:
        """Start the processes with what is chosen; another source of the distance is kept in the profile."""
        with self.notify_errors():
            config = self._chosen()
            await self.console_app.permitted(Permission.OPERATE, lambda: self._begin(config), config)

    async def action_preflight(self) -> None:
        """Rehearse every action for this patient, for who may move one."""
        with self.notify_errors():
            config = self._chosen()
            await self.console_app.permitted(Permission.OPERATE, lambda: self._rehearse(config), config)

    async def _rehearse(self, config: Config) -> None:
        with self.notify_errors():
            await self.app.push_screen(Preflight(self._stored(), config))

    async def _begin(self, config: Config) -> None:
        app, used = self.console_app, DistanceUsed(self.query_one("#distance-source", Select).value)
        with self.notify_errors():
            profile = self._stored()
            if profile != self._profile:
                await self._show_changed(profile)
                return
            if used is not profile.distance_source:
                profile = msgspec.structs.replace(profile, distance_source=used)
                app.store.save(profile, by=app.authority, at=datetime.now(UTC), why=ChangeCause.DISTANCE.key)
                self._profile = profile
            await app.begin_session(profile, config)

    def _stored(self) -> Profile:
        return self.console_app.store.load(self._profile.identifier)

    async def _show_changed(self, profile: Profile) -> None:
        """Another person's change is compared before anything moves by it; what was chosen here stays."""
        source = self.query_one("#distance-source", Select)
        if source.value == self._profile.distance_source:
            source.value = profile.distance_source
        self._profile = profile
        await self.recompose()
        self.notify(tr("start.changed"), severity="warning", timeout=15)

    def _chosen(self) -> Config:
        """The configuration with these choices. Raises AppError where its inputs don't suit them."""
        config = self.console_app.config
        camera = cast("CameraKind", self.query_one("#camera", Select).value)
        joints = cast("JointsKind", self.query_one("#joints-kind", Select).value)
        device = self.query_one("#device", Input).value.strip()
        here = None if config.joints.host else joints  # another computer's joints stay its own
        config = with_choices(config, camera=camera, joints=here, patient=None)
        return msgspec.structs.replace(config, camera=with_camera(config.camera, camera, device))
