"""The review screen's questions: which session, and what to say about a record."""

from __future__ import annotations

from pathlib import Path

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Input, OptionList
from textual.widgets.option_list import Option

from app.console.base import Dialog
from app.console.language import tr
from logs.plain import sanitize_terminal


class ChooseSession(Dialog[Path]):
    """Which session to open, the newest on top."""

    def __init__(self, paths: list[Path]) -> None:
        super().__init__()
        self._paths = list(reversed(paths))

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("reviewing.choose")
            yield OptionList(*(Option(Text(sanitize_terminal(path.stem))) for path in self._paths))
        yield from self.compose_bottom()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Open it."""
        self.dismiss(self._paths[event.option_index])


class WriteComment(Dialog[str]):
    """A reviewer's comment on one record."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("reviewing.comment", number=self._number)
            yield Input(max_length=4000)
        yield from self.compose_bottom()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Keep it."""
        self.dismiss(event.value.strip())
