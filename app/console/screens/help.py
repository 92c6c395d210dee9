"""Contextual help: a page a screen from the language file, and the keys that work there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.geometry import Size
from textual.widget import Widget
from textual.widgets import Static

from app.console.screens.base import Dialog, text_of
from app.console.widgets.panel import Line, Lines, cells, content_of, padded, plain
from app.text.catalogue import knows, tr

if TYPE_CHECKING:
    from textual.binding import ActiveBinding

    from app.console.app import ConsoleApp

Keys = tuple[tuple[str, str], ...]  # how a key is shown, and what it does
_HAND = "hand."  # the digital hand's keys come last: F1 to F4 must be seen without scrolling


@dataclass(frozen=True, slots=True)
class Page:
    """name, stop: of the texts that say what this screen is for, and where STOP is. keys: with the names of theirs."""

    name: str
    stop: str
    keys: Keys

    def lines(self, key_names: Mapping[str, str]) -> Lines:
        """What the screen is for, and STOP, in the language of now. key_names: how each key of the table is shown."""
        return (plain(tr(self.name, **key_names)), plain(""), plain(tr(self.stop, **key_names), "bold"), plain(""))


def page(name: str, bindings: Mapping[str, ActiveBinding], app: ConsoleApp) -> Page:
    """The page of this name, or the general one."""
    named = [active for active in bindings.values() if active.binding.id is not None and active.enabled]
    named.sort(key=lambda active: str(active.binding.id).startswith(_HAND))
    keys = tuple((app.get_key_display(active.binding), active.binding.description) for active in named)
    stop = "help.stop_elsewhere" if app.read_only else "help.stop"
    return Page(f"help.{name}" if knows(f"help.{name}") else "help.general", stop, keys)


def table(keys: Keys, width: int) -> Lines:
    """The keys in as many columns as so many cells hold, row by row."""
    key_width = max((cells(key) for key, _ in keys), default=0)
    does_width = max((cells(does) for _, does in keys), default=0)
    columns = max(1, width // (key_width + does_width + 4))
    each = width // columns
    return tuple(
        tuple(part for key, does in keys[at : at + columns] for part in _item(key, does, key_width, each))
        for at in range(0, len(keys), columns)
    )


def _item(key: str, does: str, key_width: int, width: int) -> Line:
    shown = f" {padded(key, key_width)}  "
    return ((shown, "bold $accent"), (padded(does, width - cells(shown)), ""))


class KeyTable(Widget):
    """As high as its width makes it."""

    can_focus = False

    def __init__(self, keys: Keys) -> None:
        super().__init__()
        self._keys = keys

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:  # noqa: ARG002 - Textual's own
        """Rows of the table."""
        return len(table(self._keys, width))

    def render(self) -> Content:
        return content_of(table(self._keys, self.content_size.width))


class HelpPage(Dialog[None]):
    """One page of contextual help, and the keys of the screen below."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("f1", "cancel", "bind.cancel", id="help")]

    def __init__(self, page: Page) -> None:
        super().__init__()
        self._page = page

    def compose(self) -> ComposeResult:
        with VerticalScroll(classes="dialog page") as box:
            box.border_title = tr("help.title")
            text = self._page.lines(self.console_app.key_names)
            yield Static(content_of(text))  # a Markdown widget makes fifty, which take half a second
            yield KeyTable(tuple((key, text_of(does)) for key, does in self._page.keys))
        yield from self.compose_bottom()
