"""STOP stays in sight on every screen and dialog, at any size from 20 × 5 to 300 × 100, and nothing lies beside it."""

from __future__ import annotations

from random import Random

import pytest

from app.console.widgets.bars import StopBar
from app.system.config import Config
from app.text.catalogue import use_language
from tests.app.console.conftest import Opener

SMALLEST, LARGEST = (20, 5), (300, 100)
# Screen → the keys that lead to it.
SCREENS: dict[str, tuple[str, ...]] = {
    "session": (),
    "large": ("b",),
    "stopped": ("space",),
    "confirm": ("c",),
    "actions": ("t",),
    "checks": ("s",),
    "health": ("i",),
    "help": ("f1",),
    "locked": ("ctrl+l",),
    "end": ("t", "0", "e"),
    "palette": ("ctrl+p",),
}
BREAKPOINTS = [(72, 16), (71, 15), (130, 38), (129, 37), (80, 24), (40, 12)]


def many_sizes(name: str, language: str) -> list[tuple[int, int]]:
    """The extremes, both sides of each breakpoint, and drawn ones, others for each screen.

    Which layout a size gets does not depend on the language: the second one has the extremes only.
    """
    if language != "en":
        return [SMALLEST, LARGEST]
    draw = Random(name).randint
    drawn = [(draw(SMALLEST[0], LARGEST[0]), draw(SMALLEST[1], LARGEST[1])) for _ in range(2)]
    return [SMALLEST, LARGEST, *BREAKPOINTS, *drawn]


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("name", SCREENS)
async def test_stop_is_in_sight(console: Opener, name: str, language: str) -> None:
    use_language(language)
    async with console(config=Config(language=language)) as opened:
        await opened.press(*SCREENS[name])
        app = opened.app
        for columns, rows in many_sizes(name, language):
            await opened.pilot.resize_terminal(columns, rows)

            def in_sight(rows: int = rows) -> bool:
                lines = opened.text().splitlines()
                return len(lines) == rows and any("■" in line for line in lines[-4:])

            await opened.until(in_sight)
            bar = [screen.query_one(StopBar) for screen in app.screen_stack if screen.query(StopBar)][-1]
            assert (bar.region.width, bar.region.bottom) == (columns, rows - 1)


# Outside a session: what of the patients' list the keys lead to.
OUTSIDE: dict[str, tuple[str, ...]] = {
    "patients": (),
    "start": ("enter",),
    "form": ("n",),
    "edit": ("e",),
    "history": ("h",),
    "training": ("t",),
    "search": ("slash", "p"),
}


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("name", OUTSIDE)
async def test_stop_is_in_sight_outside_a_session_and_nothing_leaves_the_screen(
    console: Opener, name: str, language: str
) -> None:
    use_language(language)
    async with console(config=Config(language=language), profile=None) as opened:
        list_screen = opened.app.screen
        await opened.press(*OUTSIDE[name])
        if name not in {"patients", "search"}:
            await opened.until(lambda: opened.app.screen is not list_screen)
        for columns, rows in many_sizes(name, language):
            await opened.pilot.resize_terminal(columns, rows)
            screen = opened.app.screen

            def in_sight(rows: int = rows) -> bool:
                lines = opened.text().splitlines()
                return len(lines) == rows and any("STOP" in line or "停止" in line for line in lines[-4:])

            await opened.until(in_sight)
            bar = [one.query_one(StopBar) for one in opened.app.screen_stack if one.query(StopBar)][-1]
            assert (bar.region.width, bar.region.bottom) == (columns, rows - 1)
            for widget in screen.children:
                if widget.display and widget.region.area and widget is not bar:
                    assert screen.region.contains_region(widget.region), (columns, rows, widget)
                    assert not widget.region.overlaps(bar.region) or widget.layer != "default", (columns, rows, widget)
