"""What is on a Textual screen, as text."""

from __future__ import annotations

import re
from html import unescape
from typing import TYPE_CHECKING

from rich.cells import cell_len

if TYPE_CHECKING:
    from textual.app import App

_CELL_PX = 12.2  # the width of a cell in Rich's SVG
_RUN = re.compile(
    r'<text class="[^"]*" x="([\d.]+)" y="[^"]*" textLength="[^"]*" clip-path="[^"]*-line-(\d+)\)">([^<]*)'
)


def screen_text(app: App[None]) -> str:
    """The cells of the screen, line by line, from the picture that Textual exports of it."""
    lines = [""] * app.size.height
    for x_px, line, text in _RUN.findall(app.export_screenshot()):
        gap = round(float(x_px) / _CELL_PX) - cell_len(lines[int(line)])
        lines[int(line)] += " " * gap + unescape(text).replace("\xa0", " ").rstrip("\n")
    return "\n".join(line + " " * (app.size.width - cell_len(line)) for line in lines)
