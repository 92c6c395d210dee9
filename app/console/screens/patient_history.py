"""What changed in a profile, when and by whom, newest first."""

from __future__ import annotations

from app.console.screens.dialogs import Lists
from app.console.state import SessionState
from app.console.widgets.panel import Lines, plain
from app.text.catalogue import tr
from profiles.store import Change


def describe(changes: tuple[Change, ...]) -> Lines:
    """A head and a line a field for each change."""
    lines: list[tuple[tuple[str, str], ...]] = []
    for change in reversed(changes):
        who = change.by or tr("history.nobody")
        lines.append(((f"{change.at}  {who}", "bold $primary"), (f"  {change.why}", "$text-muted")))
        lines += [
            ((f"  {field}: ", ""), (f"{_words(old)} → {_words(new)}", "bold"))
            for field, (old, new) in change.changes.items()
        ]
    return tuple(lines) or (plain(tr("history.none"), "$text-muted"),)


def _words(value: object) -> str:
    return "–" if value is None else str(value)


class History(Lists):
    """A patient's history."""

    HELP_PAGE = "history"

    def __init__(self, name: str, changes: tuple[Change, ...]) -> None:
        super().__init__()
        self._patient = name
        self._shown = describe(changes)

    def title_and_words(self) -> tuple[str, str]:
        """The patient."""
        return tr("history.title", name=self._patient), ""

    def lines_of(self, state: SessionState | None) -> Lines:  # noqa: ARG002 - a history has no session
        """Every change."""
        return self._shown
