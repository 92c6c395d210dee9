"""The replay of a recording in the real console: from the trail's record, by keys, at every size, in every language."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from textual.pilot import Pilot

from app.console.app import ConsoleApp
from app.console.screens.patients import PatientsScreen
from app.console.screens.replay import DRAWN_S, ReplayScreen, replay_of
from app.console.screens.review import ReviewScreen
from app.console.widgets.panel import Panel
from app.console.widgets.replay_view import ReplayView
from app.ipc.states import Action
from app.playback.session import moment_ns
from app.system.config import Config
from app.system.paths import Home
from app.text.catalogue import languages, tr, use_language
from app.text.recorded import render_recorded
from logs import records as r
from logs.explain.hops import explain
from logs.explain.text import lines
from logs.read import records
from logs.records import Record
from testing.fake_host import screen_text
from tests.app.console.conftest import change_language, three_beats, wait_until
from tests.support.recorded_session import lived

SIZES = ((80, 24), (120, 36), (200, 50))


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Home:
    """With one recorded session."""
    folder = tmp_path_factory.mktemp("replay")
    lived(folder).close()
    return Home(folder)


@asynccontextmanager
async def review(home: Home, size: tuple[int, int], language: str = "en") -> AsyncIterator[Pilot[None]]:
    """The review of that session, opened."""
    app = ConsoleApp(home, Config(language=language))
    try:
        async with app.run_test(size=size) as pilot:
            await wait_until(pilot, lambda: isinstance(app.screen, PatientsScreen))
            screen = ReviewScreen(home, "last")
            await app.push_screen(screen)
            await wait_until(pilot, lambda: screen.session is not None)
            yield pilot
    finally:
        use_language("en")


def shown(pilot: Pilot[None]) -> ReplayScreen:
    assert isinstance(pilot.app.screen, ReplayScreen)
    return pilot.app.screen


def told(pilot: Pilot[None]) -> list[str]:
    """What the console notified of."""
    return [one.message for one in pilot.app._notifications]


def command_of(home: Home) -> tuple[int, Record]:
    """The step's command: its index in the trail, and the record."""
    found = records(home.logs / "s.jsonl")
    return next(
        (number, one)
        for number, one in enumerate(found)
        if isinstance(one.body, r.Command) and one.body.action == Action.STEP_RIGHT_FIRST.value
    )


@pytest.mark.parametrize(
    ("size", "language"),
    [*((size, "en") for size in SIZES), *((SIZES[0], other) for other in languages() if other != "en")],
)
async def test_the_record_under_the_cursor_is_replayed_with_its_reasons(
    home: Home, size: tuple[int, int], language: str
) -> None:
    index, record = command_of(home)
    async with review(home, size, language) as pilot:
        await pilot.app.screen.run_action(f"step({index})")
        await pilot.press("r")
        await wait_until(pilot, lambda: isinstance(pilot.app.screen, ReplayScreen))
        screen = shown(pilot)
        await wait_until(pilot, lambda: screen.moment is not None)
        assert screen.at_ns == moment_ns(record)
        assert screen.moment is not None
        assert screen.moment.snapshot is not None
        assert screen.moment.snapshot.action is Action.STEP_RIGHT_FIRST
        text = screen_text(pilot.app)
        for word in (tr("replay.title"), f"#{record.sequence}", tr(Action.STEP_RIGHT_FIRST), tr("figure.left")):
            assert word in text
        assert any(0x2800 < ord(letter) < 0x2900 for letter in text), "nothing is drawn"
        wanted = list(lines(explain(records(home.logs / "s.jsonl"), record.sequence), render_recorded))
        assert screen.query_one(ReplayView).reasons[1:] == tuple(wanted)
        await pilot.press("v")
        await wait_until(pilot, lambda: wanted[0][:12] in screen_text(pilot.app))
        await pilot.press("escape")
        await wait_until(pilot, lambda: isinstance(pilot.app.screen, ReviewScreen))


