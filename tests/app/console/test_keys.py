"""Keys: remapped by the configuration, refused when they collide."""

from __future__ import annotations

import pkgutil
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest
from textual.binding import Binding
from textual.screen import Screen

from app.console import keys, screens
from app.console.screens import hand_keys
from app.console.screens.base import ConsoleScreen, Dialog
from app.console.screens.dialogs import HealthPage
from app.console.screens.hand_keys import SHAPE_SHOWN_S, HandKeys
from app.console.screens.help import HelpPage
from app.console.screens.session import SessionScreen
from app.ipc.messages import OperatorKind
from app.ipc.states import Effect
from app.system.config import Config
from app.system.errors import AppError, ConsoleFault
from app.text.catalogue import tr
from kgdfa.gesture import Gesture
from profiles.schema import DEMO_PATIENT, Profile
from tests.app.console.conftest import Opener


def test_the_built_in_keys_do_not_collide() -> None:
    keys.check_keymap({})


def test_the_first_letter_of_each_gesture_is_free_for_its_key() -> None:
    places = (*keys.EVERYWHERE, *keys.SESSION, *keys.DIGITAL_HAND)
    taken = Counter(key for binding in places for key in binding.key.split(","))
    shared = [gesture.value for gesture in Gesture if taken[gesture.value[0]] > 1]
    assert not shared, "a gesture's key is its value's first letter: rename it, kgdfa/gesture.py, or move the other key"


def test_an_unknown_name_is_refused_with_those_that_exist() -> None:
    with pytest.raises(AppError, match=r"UNKNOWN_KEY_NAME name=fly .*acknowledge"):
        keys.check_keymap({"fly": "f"})


@pytest.mark.parametrize("key", ["spcae", "", "space,", "F5", "ctrl+", "control+k", "space;f12"])
def test_a_key_that_there_is_not_is_refused(key: str) -> None:
    """Else STOP would have none."""
    with pytest.raises(AppError) as raised:
        keys.check_keymap({"stop": key})
    assert raised.value.code is ConsoleFault.NO_SUCH_KEY


@pytest.mark.parametrize(
    ("written", "pressed"),
    [
        ("space, f12", ("space", "f12")),
        (".", ("full_stop",)),
        ("alt+x", ("alt+x",)),
        ("é", ("é",)),
        ("shift+tab", ("shift+tab",)),
    ],
)
def test_a_key_is_known_by_the_name_that_its_press_has(written: str, pressed: tuple[str, ...]) -> None:
    keys.check_keymap({"stop": written})
    assert keys.keys_of("stop", {"stop": written}) == pressed


def test_a_sign_and_its_name_are_one_key() -> None:
    with pytest.raises(AppError, match="KEY_TAKEN key=slash "):
        keys.check_keymap({"patients.new": "/"})


def test_one_key_for_two_things_is_refused() -> None:
    with pytest.raises(AppError, match="KEY_TAKEN key=a "):
        keys.check_keymap({"confirm": "a"})


@pytest.mark.parametrize(
    ("name", "key", "refused"),
    [
        *(("stop", f"space,{key}", key) for key in ("y", "u", "escape", "tab", "5")),
        ("lock", "ctrl+s", "ctrl+s"),
        ("lock", "f6", "f6"),
        ("help", "f5", "f5"),
        ("help", "ctrl+p", "ctrl+p"),
        ("arm", "ctrl+p", "ctrl+p"),
        ("hand.rest", "tab", "tab"),
        ("acknowledge", "escape", "escape"),
    ],
)
def test_a_key_that_a_screen_needs_itself_is_refused(name: str, key: str, refused: str) -> None:
    free = {"hand.five": "f9"} if refused == "5" else {}
    with pytest.raises(AppError) as raised:
        keys.check_keymap({name: key, **free})
    assert raised.value.code is ConsoleFault.KEY_RESERVED
    assert raised.value.values == {"key": refused, "name": name}


def test_a_key_of_a_screen_that_is_never_open_with_it_is_free() -> None:
    keys.check_keymap({"arm": "f5", "patients.order": "tab", "hand.two": "2"})


def test_the_keys_that_screens_bind_themselves_are_those_that_nobody_else_may_have() -> None:
    for module in pkgutil.iter_modules(screens.__path__):
        import_module(f"{screens.__name__}.{module.name}")
    of_screens = {key for kind in (ConsoleScreen, Dialog) for screen in _kinds(kind) for key in _bound_by(screen)}
    assert of_screens == keys.OF_SCREENS, (
        "OF_SCREENS in app/console/keys.py; a gesture's key is the actions' dialog's, too"
    )
    beside_hand = {key for screen in _kinds(HandKeys) for key in _bound_by(screen)}
    assert beside_hand == keys.BESIDE_HAND, "BESIDE_HAND in app/console/keys.py"


def _kinds(kind: type[Screen[Any]]) -> Iterator[type[Screen[Any]]]:
    yield kind
    for below in kind.__subclasses__():
        yield from _kinds(below)


def _bound_by(screen: type[Screen[Any]]) -> set[str]:
    """What it takes that the configuration does not remap."""
    bound = Binding.make_bindings(screen.__dict__.get("BINDINGS", ()))
    remapped = {binding.id for binding in keys.ALL}
    return {binding.key for binding in bound if binding.id not in remapped} | set(getattr(screen, "BY_KEY", ()))


@pytest.mark.parametrize(("name", "key", "page"), [("help", "f12", HelpPage), ("health", "j", HealthPage)])
async def test_a_page_closes_by_the_remapped_key_that_opens_it(
    console: Opener, name: str, key: str, page: type[Dialog[None]]
) -> None:
    async with console(config=Config(keys={name: key})) as open_console:
        for _ in range(2):
            await open_console.press(key)
            await open_console.until(lambda: isinstance(open_console.app.screen, page))
            await open_console.press(key)
            await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))


@pytest.mark.parametrize(
    ("profile", "opening"),
    [(None, "t"), (None, "g"), (DEMO_PATIENT, "v")],
    ids=["training", "enrolment", "comparison"],
)
async def test_the_keys_that_the_stop_bar_names_work_wherever_it_stands_below_a_picture(
    console: Opener, profile: Profile | None, opening: str
) -> None:
    async with console(profile=profile) as open_console:
        app = open_console.app
        await open_console.press(opening)
        await open_console.until(lambda: isinstance(app.screen, HandKeys) and not isinstance(app.screen, SessionScreen))
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot)
        open_console.host.walked = {"enabled": True}
        open_console.host.effect = Effect.HOLD
        open_console.host.send(OperatorKind.STOP)
        await open_console.shows("LEGS DAMPED ■ k: acknowledge · o: joints off")
        for key, title in (("o", "torque_off.title"), ("k", "acknowledge.title")):
            await open_console.press(key)
            await open_console.shows(tr(title))
            await open_console.press("y")
        await open_console.until(lambda: OperatorKind.ACKNOWLEDGE in open_console.host.kinds())
        assert OperatorKind.TORQUE_OFF in open_console.host.kinds()


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
        monkeypatch.setattr(hand_keys, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
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
