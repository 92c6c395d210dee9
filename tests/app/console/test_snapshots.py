"""Every screen in three sizes, the smallest in three themes: words and colours as what was looked at and found good.

After a wanted change: `pytest tests/app/console/test_snapshots.py --snapshot-update`, then look at the pictures.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import get_args

import msgspec
import pytest
from rich.style import Style
from syrupy.assertion import SnapshotAssertion
from syrupy.extensions.single_file import SingleFileSnapshotExtension, WriteMode
from textual.containers import VerticalScroll
from textual.pilot import Pilot
from textual.strip import Strip

from app.console.app import ConsoleApp
from app.console.screens.after import AfterScreen
from app.console.screens.session import SessionScreen
from app.console.themes import THEME_NAMES
from app.system.config import Config, SessionSetup, ThemeName
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost, strips
from testing.messages import flat
from tests.app.console.conftest import wait_until

SIZES = ((80, 24), (130, 40), (200, 50))
THEMES = THEME_NAMES[:3]  # beginning with the one that a console starts in
NOW_NS = 1_000_000_000_000
# Screen → whether a session runs, and the keys that lead to it.
SCREENS: dict[str, tuple[bool, tuple[str, ...]]] = {
    "patients": (False, ()),
    "form": (False, ("n",)),
    "start": (False, ("enter",)),
    "training": (False, ("t", "0")),
    "vocabulary": (False, ("g", "0")),
    "session": (True, ("c", "y", "a", "t", "0", "5")),
    "stopped": (True, ("t", "0", "space")),
    "guided": (True, ("g",)),
    "guided-line": (True, ("t", "0", "g", "1")),
    "confirm": (True, ("c",)),
    "actions": (True, ("t",)),
    "checks": (True, ("s",)),
    "compare": (True, ("v",)),
    "help": (True, ("f1",)),
    "locked": (True, ("ctrl+l",)),
    "after": (True, ("e",)),
}
OPEN_AT_THE_TOP = {"after", "start"}  # although the focus is further down


def test_every_theme_can_be_configured_and_no_other() -> None:
    assert get_args(ThemeName) == THEME_NAMES


class TextExtension(SingleFileSnapshotExtension):
    """One readable file a screen and size; differences show as lines of a patch."""

    file_extension = "txt"
    _write_mode = WriteMode.TEXT


def make_app(home: Path, *, session: bool) -> ConsoleApp:
    """A console whose time stands still."""

    def make_host(setup: SessionSetup) -> FakeHost:
        fixed = msgspec.structs.replace(setup, session="S-1", began_ns=NOW_NS)
        return FakeHost(fixed, clock=lambda: NOW_NS, picture=flat())

    profile = DEMO_PATIENT if session else None
    config = Config(idle_lock_s=0)
    return ConsoleApp(Home(home), config, profile=profile, make_host=make_host, clock=lambda: NOW_NS)


@pytest.mark.parametrize("name", SCREENS)
async def test_screen(snapshot: SnapshotAssertion, tmp_path: Path, name: str) -> None:
    session, keys = SCREENS[name]
    app = make_app(tmp_path, session=session)
    async with app.run_test(size=SIZES[0]) as pilot:
        try:
            if session:
                await wait_until(pilot, lambda: (state := app.live_state()) and state.snapshot)
                await wait_until(pilot, lambda: isinstance(app.screen, SessionScreen) and app.screen.wearer)
            await pilot.press(*keys)
            if name == "after":
                await wait_until(pilot, lambda: isinstance(app.screen, AfterScreen) and rating_has_focus(app))
            await settled(app, pilot)  # what has the focus is scrolled into sight by then
            app.screen.set_focus(None)
            if name not in OPEN_AT_THE_TOP:
                for part in app.screen.query(VerticalScroll):
                    part.scroll_home(animate=False, immediate=True)
            found = await in_all_sizes_and_themes(app, pilot)
            for size, text in found.items():
                file = f"{name}-{size[0]}x{size[1]}"
                assert text == snapshot(name=file, extension_class=TextExtension), file
        finally:
            app.close_live()


def rating_has_focus(app: ConsoleApp) -> bool:
    """Whether the screen has done all that it does when it opens; before, it would take the focus back."""
    return app.screen.focused is not None and app.screen.focused.id == "discomfort"


async def in_all_sizes_and_themes(app: ConsoleApp, pilot: Pilot[None]) -> dict[tuple[int, int], str]:
    """For each size the words, then the colours; of the other themes the smallest size, for no colour hangs on it."""
    found = {size: await look(app, pilot, size) for size in SIZES}
    for theme in THEMES[1:]:
        app.theme = theme
        await pilot.pause()  # the theme's message is through, however busy the machine
        found[SIZES[0]] += await look(app, pilot, SIZES[0], words=False)
    return found


async def look(app: ConsoleApp, pilot: Pilot[None], size: tuple[int, int], *, words: bool = True) -> str:
    """One size in the theme of now: its lines, and the style of each run of cells."""
    await pilot.resize_terminal(*size)
    strips = await settled(app, pilot)
    lines = [strip.text.rstrip() for strip in strips] if words else []
    return "\n".join([*lines, f"== {app.theme}", *map(colours, strips)]) + "\n"


async def settled(app: ConsoleApp, pilot: Pilot[None]) -> list[Strip]:
    """The screen once two ticks and the drawing after them have changed nothing: a busy machine draws late."""
    looks: list[list[Strip]] = []
    while len(looks) < 4 or any(look != looks[-1] for look in looks[-4:]):
        await pilot.pause(0.05)
        looks.append(strips(app))
        assert len(looks) < 400, "the screen never comes to rest"
    return looks[-1]


def colours(strip: Strip) -> str:
    """The style of each run of cells: length, then style; equal neighbours joined."""
    runs: list[tuple[int, str]] = []
    for segment in strip:
        style = named(segment.style) if segment.style else "none"
        if runs and runs[-1][1] == style:
            runs[-1] = (runs[-1][0] + segment.cell_length, style)
        else:
            runs.append((segment.cell_length, style))
    return "; ".join(f"{length} {style}" for length, style in runs)


@cache
def named(style: Style) -> str:
    """A style in words: attributes, then both colours."""
    return str(style.without_color + Style.from_color(style.color, style.bgcolor))
