"""Keys: remapped by the configuration, refused when they collide."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from app.console import keys
from app.console.screens import base
from app.console.screens.base import SHAPE_SHOWN_S
from app.ipc.messages import OperatorKind
from app.system.config import Config
from app.system.errors import AppError
from kgdfa.gesture import Gesture
from tests.app.console.conftest import Opener


def test_the_built_in_keys_do_not_collide() -> None:
    keys.check_keymap({})


def test_an_unknown_name_is_refused_with_those_that_exist() -> None:
    with pytest.raises(AppError, match=r"UNKNOWN_KEY_NAME name=fly .*acknowledge"):
        keys.check_keymap({"fly": "f"})


def test_one_key_for_two_things_is_refused() -> None:
    with pytest.raises(AppError, match="KEY_TAKEN key=a "):
        keys.check_keymap({"confirm": "a"})


async def test_a_remapped_stop_key_stops(console: Opener) -> None:
    async with console(config=Config(keys={"stop": "f12"})) as open_console:
        await open_console.press("f12")
        await open_console.until(lambda: OperatorKind.STOP in open_console.host.kinds())
        await open_console.shows("F12")


@pytest.mark.parametrize(
    ("language", "stop", "large"),
    [("en", "STOP is F12, on every screen", "f9 shows state"), ("zh", "F12：腿减速并保持", "f9 用三米外")],
)
async def test_help_names_the_remapped_keys(console: Opener, language: str, stop: str, large: str) -> None:
    remapped = {"stop": "f12", "large": "f9"}
    async with console(size=(120, 40), config=Config(keys=remapped, language=language)) as open_console:
        await open_console.press("f1")
        await open_console.shows(stop)
        await open_console.shows(large)


async def test_a_remapped_key_does_what_its_name_states(console: Opener) -> None:
    async with console(config=Config(keys={"arm": "f9"})) as open_console:
        await open_console.press("a")
        assert OperatorKind.ARM not in open_console.host.kinds()
        await open_console.press("f9")
        await open_console.until(lambda: OperatorKind.ARM in open_console.host.kinds())


async def test_each_gesture_has_its_key_on_the_digital_hand(console: Opener) -> None:
    async with console() as open_console:
        for gesture in Gesture:
            await open_console.press(gesture.value[0])
            assert open_console.host.hands[-1].gesture is gesture
        assert len(open_console.host.hands) == len(Gesture)


async def test_a_push_waits_until_its_gesture_has_been_shown(console: Opener) -> None:
    """A gesture and Enter at once: a hand that pushed while it still changes would be refused."""
    async with console() as open_console:
        await open_console.press("5", "enter")
        assert [hand.gesture for hand in open_console.host.hands] == [Gesture.FIVE]
        await open_console.until(lambda: open_console.host.hands[-1].click_s)
        await open_console.press("enter")
        assert [hand.click_s is not None for hand in open_console.host.hands] == [False, True, True]


async def test_a_push_waits_until_perception_has_started(console: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pushed before there is a picture, the hand is first seen in mid-push: a press that begins there is refused."""
    async with console() as open_console:
        open_console.host.looking = False
        live, now_s = open_console.app.live_session(), [0.0]
        await open_console.until(lambda: live.state.report and not live.state.report.detector_ready)
        monkeypatch.setattr(base, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
        await open_console.press("5")
        now_s[0] = 10.0
        pressed_ns = live.state.now_ns
        await open_console.until(lambda: live.state.now_ns > pressed_ns + 300_000_000)  # some beats of the screen
        await open_console.press("enter")
        open_console.host.looking = True
        await open_console.until(lambda: live.state.report and live.state.report.detector_ready)
        assert [hand.gesture for hand in open_console.host.hands] == [Gesture.FIVE]
        now_s[0] += SHAPE_SHOWN_S
        await open_console.until(lambda: open_console.host.hands[-1].click_s)


async def test_a_push_that_waits_for_one_gesture_is_not_made_with_the_next(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("5", "enter", "2")
        await open_console.press("enter")
        await open_console.until(lambda: open_console.host.hands[-1].click_s)
        assert [hand.gesture for hand in open_console.host.hands] == [Gesture.FIVE, Gesture.TWO, None]


@pytest.mark.parametrize(("key", "draws_back"), [("enter", True), ("minus", True), ("plus", True), ("up", False)])
async def test_push_and_stay_begins_anew_once_something_else_has_drawn_the_hand_back(
    console: Opener, key: str, draws_back: bool
) -> None:
    async with console() as open_console:
        hands = open_console.host.hands
        await open_console.press("p", key)
        await open_console.until(lambda: len(hands) == 2)
        await open_console.press("p", "p")
        await open_console.until(lambda: len(hands) == 4)
        assert [hand.press for hand in hands] == [True, None, draws_back, not draws_back]
