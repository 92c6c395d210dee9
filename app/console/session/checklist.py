"""The checks before arming, as a list that turns green one by one, each failure with its remedy."""

from __future__ import annotations

from app.console.checks import Light, results
from app.console.dialogs import Lists
from app.console.language import tr
from app.console.session.panel import Lines
from app.console.session.state import SessionState

_STYLES = {
    Light.GREEN: "bold $success",
    Light.WAITING: "$text-muted",
    Light.AMBER: "bold $warning",
    Light.RED: "bold $error",
}


def describe(state: SessionState) -> Lines:
    """Two lines a check that is not green, one that is."""
    lines: list[tuple[tuple[str, str], ...]] = []
    for result in results(state):
        lines.append(((f" {result.light.value} ", _STYLES[result.light]), (tr(f"check.{result.name}.name"), "bold")))
        if result.light is not Light.GREEN:
            lines.append(((f"   {tr(f'check.{result.name}.remedy')}", "$text-muted"),))
    if state.fault:
        lines.append(((state.fault, "bold $error"),))
    return tuple(lines)


class Checklist(Lists):
    """Closed with Escape; stays true while it is open."""

    HELP_PAGE = "checks"

    def __init__(self) -> None:
        super().__init__(tr("checks.title"), tr("checks.words"))

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        if state is not None:
            self.show_list(describe(state))
