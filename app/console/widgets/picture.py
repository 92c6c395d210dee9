"""The live picture: pixels where the terminal shows them, else half blocks, or letters where it has no colours."""

from __future__ import annotations

import asyncio

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from app.console.pixels import KITTY_REMOVAL, PixelPicture, PixelTerminal, placed
from app.console.state import SessionState
from app.console.terminal import TerminalDriver
from app.ipc.messages import PerceptionCommand, Preview
from app.text.catalogue import tr

PICTURE_HZ = 12.0  # half blocks at this rate cost a tenth of a core; sixels would cost a quarter
# A third of a core: in the largest terminals twelve pictures a second leave no room for keys and the heartbeat.
CELLS_A_SECOND = 40_000
ASPECT = 16 / 9  # of a picture that has not come yet


def wanted(columns: int, rows: int) -> PerceptionCommand:
    """The picture that so much room can show, as often as it can be drawn there."""
    across = min(columns, rows * 4)  # two pixels a row: no picture is wider than twice its height
    cells = max(1, across * min(rows, across / ASPECT / 2))
    rate_hz = min(PICTURE_HZ, CELLS_A_SECOND / cells)
    return PerceptionCommand(preview_width_px=max(32, across), preview_hz=rate_hz)


class Picture(Widget):
    """Draws previews, never more than arrive; asks for the size it can show."""

    can_focus = False

    class Resized(Message):
        """There is other room for the picture."""

        def __init__(self, picture: Picture, wanted: PerceptionCommand) -> None:
            super().__init__()
            self.picture = picture
            self.wanted = wanted

        @property
        def control(self) -> Picture:
            """Which picture; Textual's name for it."""
            return self.picture

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id=id)
        self._strips: list[Strip] = []
        self._indent = 0
        self._background = Style()
        self._preview: Preview | None = None  # the newest, or the one that was when it was paused
        self._sequence = -1
        self._message_text = tr("picture.waiting")
        self.paused = False
        self._pause_key = ""
        self._pixels: PixelPicture | None = None
        self._drawn = False  # pixels stay until they are taken away
        self._sending = False  # pixels of one preview are on their way; those between are left out

    def show(self, state: SessionState) -> None:
        """Draw the newest preview, or why there is none."""
        if self._drawn and self._covered():
            self.clear_pixels()
        self.show_text(self._message_for(state))
        if not self.paused:
            self._preview = state.preview
        if self._preview is None or self._preview.sequence == self._sequence or self.size.area == 0:
            return
        self._sequence = self._preview.sequence
        self._show(self._preview)

    def show_preview(self, preview: Preview) -> None:
        """Draw this one, without a session."""
        self._message_text = ""
        self._show(preview)

    def show_text(self, text: str) -> None:
        """Why there is no newer picture; empty: there is one."""
        if text != self._message_text:
            self._message_text = text
            self.refresh()

    def toggle_pause(self, key: str) -> None:
        """Freeze or go on; the chain itself never pauses. key: the one that did it, as it is shown."""
        self.paused, self._pause_key = not self.paused, key
        self.set_class(self.paused, "-paused")

    def render_lines(self, crop: Region) -> list[Strip]:
        """The picture as it is: Textual's own way looks at the style of each of its cells once more."""
        self._background = self.rich_style  # costly: once a picture, not once a line
        return [self.render_line(y).crop(crop.x, crop.right) for y in range(crop.y, crop.bottom)]

    def render_line(self, y: int) -> Strip:
        width, background = self.size.width, self._background
        if self._message_text and (not self._strips or y == self.size.height - 1):
            return self._message(y, width, background)
        top = (self.size.height - len(self._strips)) // 2
        if not 0 <= y - top < len(self._strips):
            return Strip.blank(width, background)
        blank = Strip.blank(self._indent, background)
        return Strip.join([blank, self._strips[y - top]]).adjust_cell_length(width, background)

    def on_resize(self) -> None:
        self._sequence = -1
        self._strips = []
        self.clear_pixels()
        terminal = self._terminal()
        self._pixels = None if terminal is None else PixelPicture.fit(terminal, self.size.width, self.size.height)
        self.refresh()
        self.ask()

    def on_hide(self) -> None:
        self.clear_pixels()

    def on_unmount(self) -> None:
        self.clear_pixels()

    def ask(self) -> None:
        """Ask for a picture of this size, as when another screen had asked for its own."""
        size = self.size
        self.post_message(self.Resized(self, self._pixels.wanted if self._pixels else wanted(size.width, size.height)))

    def _message(self, y: int, width: int, style: Style) -> Strip:
        if y != (self.size.height - 1 if self._strips else self.size.height // 2):
            return Strip.blank(width, style)
        return Strip([Segment(self._message_text[:width].center(width), style)]).adjust_cell_length(width, style)

    def _message_for(self, state: SessionState) -> str:
        if self.paused:
            return tr("picture.paused", pause=self._pause_key)
        if state.preview is None:
            return tr("picture.waiting")
        if state.report is None or not state.report_fresh or state.report.camera_fault:
            return tr("picture.stale")
        return ""

    def _terminal(self) -> PixelTerminal | None:
        coloured = self.app.console.color_system is not None and not self.app.no_color
        return getattr(self.app, "pixels", None) if coloured else None  # the console's own, whatever runs this widget

    def _show(self, preview: Preview) -> None:
        """Draw it; pixels only on the open screen, where nothing stands before them."""
        if self.size.area == 0:
            return
        if self._pixels is None or not self.screen.is_active:
            self._strips = self._draw(preview)
            self.refresh()
        elif not self._sending:
            self._sending = True
            self.run_worker(self._send(self._pixels, preview))

    async def _send(self, pixels: PixelPicture, preview: Preview) -> None:
        try:
            data, columns, rows = await asyncio.to_thread(pixels.draw, preview)
        finally:
            self._sending = False
        if pixels is not self._pixels or not self.screen.is_active or self._covered():
            return
        strips = [Strip.blank(columns)] * rows  # without a background: the terminal's pixels show through
        self._indent = (self.size.width - columns) // 2
        if strips != self._strips:
            self._strips = strips
            self.refresh()
        left, top = self.content_region.offset
        self._write(placed(data, left + self._indent, top + (self.size.height - rows) // 2))
        self._drawn = pixels.stays

    def clear_pixels(self) -> None:
        """Take them away: something stands before the picture now."""
        if self._drawn:
            self._drawn = False
            self._write(KITTY_REMOVAL, droppable=False)

    def _write(self, data: str, *, droppable: bool = True) -> None:
        driver = self.app._driver  # Textual has no other door for sequences of one's own
        if isinstance(driver, TerminalDriver):
            driver.write(data, droppable=droppable)

    def _covered(self) -> bool:
        """Whether a message stands before it: pixels would be drawn over that."""
        return any(toast.region.overlaps(self.region) for toast in self.screen.query("Toast"))

    def _draw(self, preview: Preview) -> list[Strip]:
        from app.console.widgets import halfblock  # numpy: not before the first paint

        width, height = halfblock.fit(preview.width_px, preview.height_px, self.size.width, self.size.height)
        self._indent = (self.size.width - width) // 2
        small = halfblock.resample(halfblock.pixels_of(preview), width, height)
        if self.app.console.color_system is None or self.app.no_color:
            return halfblock.to_letters(small)
        return halfblock.to_strips(small)