async def test_keys_step_jump_skip_and_change_the_speed(home: Home) -> None:
    _, record = command_of(home)
    async with review(home, (120, 36)) as pilot:
        await pilot.press("r")
        await wait_until(pilot, lambda: isinstance(pilot.app.screen, ReplayScreen))
        screen = shown(pilot)
        await wait_until(pilot, lambda: screen.moment is not None)
        begin_ns = screen.at_ns
        await pilot.press("right", "right", "left")
        assert screen.at_ns - begin_ns == 40_000_000
        visited = [screen.at_ns]
        while screen.at_ns != moment_ns(record):
            await pilot.press("n")
            assert screen.at_ns > visited[-1]
            visited.append(screen.at_ns)
        await pilot.press("p")
        assert screen.at_ns == visited[-2]
        await pilot.press("r")
        assert screen.at_ns == begin_ns
        await pilot.press("pagedown")
        assert screen.at_ns == begin_ns + 5_000_000_000
        await pilot.press("pageup", "plus", "plus")
        assert screen.at_ns == begin_ns
        assert screen.speed == 4.0
        await pilot.press("minus", "end")
        assert screen.speed == 2.0
        last_ns = screen.at_ns
        await pilot.press("right", "n")
        assert screen.at_ns == last_ns
        await pilot.press("home", "f1")
        await wait_until(pilot, lambda: tr("replay.faster") in screen_text(pilot.app))


async def test_it_plays_by_the_clock_and_stops_at_the_end(home: Home) -> None:
    now_ns = 0
    playback, legs, begin_ns = replay_of(home.logs / "s.mcap", None)
    async with review(home, (80, 24)) as pilot:
        screen = ReplayScreen(playback, legs, begin_ns, now=lambda: now_ns)
        await pilot.app.push_screen(screen)
        await pilot.press("enter")
        now_ns += 2_000_000_000
        await wait_until(pilot, lambda: screen.at_ns == begin_ns + 2_000_000_000)
        assert screen.playing
        await pilot.press("enter")
        now_ns += 1_000_000_000
        await pilot.press("minus", "enter")
        now_ns += 1_000_000_000
        await wait_until(pilot, lambda: screen.at_ns == begin_ns + 2_500_000_000)
        now_ns += 3600_000_000_000
        await wait_until(pilot, lambda: not screen.playing)
        assert screen.at_ns == playback.end_ns
        assert screen.query_one("#replay-status", Panel).text.startswith(f" {tr('replay.title')}  ■")


async def test_another_language_while_it_plays(home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = 0
    playback, legs, begin_ns = replay_of(home.logs / "s.mcap", None)
    async with review(home, (120, 36)) as pilot:
        screen = ReplayScreen(playback, legs, begin_ns, now=lambda: now_ns)
        await pilot.app.push_screen(screen)
        await pilot.press("enter")

        async def meanwhile() -> None:
            screen.call_later(screen.show_moment)  # as a size and another language just before do
            await three_beats(screen, DRAWN_S)

        await change_language(pilot, monkeypatch, meanwhile)
        await wait_until(pilot, lambda: tr("replay.close") in screen_text(pilot.app))
        now_ns += 2_000_000_000
        await wait_until(pilot, lambda: screen.at_ns == begin_ns + 2_000_000_000)
        assert screen.playing


async def test_a_session_without_a_recording_says_how_to_record(home: Home, tmp_path: Path) -> None:
    alone = Home(tmp_path)
    alone.logs.mkdir()
    shutil.copy(home.logs / "s.jsonl", alone.logs)
    async with review(alone, (100, 30)) as pilot:
        await pilot.press("r")
        await wait_until(pilot, lambda: tr("replay.none") in told(pilot))
        assert isinstance(pilot.app.screen, ReviewScreen)


async def test_a_file_that_is_no_recording_is_told(home: Home, tmp_path: Path) -> None:
    foreign = Home(tmp_path)
    foreign.logs.mkdir()
    shutil.copy(home.logs / "s.jsonl", foreign.logs)
    (foreign.logs / "s.mcap").write_bytes(b"something else")
    async with review(foreign, (100, 30)) as pilot:
        await pilot.press("r")
        await wait_until(pilot, lambda: any("is no MCAP file" in text for text in told(pilot)))
        assert isinstance(pilot.app.screen, ReviewScreen)
