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
from logs.read import patient_and_purpose, session_paths
from logs.reason import sanitize_terminal

_NO_SESSIONS = ("training", "enrolment")


def sessions_of(folder: Path) -> list[tuple[Path, str]]:
    """Every session, its patient, and what it was unless a session; only its name where it can't be read."""
    found = []
    for path in session_paths(folder):
        try:
            patient, purpose = patient_and_purpose(path)
        except AuditError:
            found.append((path, ""))  # opening it tells why
        else:
            what = f"  ({tr(f'reviewing.{purpose}')})" if purpose in _NO_SESSIONS else ""
            found.append((path, f"{patient}{what}"))
    return found


class ChooseSession(Dialog[Path]):
    """Which session to open, the newest on top."""

    def __init__(self, sessions: list[tuple[Path, str]]) -> None:
        super().__init__()
        self._sessions = list(reversed(sessions))  # path, whose and what

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
