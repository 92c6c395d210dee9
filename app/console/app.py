"""The console as a Textual application: what works everywhere, and what happens twenty times a second."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from multiprocessing import resource_tracker
from typing import ClassVar

from textual import events
from textual.app import SystemCommand
from textual.binding import BindingType
from textual.command import CommandPalette
from textual.css.query import NoMatches
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Input, TextArea

from app.console import keys
from app.console.ending import Ending
from app.console.input_time import INPUT, input_time_ns, is_late
from app.console.keys import commands
from app.console.live import Clock, HostFactory, preload_modules
from app.console.operator import Idle, since_boot_s
from app.console.pixels import PixelTerminal, asks
from app.console.screens.base import ConsoleScreen, Dialog
from app.console.screens.dialogs import Question, ask
from app.console.screens.help import HelpPage, page
from app.console.screens.patients import PatientsScreen
from app.console.screens.signin import LockScreen, SignInDialog
from app.console.session_flow import SessionFlow
from app.console.spoken import Sound, sounds_of, switched_on
from app.console.state import ProcessFault, SessionState, newly_ended
from app.console.terminal import TerminalDriver, TerminalEvents, with_stop
from app.console.themes import THEME_NAMES, THEMES
from app.console.widgets.picture import Picture
from app.ipc.messages import ProcessStatus
from app.session.host import SessionHost
from app.system.config import Config, SessionSetup
from app.system.operators import Permission, needs_sign_in
from app.system.paths import Home
from app.system.scheduling import autogroup_nice, set_scheduling
from app.text.catalogue import language, languages, tr, use_configured, use_language
from logs.reason import reason
from logs.records import ProcessEnd, SignOut
from profiles.schema import Profile

LATE_NOTICE_S = 5.0  # one notice at a time says that input came too late
TICK_S = 0.05  # the console's beat; control calls it silent after 0.23 s
REST_TICK_S = 0.2  # without a session: a list of patients that nobody touches costs next to nothing


class ConsoleApp(SessionFlow):
    """Keys that work everywhere, themes, languages, the lock, and the tick that feeds every open screen."""

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
        self._leave_question: Question | None = None
        self.pixels: PixelTerminal | None = None  # None: half blocks
        self._terminal: TerminalDriver | None = None  # None: no terminal's thread takes STOP
        self._loop_of_console: asyncio.AbstractEventLoop | None = None
        self._ending = Ending(self._lose_console, self._ask_to_end, self._restore_terminal)
        self._idle = Idle(touched_s=since_boot_s(), limit_s=0.0 if read_only else config.idle_lock_s)
        self._stop_ns = 0  # the newest STOP that counted as a touch
        self._late_notice_s = -LATE_NOTICE_S
        self._beat: Timer | None = None
        self._beat_s = 0.0

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
        if touch and not self._idle.is_over(since_boot_s()):
            self._idle = self._idle.touched(since_boot_s())
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

    def action_help(self) -> None:
        """Help on the screen that is open."""
        screen = self.screen
        if isinstance(screen, (ConsoleScreen, Dialog)) and not isinstance(screen, HelpPage):
            text = page(screen.HELP_PAGE, screen.bindings_in_force, self)
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

    def action_lock_console(self) -> None:
        """Lock now; STOP goes on working."""
        if self._barred():
            return
        if self.signed_in is not None:
            self.trail.emit(SignOut(name=self.signed_in.name, reason="locked"))
        self.show_lock()

    def _legs_move(self, state: SessionState | None) -> bool:
        return state is not None and state.moving and self.switch.live

    def _must_lock(self, state: SessionState | None) -> bool:
        """Whether nobody has touched this console for the time, and the legs stand."""
        return self._idle.is_over(since_boot_s()) and not self._legs_move(state)

    def _lock_idle(self) -> None:
        self._idle = self._idle.touched(since_boot_s())
        self.action_lock_console()

    def _barred(self) -> bool:
        """Whether a lock or a sign-in stands, on top or below help or a question."""
        return any(isinstance(screen, (LockScreen, SignInDialog)) for screen in self.screen_stack)

    async def action_sign_out(self) -> None:
        """Sign in, or make room for the next one; a session belongs to its own to the end.

        What is not saved is asked about, over the lock too: whoever signs out there needs no PIN.
        """
        if self.signed_in is None:
            await self._sign_in()
        elif self.live is not None:
            self.notify(tr("sign_out.session", name=self.signed_in.name, **self.key_names), severity="warning")
        elif self._keep_all():
            await self._sign_out()
        elif not isinstance(self.screen, Question):
            ask(self, lambda: tr("form.leave_title"), lambda: tr("form.leave_text"), self._sign_out)

    async def _sign_out(self) -> None:
        if self.signed_in is None:
            return
        name = self.signed_in.name
        self.trail.emit(SignOut(name=name, reason="signed out"))
        self.signed_in = None
        self._lock = None  # it goes with its operator
        await self.show_patients()
        self.notify(tr("sign_out.done", name=name))

    async def _sign_in(self) -> None:
        """By key, before anything asks for it: a reviewer moves nobody, and signs comments."""
        screen = self.screen
        if self.read_only:
            self.notify(tr("sign_out.watching"))
        elif isinstance(screen, ConsoleScreen) and self.live is None:
            with screen.notify_errors():
                if await self.anybody_can_sign_in():
                    self.ask_who(self.show_patients)
                else:
                    self.notify(tr("sign_out.nobody"))
        else:
            self.notify(tr("sign_out.nobody"))

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
            before = known.processes
            if self._terminal is None:
                live.input_alive()
            state = live.tick()
            self.tell_result(self.guided.update(state))
            if sounds_of(known, state) & self.sounds:
                self.bell()
            if not (live.ending or self.read_only):
                self._record_ended(newly_ended(before, state.processes))
        now_s, stop_ns, touch = since_boot_s(), self.switch.sent_ns, self._legs_move(state)
        if stop_ns > self._stop_ns:  # taken out of the input before `on_event`, and a touch as every other key
            self._stop_ns, touch = stop_ns, True
        if touch and not self._idle.is_over(now_s):  # after the computer's sleep neither counts
            self._idle = self._idle.touched(now_s)
        if self._must_lock(state):
            self._lock_idle()
        own = (screen for screen in reversed(self.screen_stack) if isinstance(screen, (ConsoleScreen, Dialog)))
        screen = next(own, None)  # below the palette it stays in sight; none is left while the program ends
        if screen is not None and screen.composed:
            with suppress(NoMatches):  # a screen that is just being taken down has lost its widgets
                screen.show_session(state)

    def _record_ended(self, processes: tuple[ProcessStatus, ...]) -> None:
        """Into the trail: a process that crashed can't."""
        for process in processes:
            cause = reason(ProcessFault.EXITED, exit_code=process.exit_code)
            self.trail.emit(ProcessEnd(pid=process.pid, ended=process.name, reason=cause))

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

    def _call_in_loop(self, call: Callable[[], object]) -> None:
        """From any thread; nothing before there is a loop, or once it is closed."""
        if self._loop_of_console is not None:
            with suppress(RuntimeError):
                self._loop_of_console.call_soon_threadsafe(call)

    def _input_alive(self) -> None:
        if (live := self.live) is not None:
            live.input_alive()

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


