"""The live screen where there is little room, and where there is much."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.console.guidance import _STEPS
from app.console.terminal import believed
from app.console.widgets.panel import Panel, wrapped
from app.console.widgets.picture import CELLS_A_SECOND, PICTURE_HZ, wanted
from app.ipc.states import Effect, Event
from app.text.catalogue import tr
from kgdfa.continuity import Jump
from kgdfa.gesture import HandRefusal
from logs.reason import reason
from testing.messages import event
from tests.app.console.conftest import Opener

NARROW = (60, 20)


async def test_the_button_stays_in_its_panel(console: Opener) -> None:
    async with console(size=NARROW) as open_console:
        await open_console.press("5")
        await open_console.shows("RELEASED")
        await open_console.shows("press under 20 cm")
        open_console.host.pressed = True
        await open_console.shows("PRESSED")


async def test_without_a_panel_for_them_events_stand_beside_the_gait(console: Opener) -> None:
    async with console(size=NARROW) as open_console:
        open_console.host.events = (event(Event.OVER_TEMPERATURE_WARNING, Effect.NOTE, temperature_c=61.0),)
        await open_console.shows("A joint is at 61 °C")
        await open_console.shows("power on and stand")


async def test_the_next_step_is_readable_to_its_end(console: Opener) -> None:
    async with console(size=NARROW) as open_console:
        await open_console.press("space")
        await open_console.shows("returns slowly.")


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("columns", [60, 72, 79, 80])
async def test_every_next_step_is_readable_to_its_end(console: Opener, columns: int, language: str) -> None:
    async with console(size=(columns, 24)) as open_console:
        await open_console.app.speak(language)
        await open_console.until(lambda: open_console.app.screen.query("#guide"))
        panel = open_console.app.screen.query_one("#guide", Panel)
        await open_console.until(lambda: panel.size.width == columns)
        keys = open_console.app.key_names
        steps = [
            f"{mark} {tr(f'{kind}.{name}', **keys)}"
            for kind, mark in (("guide", "▶"), ("watch", "·"))
            for _, name, _ in _STEPS
        ]
        assert [text for text in steps if len(wrapped(text, columns)) > panel.size.height] == []


@pytest.mark.parametrize("size", [(80, 24), (100, 30), (130, 40), (200, 50)])
async def test_why_a_hand_shows_no_gesture_is_readable_to_its_end(console: Opener, size: tuple[int, int]) -> None:
    why = reason(HandRefusal.JUMPED, jump=Jump.UNSEEN)
    async with console(size=size) as open_console:
        shown = open_console.app.live_state()
        assert shown is not None
        assert shown.report is not None
        open_console.host.message = msgspec.structs.replace(shown.report, hand=True, explanation=why)
        await open_console.shows("judging the hand anew")
        await open_console.shows("for a moment")


async def test_every_action_can_be_seen_to_choose_from(console: Opener) -> None:
    async with console(size=(60, 24)) as open_console:
        await open_console.press("t")
        await open_console.shows("stand up")


async def test_a_session_that_ends_is_not_reported_unresponsive(console: Opener) -> None:
    async with console() as open_console:
        open_console.host.events = (event(Event.SHUTDOWN_DAMPING, Effect.DAMP),)
        await open_console.shows("Session ending: the legs")
        open_console.host.silent = True
        await open_console.shows("CONTROL TIMEOUT")
        await open_console.shows("Session ending: the legs")


@given(st.integers(0, 500), st.integers(0, 200))
def test_the_image_is_never_asked_for_oftener_than_it_can_be_drawn(columns: int, rows: int) -> None:
    command = wanted(columns, rows)
    assert command.preview_width_px is not None
    assert command.preview_hz is not None
    drawn = min(columns, rows * 32 // 9, command.preview_width_px)
    assert drawn * min(rows, drawn * 9 / 32) * command.preview_hz <= CELLS_A_SECOND * 1.01
    assert 0 < command.preview_hz <= PICTURE_HZ


@pytest.mark.parametrize(("columns", "rows"), [(40, 10), (136, 26)])
def test_usual_terminals_get_the_full_rate(columns: int, rows: int) -> None:
    assert wanted(columns, rows).preview_hz == PICTURE_HZ


@pytest.mark.parametrize(
    ("said", "drawn"),
    [((80, 24), (80, 24)), ((300, 100), (300, 100)), ((2000, 1000), (600, 200)), ((65535, 3), (600, 3))],
)
def test_a_terminal_that_lies_about_its_size_is_not_believed(said: tuple[int, int], drawn: tuple[int, int]) -> None:
    assert believed(*said) == drawn
