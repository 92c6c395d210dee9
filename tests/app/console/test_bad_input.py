"""What is pasted, typed or broken by hand must lose nothing and end in a sentence that helps."""

from __future__ import annotations

import pytest
from textual.widgets import Input

from app.console.patients.fields import FIELDS, Kind
from app.paths import Home
from profiles.schema import DEMO_PATIENT
from tests.app.console.conftest import Opener


async def test_a_megabyte_pasted_breaks_nothing(console: Opener) -> None:
    from textual.events import Paste

    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        for text in ("x" * 1_000_000, "line\n" * 200_000, "\x1b[2J😀" * 1000):
            open_console.app.screen.query_one("#identifier").post_message(Paste(text))
            await open_console.pilot.pause()
        await open_console.press("ctrl+s")
        await open_console.tells("Not saved")
        assert open_console.app.store.list(archived=True).profiles == (DEMO_PATIENT,)


@pytest.mark.parametrize("typed", ["abc", "", "-1", "9" * 10_000, "😀", "170 kg", "\x07\x1b]0;x\x07"])
async def test_whatever_is_typed_the_form_says_what_is_wrong(console: Opener, typed: str) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        open_console.type("identifier", "P-1")
        for field in FIELDS:
            if field.kind in (Kind.NUMBER, Kind.WHOLE):
                open_console.type(field.id, typed)
        await open_console.shows("to mend")
        await open_console.press("ctrl+s")
        assert len(open_console.app.store.list().profiles) == 1


async def test_a_broken_profile_is_named_in_the_list(console: Opener, home: Home) -> None:
    home.profiles.mkdir(parents=True)
    (home.profiles / "P-7.toml").write_text("stature_cm = 'tall'")
    async with console(profile=None) as open_console:
        await open_console.shows("mend that field")
        await open_console.shows("demo")


async def test_a_full_disk_loses_nothing_that_was_typed(console: Opener, home: Home) -> None:
    home.root.mkdir(parents=True)
    home.profiles.write_text("a file where the folder should be")
    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        open_console.type("identifier", "P-9")
        await open_console.press("ctrl+s")
        await open_console.tells("mend the folder")
        assert open_console.app.screen.query_one("#identifier", Input).value == "P-9"
