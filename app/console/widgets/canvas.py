"""A drawing in terminal cells: braille dots in styles, and text over them. Pure."""

from __future__ import annotations

from app.console.widgets.panel import Line, Lines, cells

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_EMPTY = " "


class Canvas:
    """Two by four dots a cell. A cell has one style: that of the last pen that drew in it; text covers dots."""

    def __init__(self, columns: int, rows: int) -> None:
        self.columns = columns
        self.rows = rows
        self.width = 2 * columns  # dots
        self.height = 4 * rows
        self._dots = [0] * (columns * rows)
        self._styles = [""] * (columns * rows)
        self._text: dict[int, str] = {}  # by cell; "" behind a character of two cells
        self.pen = ""

    def dot(self, x: int, y: int) -> None:
        """Set one dot; outside of the drawing nothing happens."""
        if 0 <= x < self.width and 0 <= y < self.height:
            at = (y >> 2) * self.columns + (x >> 1)
            self._dots[at] |= _DOTS[y & 3][x & 1]
            self._styles[at] = self.pen

    def line(self, x0: float, y0: float, x1: float, y1: float, *, every: int = 1) -> None:
        """A straight line, both ends included; `every`: one dot in so many."""
        steps = max(abs(round(x1) - round(x0)), abs(round(y1) - round(y0)), 1)
        dx, dy = (x1 - x0) / steps, (y1 - y0) / steps
        for step in range(0, steps + 1, every):
            self.dot(round(x0 + dx * step), round(y0 + dy * step))

    def bold_line(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """A straight line three dots thick."""
        steep = abs(y1 - y0) > abs(x1 - x0)
        for shift in (-1, 1, 0):
            sx, sy = (shift, 0) if steep else (0, shift)
            self.line(x0 + sx, y0 + sy, x1 + sx, y1 + sy)

    def text(self, column: int, row: int, text: str, style: str = "") -> None:
        """Text from a cell on; what would stand outside is left away."""
        for letter in text:
            width = cells(letter)
            if 0 <= row < self.rows and column >= 0 and column + width <= self.columns:
                at = row * self.columns + column
                for cell in range(width):
                    self._text[at + cell] = letter if cell == 0 else ""
                    self._styles[at + cell] = style
            column += width

    def lines(self) -> Lines:
        """The drawing, equal neighbours joined."""
        return tuple(self._line(row * self.columns) for row in range(self.rows))

    def _line(self, begin: int) -> Line:
        parts: list[tuple[str, str]] = []
        run, style = "", ""
        for at in range(begin, begin + self.columns):
            letter = self._text.get(at)
            wanted = self._styles[at]
            if letter is None:
                dots = self._dots[at]
                letter = chr(0x2800 + dots) if dots else _EMPTY
                if not dots:  # any style that has no ground of its own will do
                    wanted = "" if "reverse" in style else style
            if wanted != style:
                if run:
                    parts.append((run, style))
                run, style = "", wanted
            run += letter
        return (*parts, (run, style))
