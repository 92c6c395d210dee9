"""The lock: by key, or when nobody has touched the console for a time; and making room for another operator."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from app.console.live import Clock, HostFactory
from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import Question, ask
from app.console.screens.signin import LockScreen, SignInDialog
from app.console.state import SessionState
from app.console.terminal_app import TerminalApp
from app.system.config import Config
from app.system.paths import Home
from app.text.catalogue import tr
from logs.records import SignOut


def since_boot_s() -> float:
    """The clock of `Idle`, in s; where there is one (Linux) it goes on while the computer sleeps, with nobody there."""
    return time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


@dataclass(frozen=True, slots=True, kw_only=True)
class Idle:
    """The last touch, by `since_boot_s`; `limit_s` 0: never lock."""

    touched_s: float
    limit_s: float

    def touched(self, now_s: float) -> Idle:
        """After a key, a click or motion."""
        return replace(self, touched_s=now_s)

    def is_over(self, now_s: float) -> bool:
        """Whether the time is over."""
        return self.limit_s > 0 and now_s - self.touched_s >= self.limit_s


class LockApp(TerminalApp):
    """Locks itself while the legs stand; STOP goes on working."""

    def __init__(self, home: Home, config: Config, make_host: HostFactory, clock: Clock, *, read_only: bool) -> None:
        super().__init__(home, config, make_host, clock, read_only=read_only)
        self._idle = Idle(touched_s=since_boot_s(), limit_s=0.0 if read_only else config.idle_lock_s)
        self._stop_ns = 0  # the newest STOP that counted as a touch

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

    def _touch(self) -> None:
        """Somebody is there; after the computer's sleep that does not count any more."""
        now_s = since_boot_s()
        if not self._idle.is_over(now_s):
            self._idle = self._idle.touched(now_s)

    def _update_idle(self, state: SessionState | None) -> None:
        """Lock where the time is over; legs that move are watched."""
        stop_ns, touch = self.switch.sent_ns, self._legs_move(state)
        if stop_ns > self._stop_ns:  # taken out of the input before `on_event`, and a touch as every other key
            self._stop_ns, touch = stop_ns, True
        if touch:
            self._touch()
        if self._must_lock(state):
            self._lock_idle()

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
