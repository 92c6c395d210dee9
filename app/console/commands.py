"""Everything that can be done, for the command palette."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING

from textual.app import SystemCommand
from textual.screen import Screen

from app.console.language import languages, tr
from app.console.session.words import action_name, gesture_of
from app.console.themes import THEME_NAMES
from app.ipc.messages import OperatorKind
from app.ipc.states import Action

if TYPE_CHECKING:
    from app.console.app import ConsoleApp


def commands(app: ConsoleApp, screen: Screen[object]) -> Iterable[SystemCommand]:
    """The keys of the screen, the twelve actions, themes and languages."""
    for active in screen.active_bindings.values():
        binding = active.binding
        if active.enabled and binding.id is not None:
            where = app if active.node is app else screen
            words = tr("palette.key", key=app.get_key_display(binding))
            yield SystemCommand(binding.description, words, partial(app.run_action, binding.action, where))
    if app.live is not None and not app.read_only:
        for action in Action:
            words = tr("palette.act", gesture=gesture_of(action))
            act = partial(app.live.host.send, OperatorKind.ACT, action)
            yield SystemCommand(action_name(action), words, act)
    for theme in THEME_NAMES:
        yield SystemCommand(tr(f"theme.{theme}"), tr("palette.theme"), partial(setattr, app, "theme", theme))
    for code, name in languages().items():
        yield SystemCommand(name, tr("palette.language"), partial(app.call_later, app.speak, code))
