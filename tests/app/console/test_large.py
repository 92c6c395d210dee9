"""Large letters: what they are drawn as, that they fit at any size, and the key that shows them."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.console.widgets.large import LargePanel, large_lines, whole_cm
from app.console.widgets.letters import ROWS, large
from app.console.widgets.panel import cells
from app.ipc.messages import OperatorKind
from app.ipc.states import Effect
from app.text.catalogue import tr, use_language
from kgdfa.gesture import Gesture
from tests.app.console.conftest import Opener
from tests.app.console.test_sizes import KEYS, STATES, text_of

FIVE = ("█▀▀▀", "▀▀▀▄", "▀▀▀")


def test_a_letter_is_drawn_as_large_as_there_is_room() -> None:
    assert large("5", 4, 3) == FIVE
    assert large("5", 40, 3) == FIVE
    assert len(large("5", 40, 10)) == 4 * ROWS // 2
    assert large("5", 3, 3) == ()
    assert large("5", 4, 2) == ()


def test_words_are_broken_between_and_never_within() -> None:
    assert len(large("legs held", 80, 3)) == 3
    assert len(large("legs held", 20, 7)) == 7
    assert large("standing", 20, 20) == ()


def test_what_the_font_lacks_is_left_to_usual_letters() -> None:
    assert large("站立", 80, 20) == ()


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("name", sorted(STATES))
@settings(max_examples=60, deadline=None)
@given(width=st.integers(18, 300), height=st.integers(3, 100))
def test_it_fits_at_any_size(language: str, name: str, width: int, height: int) -> None:
    use_language(language)
    lines = large_lines(STATES[name], KEYS, width, height, watching=False)
    assert len(lines) <= height
    assert all(cells(text_of((line,))) <= width for line in lines), text_of(lines)


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (130, 40), (200, 50)])
def test_each_sign_that_acts_is_a_tenth_of_the_screen_high(language: str, columns: int, rows: int) -> None:
    """3 cm on a screen of 30 cm: 34 minutes of arc at three metres; 5 are the least that good eyes tell apart."""
    use_language(language)
    state, height = STATES["ready"], rows - (8 if rows >= 38 else 4)
    text = text_of(large_lines(state, KEYS, columns - 2, height, watching=False))
    assert state.snapshot is not None
    *_, signs = re.split(r"\n *\n", text.rstrip())  # what stands lowest
    tall = [row for row in signs.splitlines() if set(row) & set("█▀▄")]
    assert len(tall) >= rows / 10
    for action in state.snapshot.allowed:
        assert tr(action)[:2] in signs


@pytest.mark.parametrize("language", ["en", "zh"])
def test_a_stop_is_large_in_every_language(language: str) -> None:
    use_language(language)
    lines = large_lines(STATES["stopped"], KEYS, 78, 20, watching=False)
    assert sum("█" in text_of((line,)) for line in lines) >= 5
    assert KEYS["acknowledge"] in text_of(lines)


@given(distance_m=st.floats(0.05, 0.7), threshold_m=st.floats(0.1, 0.4))
def test_no_distance_is_rounded_over_the_threshold(distance_m: float, threshold_m: float) -> None:
    shown_m = whole_cm(distance_m, threshold_m) / 100
    assert (shown_m <= distance_m) if distance_m < threshold_m else (shown_m >= distance_m - 1e-9)


async def test_a_key_shows_the_session_in_large_letters_and_back(console: Opener) -> None:
    async with console() as opened:
        await opened.press("c", "y", "a", "t", "0", "5", "b")
        await opened.until(lambda: opened.app.screen.query_one(LargePanel).text)
        await opened.shows("\n".join(large("5", 19, 5))[:8])
        await opened.shows("■ STOP ■")
        assert not opened.app.screen.query_one("#picture").display
        await opened.press("space")
        await opened.until(lambda: (state := opened.app.live_state()) and state.effect is Effect.HOLD)
        await opened.shows(large("legs held", 78, 16)[0])
        assert not opened.app.screen.query_one("#hold").display
        await opened.press("k", "y")
        await opened.until(lambda: OperatorKind.ACKNOWLEDGE in opened.host.kinds())
        await opened.press("b")
        await opened.until(lambda: opened.app.screen.query_one("#picture").display)
        assert opened.host.gesture is Gesture.FIVE


async def test_who_only_watches_may_read_in_large_letters(console: Opener) -> None:
    async with console(read_only=True) as opened:
        await opened.press("b")
        await opened.until(lambda: opened.app.screen.query_one(LargePanel).display)
