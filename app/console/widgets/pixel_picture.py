"""A preview as a terminal's pixels: how large, how often, and what is written for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from app.console import pixels
from app.console.pixels import PixelTerminal, Protocol
from app.ipc.messages import PerceptionCommand, Preview

PREVIEW_PX = 480  # across: more shows nothing that the hand needs, and perception draws it
MOST_HZ = {Protocol.KITTY: 8.0, Protocol.SIXEL: 6.0}
# Encoding sixels takes 0.17 s for a million pixels: a quarter of a core at most, at two pictures a second or more.
SIXEL_PX_A_SECOND = 1_500_000
SIXEL_PX = 700_000


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
            return pixels.kitty_picture(image, self._number, columns, rows), columns, rows
        size = (columns * self.terminal.cell_width_px, rows * self.terminal.cell_height_px)
        return pixels.sixels(halfblock.smooth(image, *size)), columns, rows

    def cells(self, preview: Preview) -> tuple[int, int]:
        """Columns and rows of the largest undistorted picture."""
        across, down = self.terminal.cell_width_px, self.terminal.cell_height_px
        scale = min(self.columns * across / preview.width_px, self.rows * down / preview.height_px)
        return max(1, int(preview.width_px * scale / across)), max(1, int(preview.height_px * scale / down))
