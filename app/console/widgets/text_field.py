"""A field for text that somebody has written: nothing that is pasted into it is lost without a word."""

from __future__ import annotations

from textual import events
from textual.widgets import Input

from app.text.catalogue import tr


class TextField(Input):
    """Takes all lines of a paste, joined by spaces; says so where they don't fit."""

    def on_paste(self, event: events.Paste) -> None:
        """Textual handles it next: it would take the first line only, and refuse what is too long with a bell."""
        event.text = " ".join(event.text.splitlines())
        length = len(self.value) - len(self.selected_text) + len(event.text)
        if self.max_length is not None and length > self.max_length:
            self.notify(tr("form.paste_too_long", length=length, most=self.max_length), severity="warning")
