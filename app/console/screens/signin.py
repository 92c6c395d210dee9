"""Sign-in by name and PIN; the first one sets up the engineer. Also locks and unlocks the console."""

from __future__ import annotations

import asyncio
import time
from enum import Enum, auto
from functools import partial
from typing import ClassVar

from textual.actions import SkipAction
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import Input, Static

from app.console.screens.base import USER_ERRORS, Dialog
from app.system.authority import Authority, Proof, of_operator
from app.system.config import SessionSetup
from app.system.enrolment import enrol_first
from app.system.errors import AppError
from app.system.operators import Operator, load_store, may_take_over
from app.system.sign_in import try_pin
from app.text.catalogue import render, tr
from logs.reason import reason
from logs.records import SignIn, SignInFailed


class SignInFault(Enum):
    """Why the console refuses a right PIN."""

    LOCKED_BY_ANOTHER = auto()  # name
    MAY_NOT_TAKE_OVER = auto()  # name


class SignInDialog(Dialog[Authority]):
    """Gives who has signed in, or None when left with Escape."""

    HELP_PAGE = "sign_in"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "leave_name", show=False, priority=True),
    ]

    def __init__(self, *, unlock: str = "", held: SessionSetup | None = None) -> None:
        """unlock: the operator whose console this is; nobody else's PIN opens it, and Escape doesn't leave it.

        held: the session to take over, by its operator's PIN or a therapist's.
        """
        super().__init__()
        self._unlock = unlock
        self._held = held
        self._first = False
        self._trying = False  # a PIN; another Enter meanwhile is no further attempt

    def compose(self) -> ComposeResult:
        reason = ""
        try:
            self._first = not (self._unlock or self._held) and not load_store(self.console_app.home.keys).operators
        except AppError as error:
            reason = f"✗ {render(error)}"
        kind = "take_over" if self._held else "first" if self._first else "unlock" if self._unlock else "sign_in"
        name = self._held.operator if self._held else self._unlock
        patient = self._held.profile.identifier if self._held else ""
        with Vertical(classes="dialog") as box:
            box.border_title = tr(f"{kind}.title")
            text = tr(f"{kind}.text", name=name, patient=patient, **self.console_app.key_names)
            yield Static(text, markup=False, classes="intro")
            yield Input(name, placeholder=tr("sign_in.name"), id="name", max_length=60)
            yield Input(placeholder=tr("sign_in.pin"), id="pin", password=True, max_length=12)
            yield Static(reason, id="reason", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.query_one("#pin" if self._unlock or self._held else "#name").focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter in the PIN tries it."""
        if not self._trying:
            self._trying = True
            event.input.value = ""
            self.run_worker(self._try(self.query_one("#name", Input).value, event.value))

    async def _try(self, name: str, pin: str) -> None:
        try:
            sign_in = partial(enrol_first, self.console_app.home) if self._first else self._sign_in
            operator = await asyncio.to_thread(sign_in, name, pin)
            await self.on_top()
            self.dismiss(operator)
        except USER_ERRORS as error:
            why = self.query_one("#reason", Static)
            why.update(f"✗ {render(error)}")
            self.call_after_refresh(self.query_one(".dialog").scroll_end, animate=False)
        finally:
            self._trying = False

    def on_input_changed(self, event: Input.Changed) -> None:
        """On a small screen the reason may have covered the field."""
        if event.value:
            event.input.scroll_visible(animate=False)

    def action_cancel(self) -> None:
        if not self._unlock:
            self.dismiss(None)

    def action_leave_name(self) -> None:
        """Enter there goes on to the PIN, before the next key is given to a field."""
        if self.focused is None or self.focused.id != "name":
            raise SkipAction
        self.focus_next()

    def _sign_in(self, name: str, pin: str) -> Authority:
        attempt = try_pin(self.console_app.home.keys, name, pin, time.time())
        if attempt.operator is None:
            assert attempt.fault is not None
            cause = reason(attempt.fault)
            failed = SignInFailed(name=name, reason=cause, failures=attempt.failures, wait_s=attempt.wait_s)
            self.console_app.trail.emit(failed)
            raise AppError(attempt.fault, wait_s=attempt.wait_s)
        operator = attempt.operator
        if self._unlock and operator.name != self._unlock:
            raise self._refused(operator, SignInFault.LOCKED_BY_ANOTHER, self._unlock)
        if self._held and not may_take_over(operator, self._held.operator):
            raise self._refused(operator, SignInFault.MAY_NOT_TAKE_OVER, self._held.operator)
        self.console_app.trail.emit(SignIn(name=operator.name, role=operator.role.value, unlocked=bool(self._unlock)))
        return of_operator(self.console_app.home, operator, Proof.PIN)

    def _refused(self, operator: Operator, fault: SignInFault, owner: str) -> AppError:
        cause = reason(fault, name=owner)
        self.console_app.trail.emit(SignInFailed(name=operator.name, reason=cause, failures=0, wait_s=0.0))
        return AppError(fault, name=owner)


class LockScreen(Dialog[bool]):
    """Nobody is signed in: Enter unlocks. STOP works as ever."""

    BINDINGS: ClassVar[list[BindingType]] = [("enter", "unlock", "bind.unlock")]
    HELP_PAGE = "lock"

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("lock.title")
            yield Static(tr("lock.text"), markup=False)
        yield from self.compose_bottom()

    def action_unlock(self) -> None:
        """Go on."""
        self.dismiss(True)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Escape is too easily hit to unlock."""
        return action != "cancel"
