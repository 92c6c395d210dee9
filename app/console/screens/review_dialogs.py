"""What the review screen asks: which session to open, and the words of a comment."""

from __future__ import annotations

from pathlib import Path

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Input, OptionList
from textual.widgets.option_list import Option

from app.console.screens.base import Dialog
from app.console.widgets.text_field import TextField
from app.text.catalogue import tr
from logs.errors import AuditError
from logs.read import patient_of, session_paths
from logs.reason import sanitize_terminal


def sessions_of(folder: Path) -> list[tuple[Path, str]]:
    """Every session and its patient; without one where it can't be read, which opening it tells."""
    found = []
    for path in session_paths(folder):
        try:
            found.append((path, patient_of(path)))
        except AuditError:
            found.append((path, ""))
    return found


class ChooseSession(Dialog[Path]):
    """Which session to open, the newest on top."""

    def __init__(self, sessions: list[tuple[Path, str]]) -> None:
        super().__init__()
        self._sessions = list(reversed(sessions))  # path, patient

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("reviewing.choose")
            texts = (f"{path.stem}  {patient}".strip() for path, patient in self._sessions)
            yield OptionList(*(Option(Text(sanitize_terminal(text))) for text in texts))
        yield from self.compose_bottom()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Open it."""
        self.dismiss(self._sessions[event.option_index][0])


class WriteComment(Dialog[str]):
    """A reviewer's comment on one record."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("reviewing.comment", number=self._number)
            yield TextField(id="comment", max_length=4000)
        yield from self.compose_bottom()

    def keep(self) -> bool:
        return not any(field.value for field in self.query(Input))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Keep it."""
        self.dismiss(event.value.strip())
