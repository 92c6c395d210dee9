"""Contextual help: a page a screen from the language file, and the keys that work there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from app.console.language import knows, tr

if TYPE_CHECKING:
    from textual.app import App
    from textual.binding import ActiveBinding


def page(name: str, bindings: Mapping[str, ActiveBinding], app: App[None]) -> str:
    """Markdown."""
    words = tr(f"help.{name}") if knows(f"help.{name}") else tr("help.general")
    rows = [
        f"- `{app.get_key_display(active.binding)}` {active.binding.description}"
        for active in bindings.values()
        if active.binding.id is not None and active.enabled
    ]
    return "\n".join([words, "", tr("help.stop"), "", *rows])
