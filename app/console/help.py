"""Contextual help: a page a screen from the language file, and the keys that work there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from app.console.language import knows, tr
from app.console.session.panel import Lines, cells, padded, plain

if TYPE_CHECKING:
    from textual.app import App
    from textual.binding import ActiveBinding


def page(name: str, bindings: Mapping[str, ActiveBinding], app: App[None]) -> Lines:
    """What this screen is for, STOP, and a line a key."""
    words = tr(f"help.{name}") if knows(f"help.{name}") else tr("help.general")
    keys = [
        (app.get_key_display(active.binding), active.binding.description)
        for active in bindings.values()
        if active.binding.id is not None and active.enabled
    ]
    width = max((cells(key) for key, _ in keys), default=0)
    rows = [((f" {padded(key, width)}  ", "bold $accent"), (does, "")) for key, does in keys]
    return (plain(words), plain(""), plain(tr("help.stop"), "bold"), plain(""), *rows)
