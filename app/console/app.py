"""The console as a Textual application: screens, the session behind them, STOP before everything."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Iterable
from typing import ClassVar

from textual.app import App, SystemCommand
from textual.binding import BindingType
from textual.driver import Driver
from textual.screen import Screen

from app.config import Config
from app.console import keys
from app.console.base import ConsoleScreen, Dialog
from app.console.commands import commands
from app.console.dialogs import HelpPage, Question
from app.console.help import page
from app.console.host_protocol import Host, HostFactory
from app.console.language import languages, tr, use_language
from app.console.live import Live
from app.console.session.screen import SessionScreen
from app.console.session.state import SessionState
from app.console.stop import StopSwitch, with_stop
from app.console.themes import THEME_NAMES, THEMES
from app.errors import AppError
from app.host import SessionHost, make_setup
from app.paths import Home
from app.setup import SessionSetup
from profiles.schema import Profile

TICK_S = 0.05  # the console's beat; control calls it silent after 0.2 s


class ConsoleApp(App[None]):
    """Holds the one session, if any, and passes its state to whatever screens are open."""

    CSS_PATH = "styles.tcss"
    TITLE = "rleex"
    BINDINGS: ClassVar[list[BindingType]] = list(keys.EVERYWHERE)
    HORIZONTAL_BREAKPOINTS = [  # noqa: RUF012 - declared by Textual
        (0, "-narrow"),
        (72, "-normal"),
        (130, "-wide"),
    ]
    VERTICAL_BREAKPOINTS = [  # noqa: RUF012 - declared by Textual
        (0, "-tiny"),
        (16, "-short"),
        (38, "-tall"),
    ]

    def __init__(
        self,
        home: Home,
        config: Config,
        *,
        profile: Profile | None = None,
        make_host: HostFactory = SessionHost,
        read_only: bool = False,
    ) -> None:
        keys.check_keymap(config.keys)
        use_language(config.language)
        self.switch = StopSwitch()
        self.switch.keys = frozenset(keys.keys_of("stop", config.keys))
        super().__init__()
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = config.theme if config.theme in THEME_NAMES else THEME_NAMES[0]
        self.home = home
        self.config = config
        self.read_only = read_only
        self.live: Live | None = None
        self._profile = profile
        self._make_host = make_host
        self._language = config.language
        self._leaving = False

    def get_driver_class(self) -> type[Driver]:
        """The terminal's driver, with STOP taken out of the input first."""
        return with_stop(super().get_driver_class(), self.switch)

    async def on_mount(self) -> None:
        self.set_keymap(self.config.keys)
        self._end_on_signals()
        self.set_interval(TICK_S, self._tick)
        if self._profile is not None:
            await self.begin_session(self._profile, self.config)

    async def begin_session(self, profile: Profile, config: Config) -> None:
        """Start the processes for a patient, and show the live screen at once."""
        setup = make_setup(self.home, config, profile, operator="")
        self.live = Live(self._make_host(setup), self.switch)
        await self.push_screen(SessionScreen())
        self.run_worker(self._start(self.live), exclusive=False)

    async def end_session_asking(self) -> None:
        """End the session; while drives are powered, only after a yes."""
        if not self._powered():
            await self.end_session()
            return
        self.push_screen(Question(tr("end.title"), tr("end.words")), self._end_if)

    async def end_session(self) -> None:
        """Bring the legs to rest, end the processes, leave the live screen."""
        live = self.live
        if live is None:
            return
        self.live = None
        await asyncio.to_thread(live.close)
        while isinstance(self.screen, (SessionScreen, Dialog)):
            await self.pop_screen()
        self.exit()

    def live_state(self) -> SessionState | None:
        """The session's newest state; None without a session."""
        return None if self.live is None else self.live.state

    def live_host(self) -> Host:
        """The session's host. Raises AppError without a session."""
        if self.live is None:
            raise AppError("There is no session; begin one from the patients' list.")
        return self.live.host

    def live_setup(self) -> SessionSetup:
        """What the session was started with."""
        return self.live_host().setup

    @property
    def has_digital_hand(self) -> bool:
        """Whether keys move a hand."""
        return self.live is not None and self.live.host.setup.config.camera.kind == "digital-hand"

    @property
    def key_names(self) -> dict[str, str]:
        """Each key of the table as it is shown, by its id with underscores."""
        return {
            str(binding.id).replace(".", "_"): self.get_key_display(
                binding.with_key(keys.keys_of(str(binding.id), self.config.keys)[0])
            )
            for binding in keys.ALL
        }

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Everything, for the command palette."""
        yield from commands(self, screen)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Without a session the STOP key is an ordinary key."""
        return self.switch.live if action == "stop" else True

    def action_stop(self) -> None:
        """STOP where the terminal's thread has not already taken it."""
        self.switch.press_key()

    async def action_leave(self) -> None:
        """Leave the program; with powered hardware joints only when asked twice."""
        hardware = self.live is not None and self.live.host.setup.config.joints.kind != "simulated"
        if self._leaving or not (hardware and self._powered()):
            await self.end_session()
            self.exit()
            return
        self._leaving = True
        self.push_screen(Question(tr("leave.title"), tr("leave.words")), self._leave_if)

    def action_help(self) -> None:
        """Help on the screen that is open."""
        screen = self.screen
        if isinstance(screen, (ConsoleScreen, Dialog)) and not isinstance(screen, HelpPage):
            self.push_screen(HelpPage(page(screen.HELP_PAGE, screen.active_bindings, self)))

    def action_next_theme(self) -> None:
        """Dark, light, high contrast, and around."""
        at = THEME_NAMES.index(self.theme) if self.theme in THEME_NAMES else -1
        self.theme = THEME_NAMES[(at + 1) % len(THEME_NAMES)]

    async def action_next_language(self) -> None:
        """The next language file; takes effect at once."""
        codes = list(languages())
        await self.speak(codes[(codes.index(self._language) + 1) % len(codes)])

    async def speak(self, code: str) -> None:
        """Say everything in this language."""
        self._language = code
        use_language(code)
        for screen in self.screen_stack:
            await screen.recompose()

    def action_lock_console(self) -> None:
        """Lock now."""

    def _tick(self) -> None:
        state = None
        if self.live is not None and not self.live.closed:
            state = self.live.tick()
        for screen in self.screen_stack:
            if isinstance(screen, (ConsoleScreen, Dialog)):
                screen.show_session(state)

    async def _start(self, live: Live) -> None:
        await asyncio.to_thread(live.start)

    async def _end_if(self, yes: bool | None) -> None:
        if yes:
            await self.end_session()

    async def _leave_if(self, yes: bool | None) -> None:
        self._leaving = False
        if yes:
            await self.end_session()
            self.exit()

    def _powered(self) -> bool:
        state = self.live_state()
        return state is not None and state.snapshot is not None and state.snapshot.enabled

    def _end_on_signals(self) -> None:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, lambda: loop.create_task(self._end_now()))

    async def _end_now(self) -> None:
        await self.end_session()
        self.exit()


def run_console(home: Home, config: Config, *, profile: Profile | None = None, read_only: bool = False) -> None:
    """Run the console until its operator leaves. Raises AppError for what the configuration gets wrong."""
    app = ConsoleApp(home, config, profile=profile, read_only=read_only)
    try:
        app.run()
    finally:
        if app.live is not None:
            app.live.close()
