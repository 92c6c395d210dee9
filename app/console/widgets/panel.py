"""Lines of styled text, and the widget that shows them; measures of text in terminal cells."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from itertools import pairwise

from rich.cells import cell_len, set_cell_size
from rich.segment import Segment
from rich.style import Style as RichStyle
from textual.content import Content
from textual.geometry import Region
from textual.reactive import reactive
from textual.strip import Strip
from textual.style import Style
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


def fitted(parts: Iterable[Part], width: int) -> Line:
    """The parts that fit, first ones first: a part is left out whole, so that no figure is ever cut."""
    kept: list[Part] = []
    for text, style in parts:
        if cells(text) <= width:
            kept.append((text, style))
            width -= cells(text)
    return tuple(kept)


_NUMBER_AT_END, _NUMBER_GOES_ON = re.compile(r"[-+−]?\d[\d.:]*$"), re.compile(r"[.:]?\d")


@lru_cache(maxsize=256)  # the same text is asked for with every update of the screen
def wrapped(text: str, width: int) -> tuple[str, ...]:
    """The text in lines of `width` cells, broken between words, and between the letters of a script without spaces.

    Never within a number that fits into a line: half of it would read as another one.
    """
    lines = [line.plain for line in Content(text).wrap(width)] if width > 0 and text else []
    for place, (line, after) in enumerate(pairwise(lines)):
        number = _NUMBER_AT_END.search(line)
        if number and number.start() and _NUMBER_GOES_ON.match(after):
            kept = (*lines[:place], line[: number.start()].rstrip())
            return (*kept, *wrapped(_after(text, kept), width))
    return tuple(lines)


def _after(text: str, kept: Iterable[str]) -> str:
    """What follows the letters of these lines; white space counts in neither, since breaking drops some of it."""
    letters = sum(not letter.isspace() for line in kept for letter in line)
    solid = [place for place, letter in enumerate(text) if not letter.isspace()]
    return text[solid[letters] :]


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


class DrawnPanel(StatePanel):
    """Lines that fit as they are, drawn without Textual's wrapping, and only those that have changed.

    The session's drawings change many times a second: as Content each of them cost several times what drawing it does.
    """

    DRAWN_HZ = 20.0
    lines = reactive[Lines]((), repaint=False)
    _next_ns = 0
    _at_once: object = None
    _styles_of: object = None
    _rich: dict[str, RichStyle]  # of `_styles_of`

    def due(self, now_ns: int, at_once: object) -> bool:
        """Whether to draw: DRAWN_HZ times a second, and whenever what must be seen at once has changed."""
        at_once = (at_once, self.content_size)
        if at_once == self._at_once and now_ns < self._next_ns:
            return False
        self._at_once = at_once
        self._next_ns = max(self._next_ns + round(1e9 / self.DRAWN_HZ), now_ns)
        return True

    def watch_lines(self, before: Lines, now: Lines) -> None:
        """Paint the rows that differ."""
        rows = range(max(len(before), len(now)))
        changed = [row for row in rows if before[row : row + 1] != now[row : row + 1]]
        if changed:
            self.refresh(*(Region(0, row, self.content_size.width, 1) for row in changed))

    def render_line(self, y: int) -> Strip:
        """A row of the content."""
        width, known = self.content_size.width, (self.app.theme, self.visual_style)
        if known != self._styles_of:
            self._styles_of, self._rich = known, {"": self.visual_style.rich_style}
        parts = self.lines[y] if y < len(self.lines) else ()
        return Strip([Segment(text, self._style(style)) for text, style in parts]).adjust_cell_length(
            width, self._rich[""]
        )

    def _style(self, name: str) -> RichStyle:
        found = self._rich.get(name)
        if found is None:
            found = self._rich[name] = (self.visual_style + Style.parse(name)).rich_style
        return found
