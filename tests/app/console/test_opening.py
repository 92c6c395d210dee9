"""What a screen shows when it opens, and keys that were given before it did."""

from __future__ import annotations

import errno
import threading

import pytest
from textual.widgets import Input

from app.console import session_flow
from app.console.app import ConsoleApp
from app.console.screens.after import AfterScreen
from app.console.screens.patients import PatientsScreen
from app.console.screens.review import ReviewScreen
from app.console.screens.review_dialogs import ChooseSession
from app.console.screens.start import StartSession
from app.console.screens.vocabulary import VocabularyScreen
from app.console.widgets.bars import KeyBar
from app.system.config import Config
from app.system.errors import AppError, ConsoleFault
from app.system.paths import Home
from app.text.catalogue import render, tr, use_language
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost, screen_text
from testing.trails import write_sample
from tests.app.console.conftest import Opener, wait_until
from tests.app.console.test_late_input import handled, press
from tests.app.console.test_snapshots import settled
from tests.app.system.test_vocabulary_status import PROOF

SMALL = [(80, 24), (60, 20)]


@pytest.mark.parametrize("code", ["en", "zh"])
@pytest.mark.parametrize("size", SMALL, ids=str)
async def test_the_page_after_a_session_opens_with_what_was_done(
    console: Opener, size: tuple[int, int], code: str
) -> None:
    use_language(code)
    async with console(size=size) as opened:
        await opened.press("e")
        await opened.until(lambda: isinstance(opened.app.screen, AfterScreen) and opened.app.screen.focused)
        await settled(opened.app, opened.pilot)
        assert opened.app.screen.query_one("#after").scroll_offset.y == 0
        assert opened.app.screen.focused is not None
        assert opened.app.screen.focused.id == "discomfort"


@pytest.mark.parametrize("code", ["en", "zh"])
@pytest.mark.parametrize("size", SMALL, ids=str)
async def test_a_session_s_start_shows_first_who_it_is_for(
    console: Opener, home: Home, size: tuple[int, int], code: str
) -> None:
    use_language(code)
    async with console(size=size, profile=None) as opened:
        await opened.press("enter")
        await opened.until(lambda: isinstance(opened.app.screen, StartSession) and opened.app.screen.focused)
        await settled(opened.app, opened.pilot)
        assert f"{DEMO_PATIENT.stature_m * 100:.0f} cm" in screen_text(opened.app)
        await opened.press("enter")
        await opened.until(lambda: opened.hosts and opened.app.live_state())


async def test_a_first_session_that_can_not_be_set_up_leads_to_the_list(
    home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A console that only simulates begins without it."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(session_flow, "make_setup", refuse)
    app = ConsoleApp(home, Config(), profile=DEMO_PATIENT, make_host=FakeHost)
    async with app.run_test(size=(80, 24), notifications=True) as pilot:
        await wait_until(pilot, lambda: isinstance(app.screen, PatientsScreen))
        assert any("No space left" in note.message for note in app._notifications)
        await wait_until(pilot, lambda: DEMO_PATIENT.identifier in screen_text(app))


async def test_letters_behind_the_key_of_the_search_are_searched_for_and_no_commands(console: Opener) -> None:
    async with console(profile=None) as opened:
        await opened.shows(DEMO_PATIENT.identifier)
        press(opened.app, "slash", "n", "e", "t")
        await opened.until(lambda: opened.app.screen.query_one("#search", Input).value == "net")
        await opened.press("slash")
        await opened.until(lambda: opened.app.screen.query_one("#search", Input).value == "net/")
        assert isinstance(opened.app.screen, PatientsScreen)


class _Slow(FakeHost):
    """Is left when it is told to."""

    may_leave = threading.Event()

    def leave(self) -> None:
        self.may_leave.wait()
        super().leave()


async def test_an_enrolment_can_not_be_kept_once_the_console_ends(console: Opener) -> None:
    """By a signal: the processes are left while its screen is still there."""
    _Slow.may_leave.clear()
    async with console(profile=None, host=_Slow) as opened:
        app = opened.app
        try:
            await opened.press("g")
            await opened.until(lambda: isinstance(app.screen, VocabularyScreen) and app.live_state())
            assert isinstance(app.screen, VocabularyScreen)
            app.screen._result = PROOF
            app._ask_to_end()
            await opened.until(lambda: app.live is None)
            press(app, "ctrl+s")
            await handled(opened)
            assert app._exception is None
            await opened.tells(render(AppError(ConsoleFault.NO_SESSION)))
        finally:
            _Slow.may_leave.set()


async def test_the_review_names_trainings_and_enrolments(console: Opener, home: Home) -> None:
    write_sample(home.root, minutes=0.05, seed=1, purpose="session")
    write_sample(home.root, minutes=0.05, seed=2, purpose="enrolment")
    write_sample(home.root, minutes=0.05, seed=3, purpose="training", patient="demo")
    async with console(profile=None) as opened:
        await opened.press("r")
        await opened.shows("-0003  demo  (training)")
        await opened.shows("-0002  P-017  (enrolment)")
        assert "-0001  P-017  (" not in opened.text()


@pytest.mark.parametrize("code", ["en", "zh"])
@pytest.mark.parametrize("keys", [("r",), ("n",), ("enter",), ()], ids=["review", "form", "start", "list"])
async def test_the_key_bar_cuts_no_key_and_always_names_help(
    console: Opener, home: Home, code: str, keys: tuple[str, ...]
) -> None:
    use_language(code)
    write_sample(home.root, minutes=0.05)
    async with console(profile=None) as opened:
        await opened.press(*keys)
        if keys == ("r",):
            await opened.until(lambda: isinstance(opened.app.screen, ChooseSession))
            await opened.press("enter")
            await opened.until(lambda: isinstance(opened.app.screen, ReviewScreen))
        bar = opened.app.screen.query_one(KeyBar)
        for size in ((200, 24), (80, 24), (60, 20), (30, 20)):
            await opened.pilot.resize_terminal(*size)
            await settled(opened.app, opened.pilot)
            *others, last = opened.text().splitlines()[-1].strip().split("  ")
            assert last.split() == ["f1", *tr("bind.help").split()]
            assert {one.strip() for one in others} <= {f"{shown} {does}" for _, shown, does in bar.keys}
