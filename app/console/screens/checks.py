"""The checks before arming as a list, and the pre-flight of every action in the background."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path
from typing import ClassVar

import msgspec
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Vertical
from textual.widgets import Static

from app.console.guidance import Light, results
from app.console.screens.base import Dialog
from app.console.screens.dialogs import Lists, Wording
from app.console.state import SessionState
from app.console.widgets.gesture import zone_text
from app.console.widgets.panel import Line, Lines, bar, plain
from app.console.worker import Worker
from app.ipc.states import Action
from app.system.config import Config
from app.system.operators import Permission
from app.system.paths import Home
from app.text.catalogue import render, tr
from app.voice.signals import VoiceState
from kgdfa.press_zone import PressZone
from logs.reason import Reason, reason
from logs.records import Note
from profiles.schema import Profile
from profiles.store import ChangeCause

_STYLES = {
    Light.GREEN: "bold $success",
    Light.WAITING: "$text-muted",
    Light.AMBER: "bold $warning",
    Light.RED: "bold $error",
}


def suggested_m(state: SessionState | None) -> float | None:
    """The press threshold for this camera and palm, metres; None: the session's suits them, or none does."""
    report = None if state is None else state.report
    zone = None if report is None else report.press_zone
    if report is None or zone is None or not zone.possible or zone.fits(report.threshold_m):
        return None
    return zone.threshold_m


def check_lines(state: SessionState, key_names: Mapping[str, str]) -> Lines:
    """Two lines a check that is not green, one that is. key_names: how each key of the table is shown."""
    lines: list[Line] = []
    for name, light in results(state).items():
        lines.append(((f" {light.value} ", _STYLES[light]), (tr(f"check.{name}.name"), "bold")))
        if light is not Light.GREEN:
            none_suits = name == "press_zone" and suggested_m(state) is None
            remedy = "checks.no_threshold" if none_suits else f"check.{name}.remedy"
            lines.append(plain(f"   {tr(remedy, **key_names)}", "$text-muted"))
        if name == "processes":
            lines += [
                plain(f"   {tr('health.ended', name=one.name, count=one.restarts)}", "$error")
                for one in state.ended_processes
            ]
    for one in () if state.snapshot is None else state.snapshot.stop_inputs:
        stands = "open" if one.open else "pressed_once" if one.pressed_once else "unpressed"
        style = "$success" if stands == "pressed_once" else "$warning"
        lines.append(((f"   {one.name} ({tr(one.role)}): ", "$text-muted"), (tr(f"stop_input.{stands}"), style)))
    if state.voice is not None:
        style = "$success" if state.voice is VoiceState.LISTENING else "$warning"
        lines.append(((f"   {tr('voice.name')}: ", "$text-muted"), (tr(state.voice), style)))
    if state.report is not None and state.report.press_zone is not None:
        text = zone_text(state.report.press_zone, state.report.threshold_m)
        lines.append(plain(f" {text}", "$text-muted"))
    if state.fault:
        lines.append(plain(state.fault, "bold $error"))
    return tuple(lines)


