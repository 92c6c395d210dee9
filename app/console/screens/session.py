"""The live session: everything that matters at a glance, every order one key away."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import ActiveBinding, BindingType
from textual.containers import Container, Vertical

from app.console import keys
from app.console.guidance import guidance_line
from app.console.screens.after import summarise
from app.console.screens.checks import Checklist
from app.console.screens.compare import CompareScreen
from app.console.screens.dialogs import GuidedTestChoice, HealthPage, TherapistAct, ask
from app.console.screens.hand_keys import HandKeys
from app.console.state import SessionState
from app.console.widgets.gait import GaitPanel
from app.console.widgets.gesture import DistancePanel, GesturePanel
from app.console.widgets.hold import HoldPanel, held
from app.console.widgets.large import LargePanel
from app.console.widgets.panel import Panel, StatePanel
from app.console.widgets.patient_details import identity
from app.console.widgets.picture import Picture
from app.console.widgets.status import DosePanel, EventsPanel, guided_line, status_line
from app.console.widgets.wearer import FigurePanel, JointsPanel
from app.ipc.messages import OperatorKind
from app.ipc.states import Action
from app.motion.wearer import Wearer, load_wearer
from app.outcomes.guided import GuidedStop, GuidedTest
from app.system.config import load_device
from app.system.paths import pictures_path
from app.text.catalogue import tr
from logs.records import Recording

DELETED_POLL_S, DELETED_POLLS = 0.1, 50  # the recording deletes pictures within a second
_ACTS = {"confirm_patient", "toggle_armed", "act", "record_pictures", "guided_test"}


class SessionScreen(HandKeys):
    """Draws the session's state and turns keys into orders; decides nothing itself."""

    HELP_PAGE = "session"
    BINDINGS: ClassVar[list[BindingType]] = [*keys.SESSION, *keys.DIGITAL_HAND]

    def __init__(self) -> None:
        super().__init__()
        self.wearer: Wearer | None = None  # until it is loaded there is no figure
        self._loading = False

    def compose(self) -> ComposeResult:
        yield Panel(id="status")
        yield Panel(id="guide")
        yield Panel(id="guided")
        with Container(id="main"):  # the hand on the left, the legs beside it, figures on the right of wide terminals
            yield Picture(id="picture")
            yield FigurePanel(id="figure", title=tr("panel.figure"))
            with Vertical(id="numbers"):
                yield JointsPanel(id="joints", title=tr("panel.joints"))
                yield DosePanel(id="dose", title=tr("panel.dose"))
            with Vertical(id="hand-side"):
                yield GesturePanel(id="gesture", title=tr("panel.gesture"))
                yield DistancePanel(id="distance", title=tr("panel.distance"))
            with Vertical(id="legs-side"):
                yield GaitPanel(id="gait", title=tr("panel.gait"))
                yield EventsPanel(id="events", title=tr("panel.events"))
            yield HoldPanel(id="hold", title=tr("panel.hold"))
            yield LargePanel(id="large")
        yield from self.compose_bottom()

    async def _load_wearer(self) -> None:
        """In a thread, and not before there is something to draw: it would keep the first paint waiting."""
        with self.notify_errors():
            setup = self.console_app.live_setup()
            self.wearer = await asyncio.to_thread(load_wearer, setup.profile, setup.config.joints)

    def follow(self, state: SessionState) -> None:
        if state.snapshot is not None and not self._loading:
            self._loading = True
            self.run_worker(self._load_wearer(), exit_on_error=False)
        app = self.console_app
        status = self.query_one("#status", Panel)
        status.lines = status_line(state, status.size.width, app.key_names["health"])
        guide = guidance_line(state, app.key_names, watching=app.read_only)
        self.query_one("#guide", Panel).lines = guide
        self._show_guided()
        main = self.query_one("#main")
        main.set_class(held(state), "-held")
        main.set_class(app.large_letters, "-large")
        self.query_one(LargePanel).follow(state, app.key_names, watching=app.read_only)
        if held(state):
            self.query_one(HoldPanel).show(state, app.key_names, watching=app.read_only)
        self.query_one(FigurePanel).wearer = self.query_one(JointsPanel).wearer = self.wearer
        for panel in self.query(StatePanel):
            panel.show(state)

    @property
    def help_page(self) -> str:
        return "watching" if self.console_app.read_only else self.HELP_PAGE

    @property
    def bindings_in_force(self) -> dict[str, ActiveBinding]:
        """An observer's key ends no session: it leaves."""
        found = super().bindings_in_force
        if not self.console_app.read_only:
            return found
        return {
            key: one._replace(binding=replace(one.binding, description="bind.leave"))
            if one.binding.action == "end_session"
            else one
            for key, one in found.items()
        }

    def discard(self) -> None:
        """The session ends with the program, without note and ratings: it belongs in the list all the same.

        One that goes on does not yet: watched, left for another console, or not taken over.
        """
        app, live = self.console_app, self.console_app.live
        if live is None or live.state.snapshot is None or app.read_only or live.left or not live.host.commands:
            return
        with self.notify_errors():
            app.sessions.add(summarise(live.state, datetime.now(UTC).isoformat(timespec="seconds")))

    def on_events_panel_clicked(self) -> None:
        if self.check_action("acknowledge", ()):
            self.action_acknowledge()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """An observer may look, not act; with a session that has ended nobody does."""
        if self.console_app.live is None or (self.console_app.read_only and action in _ACTS):
            return False
        return super().check_action(action, parameters)

    def action_confirm_patient(self) -> None:
        """The patient before the camera is the one of the profile."""
        profile = self.console_app.live_setup().profile
        confirm = partial(self.console_app.command, OperatorKind.CONFIRM_PATIENT)
        ask(self.app, lambda: tr("confirm.title"), lambda: identity(profile), confirm)

    def action_toggle_armed(self) -> None:
        """Arm or disarm gestures."""
        state = self.console_app.live_state()
        armed = state is not None and state.snapshot is not None and state.snapshot.armed
        self.console_app.command(OperatorKind.DISARM if armed else OperatorKind.ARM)

    def action_act(self) -> None:
        """One of the twelve actions, by the therapist's key."""
        state = self.console_app.live_state()
        allowed = state.snapshot.allowed if state is not None and state.snapshot is not None else ()
        self.console_app.push_kept("act", lambda: TherapistAct(allowed), self._chosen)

    def action_checks(self) -> None:
        """Show the checks."""
        self.console_app.push_kept("checks", Checklist)

    def action_health(self) -> None:
        """Show camera, control, links and joints in figures."""
        app = self.console_app
        with self.notify_errors():
            devices = load_device(app.live_setup().config.joints).joints
            app.push_kept("health", lambda: HealthPage(devices))

    def action_compare(self) -> None:
        """Both cameras side by side."""
        self.app.push_screen(CompareScreen(), lambda _: self.query_one(Picture).ask())

    def action_pause_picture(self) -> None:
        """Freeze the picture on the screen only."""
        self.query_one(Picture).toggle_pause(self.console_app.key_names["pause"])

    def action_large_letters(self) -> None:
        """State, gesture and what is allowed in letters for three metres, or the usual screen again."""
        app = self.console_app
        app.large_letters = not app.large_letters
        self.show_session(app.live_state())

    def action_record_pictures(self) -> None:
        """Record the camera's pictures, with the patient's consent; or delete them, when it is withdrawn."""
        live = self.console_app.live_session()
        if not live.host.setup.config.recording.on:
            self.notify(tr("pictures.off"), severity="warning", timeout=15)
            return
        named = "withdraw" if live.pictures_agreed else "consent"
        agree = partial(self._agreed, not live.pictures_agreed)
        ask(self.app, lambda: tr(f"pictures.{named}.title"), lambda: tr(f"pictures.{named}.text"), agree)

    def action_guided_test(self) -> None:
        """Begin a guided test, or stop the one that runs."""
        app = self.console_app
        run = app.guided.run
        if run is None:
            app.push_kept("guided", GuidedTestChoice, self._guided_chosen)
        else:
            test = run.test
            ask(
                app,
                lambda: tr("guided.stop.title"),
                lambda: tr("guided.stop.text", test=test),
                lambda: app.tell_result(app.guided.stop(GuidedStop.BY_KEY)),
            )

    async def action_end_session(self) -> None:
        """End the session, after asking while drives are powered."""
        await self.console_app.end_session_asking()

    def _show_guided(self) -> None:
        app = self.console_app
        panel, run = self.query_one("#guided", Panel), app.guided.run
        panel.set_class(run is not None, "-running")
        panel.lines = () if run is None else guided_line(run, app.key_names["guided"], self.size.width)

    def _guided_chosen(self, test: GuidedTest | None) -> None:
        state = self.console_app.live_state()
        refused = self.console_app.guided.begin(test, state) if test is not None and state is not None else None
        if refused is not None:
            self.notify(tr(refused), severity="warning")

    def _agreed(self, consent: bool) -> None:
        """The trail first: by it the recording takes pictures, or deletes them."""
        app = self.console_app
        path = pictures_path(app.home.logs, app.live_setup().session)
        app.trail.emit(Recording(on=consent, consent=consent, path=path.name))
        app.live_session().record_pictures(consent)
        if not consent:
            self.run_worker(self._tell_deleted(path))

    async def _tell_deleted(self, path: Path) -> None:
        """Once it is so, or what to do when it is not."""
        for _ in range(DELETED_POLLS):
            if not await asyncio.to_thread(path.exists):
                self.notify(tr("pictures.deleted"), timeout=10)
                return
            await asyncio.sleep(DELETED_POLL_S)
        self.notify(tr("pictures.not_deleted", path=path), severity="error", timeout=60, markup=False)

    def _chosen(self, action: Action | None) -> None:
        if action is not None:
            self.console_app.command(OperatorKind.ACT, action)
