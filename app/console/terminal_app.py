"""The application at its terminal: driver, pixels, and its end: asked, by a signal, or with the terminal.

A signal, or the loss of the terminal, ends it within two seconds, whatever its threads wait for. The session stays,
held, for the console that takes it over (`app/session/supervise.py`).
"""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver

from app.console.live import Clock, HostFactory
from app.console.pixels import PixelTerminal, asks
from app.console.screens.base import ConsoleScreen, Dialog
from app.console.screens.dialogs import Question
from app.console.session_flow import SessionFlow
from app.console.terminal import TerminalDriver, TerminalEvents, with_stop
from app.console.widgets.picture import Picture
from app.system.config import Config
from app.system.operators import needs_sign_in
from app.system.paths import Home
from app.system.scheduling import set_scheduling
from app.text.catalogue import tr

ORDERLY_S = 0.5  # with 0.4 s for the terminal's restoring, and a busy machine's delays, below two seconds
ENDING_SIGNALS = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)  # Ctrl-C is a key: the terminal sends no signal for it


class TerminalApp(SessionFlow):
    """Ends in order from its event loop, and in time without it; what is not saved is kept, or asked about."""

    def __init__(self, home: Home, config: Config, make_host: HostFactory, clock: Clock, *, read_only: bool) -> None:
        super().__init__(home, config, make_host, clock, read_only=read_only)
        self.pixels: PixelTerminal | None = None  # None: half blocks
        self._leave_question: Question | None = None
        self._terminal: TerminalDriver | None = None  # None: no terminal's thread takes STOP
        self._loop_of_console: asyncio.AbstractEventLoop | None = None
        self._ending = Ending(self._lose_console, self._ask_to_end, self._restore_terminal)

    def get_driver_class(self) -> type[Driver]:
        """The terminal's driver, with STOP taken out of the input first."""
        base = super().get_driver_class()
        return TerminalDriver if base is LinuxDriver else with_stop(base, lambda: self.switch)

    @property
    def terminal_events(self) -> TerminalEvents:
        """What the terminal's driver reports to."""
        return TerminalEvents(
            switch=lambda: self.switch,
            input_alive=self._input_alive,
            lost=self._ending.begin,
            repaint=lambda: self._call_in_loop(self.refresh),
            attached=self._use_terminal,
            pixels=self._found_pixels if self.config.picture == "auto" and asks(os.environ) else None,
        )

    async def action_leave(self) -> None:
        """Leave the program; with powered hardware joints, or something not saved, only when asked twice."""
        if self._leave_question in self.screen_stack:
            await self._leave_if(True)
            return
        hardware = self.live is not None and needs_sign_in(self.live.host.setup.config)
        carries = hardware and self.powered()
        if not carries and self._keep_all():
            await self._end_now()
            return
        title, text = ("leave.title", "leave.text") if carries else ("form.leave_title", "form.leave_text")
        self._leave_question = Question(lambda: tr(title), lambda: tr(text))
        self.push_screen(self._leave_question, self._leave_if)

    def _keep_all(self) -> bool:
        """Whether every screen could keep what it holds; each of them tries."""
        kept = [screen.keep() for screen in self.screen_stack if isinstance(screen, (ConsoleScreen, Dialog))]
        return all(kept)

    def _discard_all(self) -> None:
        """While the trail is still open."""
        for screen in self.screen_stack:
            if isinstance(screen, ConsoleScreen):
                screen.discard()

    async def _leave_if(self, yes: bool | None) -> None:
        if yes:
            self._keep_all()  # what can be kept is, though nobody asks about the rest again
            await self._end_now()

    def _use_terminal(self, terminal: TerminalDriver) -> None:
        self._terminal = terminal

    def _found_pixels(self, pixels: PixelTerminal) -> None:
        """From the input's thread, before the first paint or long after it."""
        self.pixels = pixels
        self._call_in_loop(self._fit_pictures)

    def _fit_pictures(self) -> None:
        for picture in self.screen.query(Picture):
            picture.on_resize()

    def _input_alive(self) -> None:
        if (live := self.live) is not None:
            live.input_alive()

    def _call_in_loop(self, call: Callable[[], object]) -> None:
        """From any thread; nothing before there is a loop, or once it is closed."""
        if self._loop_of_console is not None:
            with suppress(RuntimeError):
                self._loop_of_console.call_soon_threadsafe(call)

    def _lose_console(self) -> None:
        if (live := self.live) is not None:
            live.console_lost()

    def _ask_to_end(self) -> None:
        self._call_in_loop(lambda: asyncio.create_task(self._leave_now()))

    def _restore_terminal(self) -> None:
        if self._terminal is not None:
            self._terminal.restore()

    async def _leave_now(self) -> None:
        self._keep_all()  # what can be kept is; nobody is there to be asked about the rest
        self._discard_all()
        await asyncio.to_thread(self.leave_live)
        self.exit()

    async def _end_now(self) -> None:
        self._discard_all()
        await asyncio.to_thread(self.close_live)
        self.exit()


class Ending:
    """Ends the process in three steps: the heartbeat, the program's own end, and by force where that takes too long."""

    def __init__(
        self, lose_console: Callable[[], object], ask: Callable[[], object], restore: Callable[[], object]
    ) -> None:
        """lose_console: end the heartbeat; ask: end in order; restore: the terminal. None of them may block."""
        self._lose_console = lose_console
        self._ask = ask
        self._restore = restore
        self._begun = False

    def on_signals(self) -> None:
        """Begin on these signals. From the main thread; works while the event loop is stuck."""
        for number in ENDING_SIGNALS:
            signal.signal(number, lambda number, _: self.begin(128 + number))

    def begin(self, status: int = 128 + signal.SIGHUP) -> None:
        """Begin to end; status: the process's, where it does not end by itself. From any thread, or a handler."""
        if not self._begun:
            self._begun = True
            threading.Thread(target=self._run, args=(status,), name="ending", daemon=True).start()

    def _run(self, status: int) -> None:
        limit_s = time.monotonic() + ORDERLY_S
        set_scheduling("heartbeat")  # whatever else keeps the cores
        with suppress(Exception):  # whatever fails, the process ends
            self._lose_console()
        with suppress(RuntimeError):  # the event loop is closed
            self._ask()
        time.sleep(max(0.0, limit_s - time.monotonic()))
        with suppress(Exception):
            self._restore()
        os._exit(status)
