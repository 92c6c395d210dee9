"""A patient's history: what changed in the profile, when and by whom."""

from __future__ import annotations

from app.console.screens.dialogs import Lists
from app.console.state import SessionState
from app.console.widgets.panel import Lines, plain
from app.console.widgets.patient_details import field_name
from app.text.catalogue import knows, tr
from profiles.store import Change


class History(Lists):
    """What changed in a profile, when and by whom, newest first."""

    HELP_PAGE = "history"

    def __init__(self, name: str, changes: tuple[Change, ...]) -> None:
        super().__init__()
        self._patient = name
        self._lines = history_lines(changes)

    def title_and_text(self) -> tuple[str, str]:
        """The patient."""
        return tr("history.title", name=self._patient), ""

    def lines_of(self, state: SessionState | None) -> Lines:  # noqa: ARG002 - a history has no session
        """Every change."""
        return self._lines


def history_lines(changes: tuple[Change, ...]) -> Lines:
    """A head and a line a field for each change."""
    lines: list[tuple[tuple[str, str], ...]] = []
    for change in reversed(changes):
        who = change.by or tr("history.nobody")
        lines.append(
            (
                (f"{change.at[:16].replace('T', ' ')}  {who}", "bold $primary"),
                (f"  {tr(change.why) if knows(change.why) else change.why}", "$text-muted"),
            )
        )
        lines += [
            ((f"  {field_name(field)}: ", ""), (f"{_shown(old)} → {_shown(new)}", "bold"))
            for field, (old, new) in change.changes.items()
        ]
    return tuple(lines) or (plain(tr("history.none"), "$text-muted"),)


def _shown(value: object) -> str:
    return "–" if value is None else str(value)
