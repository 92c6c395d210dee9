"""A panel that draws from the session's state."""

from __future__ import annotations

from app.console.session.panel import Panel
from app.console.session.state import SessionState


class StatePanel(Panel):
    """Shown anew twenty times a second; draws only what has changed."""

    def show(self, state: SessionState) -> None:
        """Draw the newest state."""
        raise NotImplementedError
