"""What is on a Textual screen, as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from textual.app import App
    from textual.strip import Strip


def strips(app: App[None]) -> list[Strip]:
    """The cells of the screen with their styles, line by line.

    The one look at Textual's compositor: its public way is a picture in SVG, which takes 0.1 s to make.
    """
    return app.screen._compositor.render_strips()


def screen_text(app: App[None]) -> str:
    """The cells of the screen, line by line."""
    return "\n".join(strip.text for strip in strips(app))
