"""A widget that draws lines of styled words, and draws again only when they have changed."""

from __future__ import annotations

from rich.cells import cell_len, set_cell_size
from textual.content import Content
from textual.widget import Widget

from app.console.state import SessionState

Part = tuple[str, str]  # words and their style, such as "bold $success"
Line = tuple[Part, ...]
Lines = tuple[Line, ...]


def plain(words: str, style: str = "") -> Line:
    """A line in one style."""
    return ((words, style),)


def content_of(lines: Lines) -> Content:
    """The lines as a widget draws them."""
    return Content("\n").join(Content.assemble(*line) for line in lines)


def cells(words: str) -> int:
    """How many cells the words take; a Chinese character takes two."""
    return cell_len(words)


def padded(words: str, width: int) -> str:
    """The words, filled or cut to `width` cells."""
    return set_cell_size(words, width)


def bar(share: float, width: int) -> str:
    """A bar of `width` cells, `share` of it full, in eighths of a cell."""
    eighths = round(max(0.0, min(1.0, share)) * width * 8)
    full, rest = divmod(eighths, 8)
    return ("█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")).ljust(width, "·")


class Panel(Widget):
    """Shows `Lines`; the title stands in the border."""

    can_focus = False

    def __init__(self, id: str | None = None, title: str = "") -> None:  # noqa: A002 - Textual's own name
        super().__init__(id=id)
        self._lines: Lines = ()
        self.border_title = title

    @property
    def lines(self) -> Lines:
        """What is shown."""
        return self._lines

    @property
    def text(self) -> str:
        """The words shown, without their styles."""
        return "\n".join("".join(words for words, _ in line) for line in self._lines)

    def show_lines(self, lines: Lines) -> None:
        """Show these."""
        if lines != self._lines:
            self._lines = lines
            self.refresh()

    def render(self) -> Content:
        return content_of(self._lines)


class StatePanel(Panel):
    """Shown anew twenty times a second; draws only what has changed."""

    def show(self, state: SessionState) -> None:
        """Draw the newest state."""
        raise NotImplementedError
