"""Real pixels in a terminal: found by asking it; how large and how often a preview is drawn, and the sequences. Pure.

The question is one write before the first paint; nobody waits for the answer. It comes through the terminal's input,
sooner or later, and is taken out there before it could be read as keys. A terminal that answers nothing, or cells of an
impossible size, keeps half blocks.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from app.console.charset import substitutes_for
from app.ipc.messages import PerceptionCommand, Preview

if TYPE_CHECKING:
    from app.console.widgets.halfblock import Pixels

_GRAPHICS = "\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"  # kitty's protocol: OK, if it knows it
_CELL_SIZE = "\x1b[16t"
_ATTRIBUTES = "\x1b[c"  # every terminal answers this; 4 among the numbers: sixel
QUESTION = _GRAPHICS + _CELL_SIZE + _ATTRIBUTES
_SILENT = re.compile(r"linux|dumb|vt\d|ansi|unknown|$")  # would print the question, or can't draw

_ANSWER = re.compile(
    r"\x1b_G(?P<graphics>[\w=,;:.-]{0,80})\x1b\\"
    r"|\x1b\[6;(?P<height>\d{1,5});(?P<width>\d{1,5})t"
    r"|\x1b\[\?(?P<attributes>[\d;]{0,80})c"
)
# An answer that another read completes, looked for until the last one has come. None holds a space: STOP is never kept.
_BEGUN = re.compile(r"\x1b(_(G[\w=,;:.-]{0,80}\x1b?)?|\[(6(;\d{0,5}){0,2}|\?[\d;]{0,80})?)$")

_CELL_PX = range(4, 101)  # what a cell can measure
_SIXEL = "4"
_SIXEL_BAND_PX = 6
_SIXEL_COLOURS = 64  # a quarter less to send than 256, and skin still has its shades
_CHUNK = 4096  # the most that a sequence of kitty's may carry
_IDS = (0x524C45, 0x524C46)  # in turn: the newer picture is whole before the older one goes
KITTY_REMOVAL = "".join(f"\x1b_Ga=d,d=I,q=2,i={one}\x1b\\" for one in _IDS)


class Protocol(Enum):
    """How a terminal takes pixels."""

    KITTY = "kitty"  # kitty, Ghostty
    SIXEL = "sixel"  # foot, WezTerm, Konsole, iTerm2, xterm -ti vt340


PREVIEW_PX = 480  # across: more shows nothing that the hand needs, and perception draws it
MOST_HZ = {Protocol.KITTY: 8.0, Protocol.SIXEL: 6.0}
# Encoding sixels takes 0.17 s for a million pixels: a quarter of a core at most, at two pictures a second or more.
SIXEL_PX_A_SECOND = 1_500_000
SIXEL_PX = 700_000


@dataclass(frozen=True, slots=True)
class PixelTerminal:
    """A terminal that shows pixels."""

    protocol: Protocol
    cell_width_px: int
    cell_height_px: int


def asks(environment: Mapping[str, str]) -> bool:
    """Whether to ask this terminal at all."""
    return not _SILENT.match(environment.get("TERM", "")) and substitutes_for(environment) is None


@dataclass(slots=True)
class Answers:
    """Takes the terminal's answers out of its input; `found` gets what they say, once."""

    found: Callable[[PixelTerminal], object]
    cell_px: tuple[int, int] = (0, 0)  # as the kernel knows it, across and down; the terminal's own answer goes first
    _rest: str = ""
    _kitty: bool = False
    _done: bool = False

    def take(self, data: str) -> str:
        """The input without answers; the beginning of one waits for the next call."""
        data = self._rest + data
        data = _ANSWER.sub(self._read, data)
        begun = None if self._done else _BEGUN.search(data)
        self._rest = begun[0] if begun else ""
        return data[: len(data) - len(self._rest)]

    def _read(self, answer: re.Match[str]) -> str:
        if answer["graphics"] is not None:
            self._kitty = answer["graphics"].endswith(";OK")
        elif answer["height"] is not None:
            self.cell_px = int(answer["width"]), int(answer["height"])
        elif not self._done:  # the last answer: terminals answer in order
            self._done = True
            self._conclude(answer["attributes"].split(";"))
        return ""

    def _conclude(self, attributes: list[str]) -> None:
        # Sixel first: who knows both, as Konsole and WezTerm, knows kitty's protocol only in part.
        protocol = Protocol.SIXEL if _SIXEL in attributes[1:] else Protocol.KITTY if self._kitty else None
        if protocol is not None and all(side in _CELL_PX for side in self.cell_px):
            self.found(PixelTerminal(protocol, *self.cell_px))


