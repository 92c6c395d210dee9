"""From a chosen patient to the end of the session: sign in, start, live, stop, note, close."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
from textual.screen import Screen

from app.console.live import Clock, HostFactory, LiveSession, gc_freeze, preload_modules
from app.console.patient_fields import fits
from app.console.screens.after import AfterScreen
from app.console.screens.base import USER_ERRORS, Dialog
from app.console.screens.dialogs import ask
from app.console.screens.patients import PatientsScreen
from app.console.screens.session import SessionScreen
from app.console.screens.signin import SignInDialog
from app.console.screens.training import TrainingScreen
from app.console.screens.vocabulary import VocabularyScreen
from app.console.session_app import SessionApp
from app.console.session_index import Records, SessionRecord, TrainingRecord
from app.ipc.messages import OperatorKind
from app.outcomes.guided import GuidedStop
from app.session.setup import make_setup
from app.system.authority import Authority
from app.system.config import Config, Purpose, SessionSetup
from app.system.operators import Permission, needs_sign_in
from app.system.paths import Home
from app.text.catalogue import render, tr
from profiles.schema import DEMO_PATIENT, Profile
from profiles.store import ProfileStore

T = TypeVar("T")

_OF_THE_HAND = ("hand", "distance_source", "palm", "calibrations", "press_threshold_m")  # what training needs
CONTROL_ENDS_S = 8.0  # hold, damp, disable; the host kills what takes longer


class SessionFlow(SessionApp):
    """The way into the one session, and out of it."""

    def __init__(self, home: Home, config: Config, make_host: HostFactory, clock: Clock, *, read_only: bool) -> None:
        super().__init__(home, config, make_host, clock, read_only=read_only)
        self.store = ProfileStore(home.profiles, (fits(config.joints),))
        self.sessions = Records(home.root / "sessions", SessionRecord)
        self.trainings = Records(home.root / "trainings", TrainingRecord)
        self.large_letters = False
        self.kept: dict[str, Dialog[Any]] = {}
        self._beginning = asyncio.Lock()  # who waits for it finds the session that was begun meanwhile

    def push_kept(
        self, name: str, make: Callable[[], Dialog[T]], then: Callable[[T | None], None] | None = None
    ) -> None:
        """Open a dialog that stays made for the next time: making it anew takes three quarters of a key's reaction."""
        dialog = self.kept.get(name)
        if dialog is None:
            dialog = self.kept[name] = make()
            self.install_screen(dialog, name)
        if dialog not in self.screen_stack:
            self.push_screen(dialog, then and dialog.answering(then))

    async def begin_signed_in(self, profile: Profile, config: Config) -> None:
        """Begin a session, after a sign-in where drives can move."""
        await self.permitted(Permission.OPERATE, lambda: self.begin_session(profile, config), config)

    async def begin_session(self, profile: Profile, config: Config) -> None:
        """Start the processes for a patient, and show the live screen at once."""
        await self._begin(profile, config, SessionScreen())

    async def begin_training(self, patient: Profile) -> None:
        """The guided tour: digital hand or the configured camera, simulated joints, never armed.

        The demo patient's legs with this patient's hand: whose trail it is nobody's session.
        """
        hand = {name: getattr(patient, name) for name in _OF_THE_HAND}
        profile = msgspec.structs.replace(DEMO_PATIENT, **hand)
        joints = msgspec.structs.replace(self.config.joints, kind="simulated", host="")
        config = msgspec.structs.replace(self.config, joints=joints)
        await self._begin(profile, config, TrainingScreen(patient.identifier), "training")

    async def begin_enrolment(self, profile: Profile) -> None:
        """The gestures that this patient can make, before the configured camera; simulated joints, never armed."""
        joints = msgspec.structs.replace(self.config.joints, kind="simulated", host="")
        config = msgspec.structs.replace(self.config, joints=joints)

        async def begin() -> None:
            await self._begin(profile, config, VocabularyScreen(profile), "enrolment")

        await self.permitted(Permission.EDIT_PATIENTS, begin)

    async def take_over(self, held: SessionSetup) -> None:
        """Take over a session whose console is gone: by its operator's PIN or a therapist's where drives can move.

        Who has not signed in yet sees what it does, and can stop it. A training or an enrolment is ended: what it had
        got to went with its console, and the live screen would confirm and arm.
        """
        if held.purpose != "session":
            host = self._make_host(held)
            self._ending_held = True
            await self.push_screen(PatientsScreen())
            self._notify_ending()
            self.run_worker(self._end_held(host))
            return
        live = self._live_of(held)
        if needs_sign_in(held.config):
            self.push_screen(SignInDialog(held=held), lambda operator: self._taken_over(live, operator))
        else:
            await self._show(live, SessionScreen())

    async def _taken_over(self, live: LiveSession, operator: Authority | None) -> None:
        if operator is None:
            self.exit()
            return
        self.signed_in = operator
        live.assign(operator)
        await self._show(live, SessionScreen())

    async def end_session_asking(self) -> None:
        """End the session; while drives are powered, only after a yes. An observer just leaves."""
        if self.read_only:
            self.exit()
            return
        if not self.powered():
            await self.end_session()
            return
        ask(self, lambda: tr("end.title"), lambda: tr("end.text"), self.end_session)

    async def end_session(self) -> None:
        """Bring the legs to rest, then ask for note and rating while the trail is still open."""
        live = self.live
        if live is None or live.ending:
            return
        live.ending = True
        if live.state.fault and live.state.snapshot is None:  # it never ran: there is nothing to note
            await self.close_session()
            return
        self.guided.stop(GuidedStop.SESSION_ENDED)
        self.command(OperatorKind.SHUT_DOWN)
        self.notify(tr("end.resting"))
        self.run_worker(self._after_rest(live))

    async def close_session(self) -> None:
        """End every process; back to the patients' list."""
        await asyncio.to_thread(self.close_live)
        await self.show_patients()

    async def show_patients(self) -> None:
        """The list, with nothing above it but the lock, where that stood."""
        locked, opened = self.locked, None
        while len(self.screen_stack) > 1 and not isinstance(self.screen, PatientsScreen):
            self._drop_screen()
        if not isinstance(self.screen, PatientsScreen):
            opened = self.push_screen(PatientsScreen())
        if locked:
            self.show_lock()
        if opened is not None:
            await opened

    def _drop_screen(self) -> None:
        """The top one; not awaited.

        No key may come between a lock that goes and the one that stands again, and a screen's own button would wait
        for the end of its screen, which waits for the button.
        """
        self.pop_screen()

    def _drop_dialogs(self) -> None:
        """Those on top, the lock among them."""
        while isinstance(self.screen, Dialog):
            self._drop_screen()

    async def _begin(
        self, profile: Profile, config: Config, screen: Screen[None], purpose: Purpose = "session"
    ) -> None:
        if self.refuse_while_ending():
            return
        moves = None if self.read_only else Permission.OPERATE
        async with self._beginning:
            if self.live is not None:
                return
            try:
                if config.joints.host and not self.read_only:
                    from app.link.questions import require_joints  # brings cryptography

                    await asyncio.to_thread(require_joints, self.home, config.joints.host)
                await asyncio.to_thread(self.trail.keep, self.home)  # of before this session
                setup = make_setup(self.home, config, profile, self.signed_in, moves, purpose=purpose)
            except USER_ERRORS as error:
                self.notify(render(error), severity="error", timeout=15, markup=False)
                if len(self.screen_stack) == 1 and not self.read_only:  # straight from the start: no list is below
                    await self.show_patients()
                return
            live = self._live_of(setup)
        await self._show(live, screen)

    async def _show(self, live: LiveSession, screen: Screen[None]) -> None:
        """Show a session, then start it or take it over: it stops all threads a moment, after the first paint.

        What was opened while it was prepared goes; a lock below a session would neither lock it nor let another.
        """
        locked = self.locked
        self._drop_dialogs()
        opened = self.push_screen(screen)
        if locked:
            self.show_lock()
        await opened
        self.call_after_refresh(lambda: self.run_worker(self._start(live)))

    async def _start(self, live: LiveSession) -> None:
        try:
            await asyncio.to_thread(live.start)
            if not self.read_only and self.live is live:  # it may have been closed meanwhile
                self.trail.open(live.host.setup)
            await asyncio.to_thread(preload_modules)
            if self.live is live:
                gc_freeze()
        except USER_ERRORS as error:
            live.failed(render(error))

    async def _after_rest(self, live: LiveSession) -> None:
        loop = asyncio.get_running_loop()
        limit = loop.time() + CONTROL_ENDS_S
        while live.state.control_alive and loop.time() < limit:
            await asyncio.sleep(0.05)
        if not live.closed:  # a console that stood still has its time over before it has read what came meanwhile
            live.tick()
        if not live.state.control_alive:
            live.at_rest()
        if self.live is not live:
            return
        locked = self.locked
        while not isinstance(self.screen, SessionScreen):  # the palette and the comparison too
            self._drop_screen()
        self.clear_notifications()  # what the session said last would cover the summary
        self.switch_screen(AfterScreen(live.state))
        if locked:
            self.show_lock()