class Checklist(Lists):
    """Closed with Escape; stays true while it is open. What the console can mend itself is a key away."""

    HELP_PAGE = "checks"
    BINDINGS: ClassVar[list[BindingType]] = [
        ("u", "use_threshold", "bind.checklist.use_threshold"),
        ("p", "preflight", "bind.checklist.preflight"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._suggests = False  # a threshold, as far as the keys are shown

    def title_and_text(self) -> tuple[str, str]:
        """In the language of now."""
        return tr("checks.title"), tr("checks.text")

    def lines_of(self, state: SessionState | None) -> Lines:
        """Every check as it stands."""
        return () if state is None else check_lines(state, self.console_app.key_names)

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        suggests = suggested_m(state) is not None
        if suggests != self._suggests:
            self._suggests = suggests
            self.refresh_bindings()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Rehearsals are for real joints here, a threshold where another suits better; an observer changes nothing."""
        app = self.console_app
        if action == "preflight":
            setup = None if app.live is None or app.read_only else app.live.host.setup
            return setup is not None and setup.config.joints.kind != "simulated" and not setup.joints_elsewhere
        return action != "use_threshold" or (suggested_m(app.live_state()) is not None and not app.read_only)

    def action_preflight(self) -> None:
        """Rehearse every action for this patient."""
        setup = self.console_app.live_setup()
        self.app.push_screen(Preflight(setup.profile, setup.config))

    async def action_use_threshold(self) -> None:
        """Put the threshold that suits this camera into the profile."""
        state = self.console_app.live_state()
        report = None if state is None else state.report
        if state is None or report is None or report.press_zone is None:
            return
        name, zone, camera = state.setup.profile.identifier, report.press_zone, report.camera

        async def adopt() -> None:
            with self.notify_errors():
                self._adopt(name, zone, camera)

        await self.console_app.permitted(Permission.CALIBRATE, adopt)

    def _adopt(self, name: str, zone: PressZone, camera: str) -> None:
        app, threshold_m = self.console_app, zone.threshold_m
        now = app.store.load(name)
        if zone.fits(now.press_threshold_m):  # it was changed since the session began
            self.notify(tr("checks.threshold_kept", cm=f"{now.press_threshold_m * 100:.0f}"))
            return
        changed = msgspec.structs.replace(now, press_threshold_m=threshold_m)
        app.store.save(changed, by=app.authority, at=datetime.now(UTC), why=ChangeCause.PRESS_ZONE.key)
        app.trail.emit(Note(text=reason(ChangeCause.PRESS_ZONE, patient=name, threshold_m=threshold_m, camera=camera)))
        self.notify(tr("checks.threshold_set", cm=f"{threshold_m * 100:.0f}"))


BAR_CELLS = 40


class Preflight(Dialog[bool]):
    """Gives True when every action has passed; Escape stops it and keeps what has passed so far."""

    HELP_PAGE = "preflight"
    BINDINGS: ClassVar[list[BindingType]] = [("enter", "close_if_done", "bind.cancel")]

    def __init__(self, profile: Profile, config: Config, actions: tuple[Action, ...] = tuple(Action)) -> None:
        super().__init__()
        self._profile = profile
        self._config = config
        self._actions = actions
        self._worker: Worker | None = None
        self._ended = False
        self._passed = False
        self._progress: Wording = lambda: tr("preflight.starting")

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("preflight.title", name=self._profile.identifier)
            yield Static(tr("preflight.text"), markup=False)
            yield Static(id="progress", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.fill()
        home = self.console_app.home.root
        with self.notify_errors():
            try:
                self._worker = Worker(rehearse_all, home, self._config, self._profile, self._actions)
            except OSError:
                self._end(lambda: tr("preflight.died"))
                raise

    def fill(self) -> None:
        """How far it is, or what came of it."""
        self._show(self._progress)

    def on_unmount(self) -> None:
        if self._worker is not None:
            self._worker.end()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        try:
            while not self._ended and self._worker is not None and self._worker.pipe.poll():
                self._take(self._worker.pipe.recv())
        except EOFError:
            self._end(lambda: tr("preflight.died"))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Enter closes once it is over."""
        return action != "close_if_done" or self._ended

    def action_cancel(self) -> None:
        self.dismiss(self._passed)

    def action_close_if_done(self) -> None:
        self.dismiss(self._passed)

    def _take(self, progress: Progress) -> None:
        if isinstance(progress, Action):
            index = self._actions.index(progress)
            drawn = bar(index / len(self._actions), BAR_CELLS)
            self._show(lambda: f"{drawn} {index + 1}/{len(self._actions)}\n{tr(progress)} …")
        else:
            self._passed = not progress
            self._end(lambda: "\n".join(f"✗ {render(reason)}" for reason in progress) or tr("preflight.passed"))

    def _end(self, result: Wording) -> None:
        self._ended = True
        self.refresh_bindings()
        hinted = self._passed and self.console_app.live is not None
        self._show(lambda: f"{result()}\n{tr('preflight.joints_off')}" if hinted else result())

    def _show(self, progress: Wording) -> None:
        self._progress = progress
        self.query_one("#progress", Static).update(progress())


# What comes through the pipe: an action that begins; at the end the reasons why actions failed.
Progress = Action | tuple[Reason, ...]


def rehearse_all(pipe: Connection, home: Path, config: Config, profile: Profile, actions: Sequence[Action]) -> None:
    """Rehearse what is not on record yet, save the results, report each: in a process of its own."""
    from app.motion.plan import patient_of
    from app.motion.preflight import PreflightFault, cleared_actions, run_preflight
    from app.system.config import load_device
    from app.system.scheduling import set_scheduling

    set_scheduling("rehearsal")
    place = Home(home)
    device = load_device(config.joints)
    patient = patient_of(profile, device)
    done = cleared_actions(place, patient, device)
    wanted = [action for action in actions if action not in done]
    try:
        results = run_preflight(place, patient, device, wanted, watch=pipe.send)
    except OSError as error:
        pipe.send((reason(PreflightFault.NOT_SAVED, folder=str(home), detail=error.strerror or str(error)),))
        return
    pipe.send(tuple(result.reason for result in results if result.reason))
