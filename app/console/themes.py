"""Four themes: a usual room, a bright one, poor sight, a projector.

No meaning hangs on colour alone: every red or green also has its own word and shape. The colours of states stay apart
for every kind of colour vision as well; tests/app/console/test_colours.py simulates them.
"""

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
        success="#6bf6b1",
        foreground="#e6e9ef",
        background="#11151c",
        surface="#1a202b",
        panel="#242c3a",
        variables=_STOP,
    ),
    Theme(
        name="light",
        primary="#004381",
        secondary="#3d5a80",
        accent="#965a01",
        warning="#965a01",
        error="#900018",
        success="#0f7542",
        foreground="#1a1a1a",
        background="#f4f5f7",
        surface="#ffffff",
        panel="#e3e7ed",
        dark=False,
        variables=_STOP,
    ),
    Theme(
        name="high-contrast",
        primary="#acfff8",
        secondary="#ffffff",
        accent="#00ffff",
        warning="#ffff00",
        error="#ff6f6f",
        success="#00ff68",
        foreground="#ffffff",
        background="#000000",
        surface="#000000",
        panel="#202020",
        luminosity_spread=0.25,
        text_alpha=1.0,
        variables={"stop-background": "#d80000", "stop-foreground": "#ffffff"},
    ),
    Theme(
        name="projector",  # its black is only as dark as the room's wall
        primary="#0b3a94",
        secondary="#000000",
        accent="#0b3a94",
        warning="#895900",
        error="#860017",
        success="#007142",
        foreground="#000000",
        background="#ffffff",
        surface="#ffffff",
        panel="#f0f0f0",
        dark=False,
        text_alpha=1.0,
        variables={**_STOP, "foreground-muted": "#303030"},
    ),
)
THEME_NAMES = tuple(theme.name for theme in THEMES)
