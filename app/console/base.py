"""What every screen of the console has: translated footer, STOP bar, the same breakpoints."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar, cast

from textual.app import ComposeResult
from textual.binding import ActiveBinding, BindingType
from textual.screen import ModalScreen, Screen

from app.console.key_bar import KeyBar
from app.console.language import tr
from app.console.session.state import SessionState
from app.console.stop_bar import StopBar
from app.errors import AppError
from hal.errors import HardwareError
from logs.errors import AuditError
from profiles.errors import ProfileError

USER_ERRORS = (AppError, HardwareError, AuditError, ProfileError, OSError)

if TYPE_CHECKING:
    from app.console.app import ConsoleApp

T = TypeVar("T")


class _Console(Screen[T], Generic[T]):
    """Common ground of screens and dialogs."""

    HELP_PAGE = ""  # name of the contextual help in the language files
    composed = False  # its widgets are there

    def on_mount(self) -> None:
        """Textual calls this beside a subclass's own."""
        self.composed = True

    @property
    def console_app(self) -> ConsoleApp:
        """The application, by its own type."""
        return cast("ConsoleApp", self.app)

    @property
    def active_bindings(self) -> dict[str, ActiveBinding]:
        """The keys in force, described in the therapist's language."""
        return {
            key: active._replace(
                binding=replace(active.binding, description=tr(active.binding.description)),
                tooltip=tr(active.tooltip) if active.tooltip else "",
            )
            for key, active in super().active_bindings.items()
        }

    def show_session(self, state: SessionState | None) -> None:
        """Take the session's newest state, twenty times a second; None: no session."""
        for stop_bar in self.query(StopBar):
            stop_bar.show(None if state is None else state.effect)

    @contextmanager
    def told(self) -> Iterator[None]:
        """Tell the operator in a sentence what went wrong in the body; nothing typed is lost."""
        try:
            yield
        except USER_ERRORS as error:
            self.notify(str(error), severity="error", timeout=15, markup=False)

    def compose_bottom(self) -> ComposeResult:
        """The STOP bar and the keys."""
        yield StopBar(self.console_app.switch, watching=self.console_app.read_only)
        yield KeyBar()


class ConsoleScreen(_Console[None]):
    """A screen of the console."""


class Dialog(_Console[T], ModalScreen[T]):
    """A question over a screen; STOP works through it."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape", "cancel", "bind.cancel")]

    def action_cancel(self) -> None:
        """Close without an answer."""
        self.dismiss(None)
