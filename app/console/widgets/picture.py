"""The live picture as half blocks, or as letters where the terminal has no colours."""

from __future__ import annotations

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from app.console.state import SessionState
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
        self._sequence = -1
        self._message_text = tr("picture.waiting")
        self.paused = False

    def show(self, state: SessionState) -> None:
        """Draw the newest preview, or why there is none."""
        message = self._message_for(state)
        if message != self._message_text:
            self._message_text = message
            self.refresh()
        preview = state.preview
        if preview is None or self.paused or preview.sequence == self._sequence or self.size.area == 0:
            return
        self._sequence = preview.sequence
        self._strips = self._draw(preview)
        self.refresh()

    def show_preview(self, preview: Preview) -> None:
        """Draw this one, without a session."""
        self._message_text = ""
        self._strips = self._draw(preview) if self.size.area else []
        self.refresh()

    def show_text(self, text: str) -> None:
        """Why there is no newer picture, without a session."""
        if text != self._message_text:
            self._message_text = text
            self.refresh()

    def toggle_pause(self) -> bool:
        """Freeze or go on; the chain itself never pauses."""
        self.paused = not self.paused
        self.set_class(self.paused, "-paused")
        self._sequence = -1
        return self.paused

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
        self.ask()

    def ask(self) -> None:
        """Ask for a picture of this size, as when another screen had asked for its own."""
        self.post_message(self.Resized(self, wanted(self.size.width, self.size.height)))

    def _message(self, y: int, width: int, style: Style) -> Strip:
        if y != (self.size.height - 1 if self._strips else self.size.height // 2):
            return Strip.blank(width, style)
        return Strip([Segment(self._message_text[:width].center(width), style)]).adjust_cell_length(width, style)

    def _message_for(self, state: SessionState) -> str:
        if self.paused:
            return tr("picture.paused")
        if state.preview is None:
            return tr("picture.waiting")
        if not state.report_fresh:
            return tr("picture.stale")
        return ""

    def _draw(self, preview: Preview) -> list[Strip]:
        from app.console.widgets import halfblock  # numpy: not before the first paint

        width, height = halfblock.fit(preview.width_px, preview.height_px, self.size.width, self.size.height)
        self._indent = (self.size.width - width) // 2
        small = halfblock.resample(halfblock.pixels_of(preview), width, height)
        if self.app.console.color_system is None or self.app.no_color:
            return halfblock.to_letters(small)
        return halfblock.to_strips(small)
