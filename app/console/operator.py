"""The signed-in operator: permissions, the lock, and the console's records in the audit trail."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import cached_property

from textual.app import App
from textual.binding import Binding

from app.audit.sink import AuditSink, entry_now
from app.console import keys
from app.console.screens.signin import LockScreen, SignInDialog
from app.system.authority import Authority, unsigned
from app.system.config import Config, SessionSetup
from app.system.errors import AppError
from app.system.journals import append_waiting, are_recorded
from app.system.operators import Permission, load_store, needs_sign_in
from app.system.paths import Home
from app.text.catalogue import knows, tr
from logs.errors import AuditError
from logs.records import Body, Entry, SignIn


class SignedInApp(App[None]):
    """The one who is signed in, if anybody, measured by the table of roles."""

    def __init__(self, home: Home, config: Config, *, read_only: bool) -> None:
        super().__init__()
        self.home = home
        self.config = config
        self.read_only = read_only
        self.signed_in: Authority | None = None
        self.trail = ConsoleTrail(lambda: self.operator)
        self._lock: LockScreen | SignInDialog | None = None  # the newest; it may have been opened since

    @property
    def operator(self) -> str:
        """Who is signed in; empty in simulation."""
        return self.signed_in.name if self.signed_in else ""

    @property
    def authority(self) -> Authority:
        """Whose changes they are. Raises AppError where somebody must sign in first."""
        return self.signed_in or unsigned(self.home, self.config)

    @cached_property
    def key_names(self) -> dict[str, str]:
        """Each key of the table as it is shown, by its id with underscores; in the language in use."""
        return {str(binding.id).replace(".", "_"): self._key_name(binding) for binding in keys.ALL}

    def _key_name(self, binding: Binding) -> str:
        key = keys.keys_of(str(binding.id), self.config.keys)[0]
        return tr(f"key.{key}") if knows(f"key.{key}") else self.get_key_display(binding.with_key(key))

    def may(self, permission: Permission, config: Config | None = None) -> bool:
        """Whether the table of roles allows it; simulated joints move for everybody."""
        if permission is Permission.OPERATE and not needs_sign_in(config or self.config):
            return True
        try:
            return self.authority.may(permission)
        except AppError:
            return False

    async def permitted(
        self, permission: Permission, then: Callable[[], Awaitable[object]], config: Config | None = None
    ) -> None:
        """Do it if they may; ask who it is where nobody is signed in, tell whose role does not allow it."""
        if self.may(permission, config):
            await then()
        elif self.signed_in is not None:
            role = tr(self.signed_in.role) if self.signed_in.role else ""
            text = tr("sign_in.may_not", role=role, what=tr(permission), **self.key_names)
            self.notify(text, severity="error", timeout=15)
        else:
            self.ask_who(lambda: self.permitted(permission, then, config))

    def ask_who(self, then: Callable[[], Awaitable[object]]) -> None:
        """Ask for name and PIN, and go on with whoever gives them."""

        async def signed_in(operator: Authority | None) -> None:
            if operator is not None:
                self.signed_in = operator
                await then()

        self.push_screen(SignInDialog(), signed_in)

    @property
    def locked(self) -> bool:
        """Whether the lock stands, on top or below something else."""
        return self._lock in self.screen_stack

    def show_lock(self) -> None:
        """Over whatever is open; who is signed in opens it by PIN."""
        self._lock = LockScreen() if self.signed_in is None else SignInDialog(unlock=self.signed_in.name)
        self.push_screen(self._lock)

    async def anybody_can_sign_in(self) -> bool:
        """Whether this home has operators, or needs its first one. Raises AppError where they can't be read."""
        if needs_sign_in(self.config):
            return True
        return bool((await asyncio.to_thread(load_store, self.home.keys)).operators)


_MOST_WAITING = 1000  # sign-ins before a session; a person types no more


class ConsoleTrail:
    """Queues records, each with its own time and operator, until a session's trail or the operators' journal has them.

    What was before a session is none of its own: from its first record on its time counts.
    """

    def __init__(self, operator: Callable[[], str]) -> None:
        """operator: who is signed in; empty: nobody."""
        self._operator = operator
        self._sink: AuditSink | None = None
        self._waiting: list[Entry] = []

    def open(self, setup: SessionSetup) -> None:
        """A session's audit process will listen."""
        self._sink = AuditSink(setup.links, "console", setup.operator)
        waiting, self._waiting = self._waiting, []
        for entry in waiting:
            self._sink.forward(entry)

    def emit(self, body: Body) -> None:
        """Put one record in the trail."""
        if self._sink is not None:
            self._sink.emit(body)
        elif len(self._waiting) < _MOST_WAITING:
            operator = body.name if isinstance(body, SignIn) else self._operator()  # nobody is signed in before it
            self._waiting.append(entry_now("console", operator, body))

    def keep(self, home: Home) -> None:
        """What no session took goes into the operators' journal; may take a second, and may run beside `emit`.

        Raises AuditError when the disk refuses: the records are kept later, or stand there without their anchor.
        """
        if not (waiting := tuple(self._waiting)):
            return
        try:
            append_waiting(home, waiting)
        except AuditError as error:
            if are_recorded(error):
                del self._waiting[: len(waiting)]
            raise
        del self._waiting[: len(waiting)]

    def close(self) -> None:
        """The session ends."""
        if self._sink is not None:
            self._sink.close()
            self._sink = None