def sixels(pixels: Pixels) -> str:
    """Draws (height, width, 3) RGB at the cursor.

    Rows are cut to whole bands of six: a part of one would reach into the next row of cells.
    """
    from PIL import Image
    from textual_image._sixel import SixelOptions, image_to_sixels  # its public modules ask the terminal themselves

    whole = pixels[: pixels.shape[0] // _SIXEL_BAND_PX * _SIXEL_BAND_PX]
    return image_to_sixels(Image.fromarray(whole), SixelOptions(colors=_SIXEL_COLOURS))


def placed(data: str, x: int, y: int) -> str:
    """With its upper left corner in the cell (x, y); the cursor returns."""
    return f"\x1b7\x1b[{y + 1};{x + 1}H{data}\x1b8"


def kitty_picture(pixels: Pixels, number: int, columns: int, rows: int) -> str:
    """Draws (height, width, 3) RGB at the cursor over so many cells, then takes picture `number` - 1 away.

    It lies above the cells' text, until `KITTY_REMOVAL`. Below their background, where what opens would hide it, kitty
    0.26 with software rendering drew every colour of the screen wrong, STOP's red as green.
    """
    import base64

    import cv2

    _, png = cv2.imencode(".png", pixels[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    data = base64.b64encode(png.tobytes()).decode("ascii")
    chunks = [data[at : at + _CHUNK] for at in range(0, len(data), _CHUNK)]
    this, former = (_IDS[(number - back) % len(_IDS)] for back in (0, 1))
    keys = [f"a=T,f=100,q=2,i={this},p=1,c={columns},r={rows},C=1", *["q=2"] * (len(chunks) - 1)]
    more = [1] * (len(chunks) - 1) + [0]
    sent = "".join(f"\x1b_G{key},m={flag};{chunk}\x1b\\" for key, flag, chunk in zip(keys, more, chunks, strict=True))
    return f"{sent}\x1b_Ga=d,d=I,q=2,i={former}\x1b\\"


@dataclass(slots=True)
class PixelPicture:
    """What so much room of a terminal shows."""

    terminal: PixelTerminal
    columns: int
    rows: int
    _number: int = field(default=0)

    @classmethod
    def fit(cls, terminal: PixelTerminal, columns: int, rows: int) -> PixelPicture | None:
        """None: no room, or more than can be sent often enough."""
        area_px = columns * terminal.cell_width_px * rows * terminal.cell_height_px
        if area_px == 0 or (terminal.protocol is Protocol.SIXEL and area_px > SIXEL_PX):
            return None
        return cls(terminal, columns, rows)

    @property
    def stays(self) -> bool:
        """Whether it stays when the cells below are written; a sixel picture goes."""
        return self.terminal.protocol is Protocol.KITTY

    @property
    def wanted(self) -> PerceptionCommand:
        """The preview that it needs, as often as it can be sent."""
        cell = self.terminal
        rate_hz = MOST_HZ[cell.protocol]
        if cell.protocol is Protocol.SIXEL:
            area_px = self.columns * cell.cell_width_px * self.rows * cell.cell_height_px
            rate_hz = min(rate_hz, SIXEL_PX_A_SECOND / area_px)
        width_px = min(PREVIEW_PX, self.columns * cell.cell_width_px)
        return PerceptionCommand(preview_width_px=max(32, width_px), preview_hz=rate_hz)

    def draw(self, preview: Preview) -> tuple[str, int, int]:
        """The sequence that draws it at the cursor, and its columns and rows. Tens of milliseconds: in a thread."""
        from app.console.widgets import halfblock

        columns, rows = self.cells(preview)
        image = halfblock.pixels_of(preview)
        self._number += 1
        if self.terminal.protocol is Protocol.KITTY:
            return kitty_picture(image, self._number, columns, rows), columns, rows
        size = (columns * self.terminal.cell_width_px, rows * self.terminal.cell_height_px)
        return sixels(halfblock.smooth(image, *size)), columns, rows

    def cells(self, preview: Preview) -> tuple[int, int]:
        """Columns and rows of the largest undistorted picture."""
        across, down = self.terminal.cell_width_px, self.terminal.cell_height_px
        scale = min(self.columns * across / preview.width_px, self.rows * down / preview.height_px)
        return max(1, int(preview.width_px * scale / across)), max(1, int(preview.height_px * scale / down))
