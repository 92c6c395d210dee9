"""Lines of styled text, and the widget that shows them; measures of text in terminal cells."""

from __future__ import annotations

from rich.cells import cell_len, set_cell_size
from textual.content import Content
from textual.reactive import reactive
from textual.widget import Widget

from app.console.state import SessionState

Part = tuple[str, str]  # text and its style, such as "bold $success"
Line = tuple[Part, ...]
Lines = tuple[Line, ...]


def plain(text: str, style: str = "") -> Line:
    """A line in one style."""
    return ((text, style),)


def content_of(lines: Lines) -> Content:
    """The lines as a widget draws them."""
    return Content("\n").join(Content.assemble(*line) for line in lines)


def cells(text: str) -> int:
    """How many cells the text takes; a Chinese character takes two."""
    return cell_len(text)


def padded(text: str, width: int) -> str:
    """The text, filled or cut to `width` cells."""
    return set_cell_size(text, width)


def bar(share: float, width: int) -> str:
    """A bar of `width` cells, `share` of it full, in eighths of a cell."""
    eighths = round(max(0.0, min(1.0, share)) * width * 8)
    full, rest = divmod(eighths, 8)
    return ("█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")).ljust(width, "·")


class Panel(Widget):
    """Shows `lines`; the title stands in the border."""

    can_focus = False
    lines = reactive[Lines](())

    def __init__(self, id: str | None = None, title: str = "") -> None:  # noqa: A002 - Textual's own name
        super().__init__(id=id)
        self.border_title = title

    @property
    def text(self) -> str:
        """The text shown, without its styles."""
        return "\n".join("".join(text for text, _ in line) for line in self.lines)

    def render(self) -> Content:
        return content_of(self.lines)


class StatePanel(Panel):
    """A panel that the session's screen updates twenty times a second; drawn only when its lines have changed."""

    def show(self, state: SessionState) -> None:
        """Take the newest state."""
        raise NotImplementedError