def run_console(home: Home, config: Config, *, straight: bool = False, read_only: bool = False) -> None:
    """Run the console until its operator leaves.

    straight: begin with the configured patient's session; so does a console that only simulates, because then
    nothing can happen to anybody. A session of this home whose console is gone is taken over instead.
    Raises AppError or ProfileError for what configuration or profile gets wrong.
    """
    from app.console.observer import observe
    from app.session.shared import held_session
    from profiles.store import ProfileStore

    if read_only:
        observe(home, config)
        return
    held = held_session(home)  # with what was chosen for it; the next session is begun with what is configured
    simulated = not needs_sign_in(config)
    profile = ProfileStore(home.profiles).load(config.patient) if (straight or simulated) and not held else None
    app = ConsoleApp(home, config, profile=profile, held=held)
    set_scheduling("console")
    left = False
    try:
        with autogroup_nice("console"):
            app.run()
        left = not app.return_code
    finally:
        if left:
            app.close_live()
            if app.left_held and held is not None:
                sys.stderr.write(f"{tr('console.left_held', limit_s=held.config.unattended_s)}\n")
        elif app.live is not None:  # a defect of the console ends no session: another console takes it over
            limit_s = app.live.host.setup.config.unattended_s
            app.leave_live()
            sys.stderr.write(f"{tr('console.left', limit_s=limit_s)}\n")
        app.trail.keep(home)
    if app.return_code:
        raise SystemExit(app.return_code)
