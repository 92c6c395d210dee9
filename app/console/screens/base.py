"""What every screen has: translated footer, STOP bar, breakpoints."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, cast

from textual import events, on
from textual.actions import SkipAction
from textual.app import ComposeResult
from textual.await_complete import AwaitComplete
from textual.await_remove import AwaitRemove
from textual.binding import ActiveBinding, Binding, BindingType
from textual.geometry import Size
from textual.screen import ModalScreen, Screen
from textual.widget import Widget
from textual.widgets import Button, Input, OptionList, Select

from app.console.state import SessionState
from app.console.widgets.bars import KeyBar, StopBar
from app.console.widgets.picture import Picture
from app.text.catalogue import knows, render, tr
from logs.reading.errors import CodedError

USER_ERRORS = (CodedError, OSError)

if TYPE_CHECKING:
    from app.console.app import ConsoleApp

T = TypeVar("T")


class _Console(Screen[T], Generic[T]):
    """Common ground of screens and dialogs."""

    # Before the next key is given to a field: after a stall all keys are there at once, and Textual would give them to
    # the field that had the focus before the first of them was worked on.
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "leave_field(True)", show=False, priority=True),
        Binding("shift+tab", "leave_field(False)", show=False, priority=True),
    ]
    HELP_PAGE = ""  # name of the contextual help in the language files
    composed = False  # its widgets are there; not while `recompose` makes them anew
    _styled_for = ""  # the theme that its widgets' styles were made for

    def __init__(self) -> None:
        super().__init__()
        self._resumed = asyncio.Event()  # it has come to the top again
        self._answered_ns: int | None = None  # when the input was given that dismissed it

    async def on_event(self, event: events.Event) -> None:
        """Keys of its own may have waited here, as others for the application."""
        if not isinstance(event, events.Key) or self.console_app.admits(event):
            await super().on_event(event)

    @on(events.Compose)
    def _reach_breakpoints(self) -> None:
        """Set the breakpoints' classes; Textual does so after the first layout, and then styles and paints again."""
        for name in self._breakpoints(self.app.size):
            self.add_class(name, update=False)
        self._styled_for = self.app.theme

    @on(events.ScreenResume)
    def _keep_styles(self, event: events.ScreenResume) -> None:
        """Make the styles anew only for another theme: a tenth of what opening or closing a dialog costs."""
        event.refresh_styles = self._styled_for != self.app.theme
        self._styled_for = self.app.theme
        self._resumed.set()

    async def on_top(self) -> None:
        """Wait until nothing is above: what a thread has found must neither open over the lock nor be lost below it."""
        while not self.is_active:
            self._resumed.clear()
            await self._resumed.wait()

    def on_mount(self) -> None:
        """Textual calls this beside a subclass's own."""
        self.composed = True

    async def recompose(self) -> None:
        """In another language; what was typed, chosen and focused stays."""
        fields = [field for field in self.query("Input, Select") if field.id]
        values = {field.id: cast("Input | Select[object]", field).value for field in fields}
        focused = self.focused
        if focused is not None and isinstance(focused.parent, Select):  # a choice that was open is closed then
            focused = focused.parent
        composed, self.composed = self.composed, False
        await super().recompose()
        self.composed = composed
        for field in self.query("Input, Select"):
            if field.id in values:
                cast("Input | Select[object]", field).value = values[field.id]
        if focused is not None:
            self._focus_again(focused)
        self.fill()

    def _focus_again(self, before: Widget) -> None:
        """What stands now where this one was."""
        now = next(iter(self.query(f"#{before.id}" if before.id else type(before).__name__)), None)
        if isinstance(now, Input) and isinstance(before, Input):
            now.selection = before.selection
        elif isinstance(now, OptionList) and isinstance(before, OptionList):
            now.highlighted = before.highlighted
        self.set_focus(now, from_app_focus=True)  # else a field selects all, and the next key replaces it

    def every(self, period_s: float, call: Callable[[], object]) -> None:
        """Call this again and again, but not while `recompose` has taken the widgets that it looks for."""
        self.set_interval(period_s, lambda: call() if self.composed else None)

    def fill(self) -> None:
        """Put in what `compose` leaves empty: once it has opened, and in another language."""

    @on(events.Resize)
    def _skip_known_size(self, event: events.Resize) -> None:
        """Textual sends a size that is laid out already; without this it lays out again, the screens below too.

        `size` is the application's, new before anything is laid out; `outer_size` is what was laid out last.
        """
        if event.size == self.outer_size and all(map(self.has_class, self._breakpoints(event.size))):
            event.prevent_default()
            event.stop()

    def remove(self) -> AwaitRemove:
        """Drop the drawings of its widgets first: Textual keeps those of the last 1,024, 0.5 MB a page of help."""
        for widget in self.walk_children(Widget):
            widget.refresh()
        return super().remove()

    def dismiss(self, result: T | None = None) -> AwaitComplete:
        """Close it while it is on top; Textual closes whatever is: the screen below, or the lock above."""
        self._answered_ns = self.console_app.input_ns
        return super().dismiss(result) if self.is_active else AwaitComplete()

    def answering(self, then: Callable[[T | None], Any]) -> Callable[[T | None], Any]:
        """What is called with the answer, though later: what it commands was given with the answer."""

        def answer(result: T | None) -> Any:
            self.console_app.input_ns = self._answered_ns
            return then(result)

        return answer

    def action_leave_field(self, forward: bool) -> None:
        """To the next one, or back; elsewhere Tab is as every other key, and a screen may give it a meaning."""
        if not isinstance(self.focused, (Input, Select, Button)):
            raise SkipAction
        if forward:
            self.focus_next()
        else:
            self.focus_previous()

    def action_go_to(self, field: str) -> None:
        """Into this field, before the next key; in a field the key is a letter."""
        if isinstance(self.focused, Input):
            raise SkipAction
        self.set_focus(self.query_one(field))

    def keep(self) -> bool:
        """Keep what would be lost if the program ended now; False: it can't, or nobody knows whether it should."""
        return True

    @property
    def console_app(self) -> ConsoleApp:
        """The application, by its own type."""
        return cast("ConsoleApp", self.app)

    @property
    def help_page(self) -> str:
        """Which page of the contextual help is this screen's."""
        return self.HELP_PAGE

    @property
    def bindings_in_force(self) -> dict[str, ActiveBinding]:
        """The keys in force; descriptions are names of texts."""
        return super().active_bindings

    @property
    def active_bindings(self) -> dict[str, ActiveBinding]:
        """The keys in force, described in the therapist's language."""
        return {
            key: active._replace(
                binding=replace(active.binding, description=text_of(_named(active.binding))),
                tooltip=text_of(active.tooltip),
            )
            for key, active in self.bindings_in_force.items()
        }

    def show_session(self, state: SessionState | None) -> None:
        """Take the session's newest state, twenty times a second; None: no session."""
        for stop_bar in self.query(StopBar):
            stop_bar.show(state)

    @on(events.ScreenSuspend)
    def _clear_pixels(self) -> None:
        for picture in self.query(Picture):
            picture.clear_pixels()

    @contextmanager
    def notify_errors(self) -> Iterator[None]:
        """Notify the operator of an error in the body; nothing typed is lost."""
        try:
            yield
        except USER_ERRORS as error:
            self.notify(render(error), severity="error", timeout=15, markup=False)

    def _breakpoints(self, size: Size) -> tuple[str, str]:
        """The classes that a screen of this size has."""
        across, down = self.app.HORIZONTAL_BREAKPOINTS, self.app.VERTICAL_BREAKPOINTS
        return _reached(across, size.width), _reached(down, size.height)

    def compose_bottom(self) -> ComposeResult:
        """The STOP bar and the keys."""
        app = self.console_app
        yield StopBar(app.switch, app.key_names, watching=app.read_only)
        yield KeyBar()


def _reached(breakpoints: list[tuple[int, str]] | None, cells: int) -> str:
    """The class of the largest breakpoint that so many columns or rows reach."""
    return max((least, name) for least, name in breakpoints or [(0, "-any")] if cells >= least)[1]


class ConsoleScreen(_Console[None]):
    """A screen of the console."""

    def discard(self) -> None:
        """The program ends now: record what is given up, once."""


class Dialog(_Console[T], ModalScreen[T]):
    """A question over a screen; STOP works through it."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape", "cancel", "bind.cancel")]

    @on(events.ScreenResume)
    def _show_newest(self) -> None:
        """One that is opened again must not show what was, not even until the next beat."""
        if self.composed:
            self.show_session(self.console_app.live_state())
            self.refresh_bindings()

    def action_cancel(self) -> None:
        """Close without an answer."""
        self.dismiss(None)


def _named(binding: Binding) -> str:
    """Of Textual's own bindings one is shown: that of an open choice."""
    ours = binding.action != "dismiss" or knows(binding.description)
    return binding.description if ours else "bind.cancel"


def text_of(key: str) -> str:
    """Ours by the catalogue; Textual's own bindings bring their text along."""
    return tr(key) if knows(key) else key
