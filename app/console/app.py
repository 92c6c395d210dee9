"""The console as a Textual application: what works everywhere, and what happens twenty times a second."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing import resource_tracker
from typing import ClassVar

from textual import events
from textual.app import SystemCommand
from textual.binding import BindingType
from textual.command import CommandPalette
from textual.css.query import NoMatches
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Input, TextArea

from app.console import keys
from app.console.input_time import INPUT, input_time_ns, is_late
from app.console.keys import commands
from app.console.live import Clock, HostFactory, preload_modules
from app.console.lock import LockApp
from app.console.screens.base import ConsoleScreen, Dialog
from app.console.screens.help import HelpPage, page
from app.console.screens.patients import PatientsScreen
from app.console.spoken import Sound, sounds_of, switched_on
from app.console.themes import THEME_NAMES, THEMES
from app.session.host import SessionHost
from app.system.config import Config, SessionSetup
from app.system.operators import Permission, needs_sign_in
from app.system.paths import Home
from app.text.catalogue import language, languages, tr, use_configured, use_language
from profiles.schema import Profile

LATE_NOTICE_S = 5.0  # one notice at a time says that input came too late
TICK_S = 0.05  # the console's beat; control calls it silent after 0.23 s
REST_TICK_S = 0.2  # without a session: a list of patients that nobody touches costs next to nothing


class ConsoleApp(LockApp):
    """Keys that work everywhere, themes, languages, and the tick that feeds every open screen."""

    CSS_PATH = "styles.tcss"
    TITLE = "rleex"
    BINDINGS: ClassVar[list[BindingType]] = list(keys.EVERYWHERE)
    # Textual declares both as lists.
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (72, "-medium"), (80, "-normal"), (130, "-wide")]  # noqa: RUF012
    VERTICAL_BREAKPOINTS = [(0, "-tiny"), (16, "-short"), (38, "-tall")]  # noqa: RUF012

    def __init__(
        self,
        home: Home,
        config: Config,
        *,
        profile: Profile | None = None,
        make_host: HostFactory = SessionHost,
        clock: Clock = time.monotonic_ns,
        read_only: bool = False,
        held: SessionSetup | None = None,
    ) -> None:
        """profile: begin a session with this patient at once; None: begin with the list. held: take this one over."""
        keys.check_keymap(config.keys)
        use_configured(config.language)
        resource_tracker.ensure_running()  # it inherits stderr, which the application is about to replace
        super().__init__(home, config, make_host, clock, read_only=read_only)
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = config.theme
        self.switch.keys = frozenset(keys.keys_of("stop", config.keys))
        self.sounds = switched_on(config.sounds)
        self._profile = profile
        self._held = held
        self._late_notice_s = -LATE_NOTICE_S
        self._beat: Timer | None = None
        self._beat_s = 0.0

    async def on_mount(self) -> None:
        self.set_keymap(self.config.keys)
        self._loop_of_console = asyncio.get_running_loop()
        if self._terminal is not None:
            self._ending.on_signals()
        self._set_beat(REST_TICK_S)
        if self._profile is not None and self.read_only:
            await self.begin_session(self._profile, self.config)  # who only watches moves nobody: no sign-in
            return
        if self._held is not None:
            await self.take_over(self._held)
            return
        if self._profile is None or needs_sign_in(self.config):
            await self.push_screen(PatientsScreen())
            self.run_worker(asyncio.to_thread(preload_modules))
        if self._profile is not None:
            await self.begin_signed_in(self._profile, self.config)

    async def on_event(self, event: events.Event) -> None:
        """STOP before any field may take the key for a letter; every key and click says that somebody is there."""
        if isinstance(event, events.Key) and self.switch.takes(event):
            return
        if not self.admits(event):
            return
        touch = isinstance(event, (events.Key, events.MouseDown))
        late = touch and not self._barred() and self._must_lock(self.live_state())
        if touch:
            self._touch()
        if not (late and isinstance(event, events.Key)):  # pressing the mouse acts on the STOP bar alone
            await super().on_event(event)
        if late:  # the key that wakes a computer commands nothing for the operator who was there before
            self._lock_idle()

    def admits(self, event: events.Event) -> bool:
        """Whether input may act; what is commanded from then on was given with it.

        What waited too long beside a session is dropped with a notice; text for a field moves nothing: it stays.
        """
        if not isinstance(event, INPUT):
            return True
        if not (self.switch.live and is_late(event, time.monotonic_ns())):
            self.input_ns = input_time_ns(event)
            return True
        mouse = isinstance(event, (events.MouseDown, events.MouseUp))
        if self._is_text(event) or (mouse and event.is_forwarded):
            return True
        if mouse:
            self._mouse_down_widget = None  # neither this nor a later release makes a click of it
        now_s = time.monotonic()
        if now_s - self._late_notice_s >= LATE_NOTICE_S:
            self._late_notice_s = now_s
            self.notify(tr("input.late"), severity="warning", timeout=LATE_NOTICE_S)
        return isinstance(event, events.MouseUp)  # what is dragged is let go

    def _is_text(self, event: events.Event) -> bool:
        """Whether a field takes it for text; a field has had what comes back from it."""
        if event.is_forwarded or not isinstance(self.focused, (Input, TextArea)):
            return False
        if not isinstance(event, events.Key):
            return isinstance(event, events.Paste)
        everywhere = {key for one in keys.EVERYWHERE for key in keys.keys_of(str(one.id), self.config.keys)}
        return event.is_printable and not everywhere & {event.key, event.character}

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Everything, for the command palette."""
        yield from commands(self, screen)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Without a session the STOP key is an ordinary key; help has no help, its key closes it."""
        if action == "help":
            return not (self.screen_stack and isinstance(self.screen, HelpPage))
        return self.switch.live if action == "stop" else True

    def action_stop(self) -> None:
        """STOP where the terminal's thread has not already taken it."""
        self.switch.press_key()

    def action_help(self) -> None:
        """Help on the screen that is open."""
        screen = self.screen
        if isinstance(screen, (ConsoleScreen, Dialog)) and not isinstance(screen, HelpPage):
            text = page(screen.help_page, screen.bindings_in_force, self)
            self.push_kept(str(text), lambda: HelpPage(text))

    def action_command_palette(self) -> None:
        """As the base, asking in the language in use; it commands, so never where a PIN or the lock is in the way."""
        if self.use_command_palette and not (isinstance(self.screen, CommandPalette) or self._barred()):
            self.push_screen(CommandPalette(placeholder=tr("palette.search"), id="--command-palette"))

    def action_next_theme(self) -> None:
        """The next theme, and around."""
        at = THEME_NAMES.index(self.theme) if self.theme in THEME_NAMES else -1
        self.theme = THEME_NAMES[(at + 1) % len(THEME_NAMES)]

    async def action_next_language(self) -> None:
        """The next language file; takes effect at once."""
        codes = list(languages())
        await self.speak(codes[(codes.index(language()) + 1) % len(codes)])

    async def speak(self, code: str) -> None:
        """Say everything in this language."""
        use_language(code)
        self.__dict__.pop("key_names", None)  # a cached property
        for screen in {*self.screen_stack, *self.kept.values()}:
            if isinstance(screen, (ConsoleScreen, Dialog)):  # the palette would come out empty
                await screen.recompose()
            screen.refresh_bindings()

    async def calibrate(self, profile: Profile) -> None:
        """Calibrate a patient's palm; a running session has the camera."""
        from app.console.screens.calibration import CalibrationScreen

        if self.refuse_while_ending():
            return
        await self.permitted(Permission.CALIBRATE, lambda: self.push_screen(CalibrationScreen(profile)))

    def switch_sound(self, sound: Sound) -> None:
        """On or off, until the console ends; the configuration has what it begins with."""
        self.sounds ^= {sound}
        self.notify(tr("sound.on" if sound in self.sounds else "sound.off", sound=sound))

    def _set_beat(self, period_s: float) -> None:
        if period_s != self._beat_s:
            if self._beat is not None:
                self._beat.stop()
            self._beat, self._beat_s = self.set_interval(period_s, self._tick), period_s

    def _tick(self) -> None:
        state, live = None, self.live  # a tick may end the session
        self._set_beat(REST_TICK_S if live is None else TICK_S)
        if live is not None and not live.closed:
            known = live.state
            if self._terminal is None:
                live.input_alive()
            state = live.tick()
            self.tell_result(self.guided.update(state))
            if sounds_of(known, state) & self.sounds:
                self.bell()
        self._update_idle(state)
        own = (screen for screen in reversed(self.screen_stack) if isinstance(screen, (ConsoleScreen, Dialog)))
        screen = next(own, None)  # below the palette it stays in sight; none is left while the program ends
        if screen is not None and screen.composed:
            with suppress(NoMatches):  # a screen that is just being taken down has lost its widgets
                screen.show_session(state)
