"""Three themes. No meaning hangs on colour alone: every red or green also has its own word and shape."""

from __future__ import annotations

from textual.theme import Theme

_STOP = {"stop-background": "#c4122f", "stop-foreground": "#ffffff"}

THEMES = (
    Theme(
        name="dark",
        primary="#5aa9e6",
        secondary="#3d5a80",
        accent="#f2b134",
        warning="#f2b134",
        error="#ff5d73",
        success="#52d68a",
        foreground="#e6e9ef",
        background="#11151c",
        surface="#1a202b",
        panel="#242c3a",
        variables=_STOP,
    ),
    Theme(
        name="light",
        primary="#0b5394",
        secondary="#3d5a80",
        accent="#8a5a00",
        warning="#8a5a00",
        error="#b00020",
        success="#0a6b2d",
        foreground="#1a1a1a",
        background="#f4f5f7",
        surface="#ffffff",
        panel="#e3e7ed",
        dark=False,
        variables=_STOP,
    ),
    Theme(
        name="high-contrast",
        primary="#ffff00",
        secondary="#ffffff",
        accent="#00ffff",
        warning="#ffff00",
        error="#ff6666",
        success="#00ff66",
        foreground="#ffffff",
        background="#000000",
        surface="#000000",
        panel="#202020",
        luminosity_spread=0.25,
        text_alpha=1.0,
        variables={"stop-background": "#ff0000", "stop-foreground": "#ffffff"},
    ),
)
THEME_NAMES = tuple(theme.name for theme in THEMES)
