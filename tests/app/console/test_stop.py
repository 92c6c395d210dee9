"""STOP: at once, from everywhere, and a key held down is one press."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.command import CommandPalette

from app.console.screens.dialogs import Question
from app.console.screens.patients import PatientsScreen
from app.console.screens.signin import SignInDialog
from app.console.stop import DOUBLE_CLICK_NS, REPEAT_BEGINS_NS, REPEAT_GAP_NS, Press, StopKeyState, click, press
from app.console.widgets.bars import StopBar
from app.ipc.messages import OperatorKind
from app.ipc.states import Effect, Event, GaitState
from app.link.clock import ClockEstimate, localized
from app.session.latest import Latest
from app.system.config import Config, JointsConfig
from app.system.operators import Role, add_operator, load_store, save_store
from app.system.paths import Home
from app.text.catalogue import render, tr
from testing.fake_host import FakeHost
from testing.messages import event
from tests.app.console.conftest import Opener

MS = 1_000_000


def decisions(*arrivals_ms: int) -> list[Press]:
    """What becomes of presses at these times."""
    state, found = StopKeyState(), []
    for at in arrivals_ms:
        state, decision = press(state, at * MS)
        found.append(decision)
    return found


def test_the_first_press_is_sent_at_once() -> None:
    assert decisions(0) == [Press.SEND]


def test_a_press_after_a_pause_is_sent_at_once() -> None:
    assert decisions(0, 1500, 3000) == [Press.SEND] * 3


def test_a_second_deliberate_press_waits_for_a_pause() -> None:
    assert decisions(0, 300) == [Press.SEND, Press.WAIT]


def test_two_hasty_presses_are_two() -> None:
    """No terminal repeats a key so soon: frightened hands do, and the second press must not be lost."""
    assert decisions(0, 40) == [Press.SEND, Press.WAIT]


@given(st.integers(150, 900), st.integers(15, 100), st.integers(1, 200))
def test_a_key_held_down_never_sends_twice(delay_ms: int, gap_ms: int, repeats: int) -> None:
    """What WAITs is cancelled by the next arrival, and every later one is dropped."""
    found = decisions(0, *(delay_ms + gap_ms * index for index in range(repeats + 1)))
    assert found == [Press.SEND, Press.WAIT, *[Press.DROP] * repeats]


@given(st.lists(st.integers(0, 3_000_000_000), min_size=1))
def test_whatever_comes_the_first_is_always_sent(gaps_ns: list[int]) -> None:
    state, now_ns = StopKeyState(), 0
    for index, gap_ns in enumerate(gaps_ns):
        now_ns += gap_ns
        state, decision = press(state, now_ns)
        if index == 0 or gap_ns >= REPEAT_BEGINS_NS:
            assert decision is Press.SEND
        elif index > 1 and gap_ns < REPEAT_GAP_NS and gaps_ns[index - 1] < REPEAT_BEGINS_NS:
            assert decision is Press.DROP
        else:
            assert decision is Press.WAIT


WAYS_IN = {
    "live screen": (),
    "confirm": ("c",),
    "therapist's actions": ("t",),
    "checks": ("s",),
    "compare": ("v",),
    "help": ("f1",),
    "palette": ("ctrl+p",),
    "locked": ("ctrl+l",),
    "end": ("t", "0", "e"),
    "paused": ("z",),
}


@pytest.mark.parametrize("keys", WAYS_IN.values(), ids=WAYS_IN.keys())
async def test_stop_works_while_anything_is_open(console: Opener, keys: tuple[str, ...]) -> None:
    async with console() as open_console:
        await open_console.press(*keys)
        await open_console.press("space")
        await open_console.until(lambda: OperatorKind.STOP in open_console.host.kinds())


async def test_stop_works_while_text_is_typed_into_the_palette(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("ctrl+p", "w", "a")
        await open_console.press("space")
        assert open_console.host.kinds()[-1] is OperatorKind.STOP


async def test_below_the_palette_the_session_goes_on_showing_what_stop_did(console: Opener) -> None:
    async with console(size=(120, 36)) as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("c", "y", "a", "t", "0")
        await open_console.shows(" ARMED  standing")
        host.walked = {"enabled": True}
        await open_console.press("ctrl+p", "w", "space")
        await open_console.shows("HELD")
        await open_console.shows("ARMED, BLOCKED")
        await open_console.until(lambda: time.monotonic_ns() - app.switch.sent_ns > REPEAT_BEGINS_NS)
        await open_console.press("space")
        await open_console.until(lambda: host.kinds().count(OperatorKind.STOP) == 2)
        await open_console.shows("LEGS DAMPED")
        assert isinstance(app.screen, CommandPalette)


async def test_a_second_press_damps_and_leaving_takes_two_deliberate_keys(console: Opener) -> None:
    async with console() as open_console:
        host = open_console.host
        host.state, host.walked = GaitState.STANDING, {"enabled": True}
        await open_console.shows(" standing ")
        await open_console.press("space")
        await open_console.shows("HELD")
        switch = open_console.app.switch
        await open_console.until(lambda: time.monotonic_ns() - switch.sent_ns > REPEAT_BEGINS_NS)
        await open_console.press("space")
        await open_console.until(lambda: host.kinds().count(OperatorKind.STOP) == 2)
        await open_console.shows("LEGS DAMPED")
        await open_console.press("k")
        assert OperatorKind.ACKNOWLEDGE not in host.kinds()
        await open_console.shows("Acknowledge?")
        await open_console.press("y")
        await open_console.until(lambda: OperatorKind.ACKNOWLEDGE in host.kinds())


async def test_armed_gestures_wait_until_a_stop_is_acknowledged(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("c", "y", "a", "t", "0")
        await open_console.shows(" ARMED  standing")
        await open_console.press("space")
        await open_console.shows("ARMED, BLOCKED")
        await open_console.press("k", "y")
        await open_console.shows(" ARMED  between states")


async def test_a_key_held_down_stops_once(console: Opener) -> None:
    async with console() as open_console:
        for _ in range(20):  # as the terminal's thread does; a busy machine must not spread the repetitions
            open_console.app.switch.press_key()
        await open_console.shows("HELD")
        assert open_console.host.kinds().count(OperatorKind.STOP) == 1


async def test_a_click_on_the_bar_stops(console: Opener) -> None:
    async with console() as open_console:
        await open_console.pilot.click("StopBar")
        await open_console.until(lambda: OperatorKind.STOP in open_console.host.kinds())


async def test_a_double_click_on_the_bar_stops_once(console: Opener) -> None:
    async with console() as open_console:
        bar = open_console.app.screen.query_one(StopBar)
        for _ in range(2):  # the pilot would let a busy machine spread them
            bar.on_mouse_down()
        await open_console.shows("HELD")
        assert open_console.host.kinds() == [OperatorKind.STOP]


def test_a_click_counts_once_it_can_belong_to_no_other() -> None:
    first, sent = click(StopKeyState(), MS)
    second, dropped = click(first, DOUBLE_CLICK_NS)
    assert (sent, dropped) == (Press.SEND, Press.DROP)
    assert click(second, DOUBLE_CLICK_NS + MS)[1] is Press.SEND


def test_a_click_right_after_the_key_is_the_same_stop_and_a_later_one_another() -> None:
    state, _ = press(StopKeyState(), 0)
    assert click(state, DOUBLE_CLICK_NS - 1)[1] is Press.DROP
    assert click(state, DOUBLE_CLICK_NS)[1] is Press.SEND


async def test_what_came_while_it_was_asked_is_shown_before_it_is_acknowledged(console: Opener) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("space")
        await open_console.shows("HELD")
        await open_console.press("k")
        await open_console.until(lambda: isinstance(app.screen, Question) and app.screen.composed)
        later = event(Event.JOINT_SANK, Effect.DAMP, time.monotonic_ns())
        host.events = (*host.events, later)
        await open_console.until(lambda: (state := app.live_state()) and len(state.events) == 2)
        asked = app.screen
        await open_console.press("y")
        await open_console.until(lambda: isinstance(app.screen, Question) and app.screen is not asked)
        await open_console.shows(render(later.reason)[:40])
        assert OperatorKind.ACKNOWLEDGE not in host.kinds()
        await open_console.press("y")
        await open_console.until(lambda: OperatorKind.ACKNOWLEDGE in host.kinds())


@dataclass
class LinkedHost(FakeHost):
    """With control behind a link: each snapshot's moments are told by the clock as it is known then."""

    polls: int = 0

    def poll(self) -> Latest:
        latest = super().poll()
        self.polls += 1
        known = ClockEstimate(0, 0, self.polls)
        return latest if latest.snapshot is None else replace(latest, snapshot=localized(latest.snapshot, known))


async def test_an_event_of_a_second_computer_is_acknowledged_with_the_first_yes(console: Opener) -> None:
    async with console(host=LinkedHost) as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("space")
        await open_console.shows("HELD")
        before = app.live_state()
        await open_console.press("k")
        await open_console.until(lambda: isinstance(app.screen, Question) and app.screen.composed)
        await open_console.until(lambda: (state := app.live_state()) and before and state.events != before.events)
        asked = app.screen
        await open_console.press("y")
        await open_console.until(lambda: app.screen is not asked)
        assert not isinstance(app.screen, Question)
        await open_console.until(lambda: OperatorKind.ACKNOWLEDGE in host.kinds())


@pytest.mark.parametrize("size", [(20, 5), (80, 24), (200, 50), (250, 70)])
async def test_the_bar_is_visible_in_every_size(console: Opener, size: tuple[int, int]) -> None:
    async with console(size=size) as open_console:
        await open_console.shows("STOP")


async def test_without_a_session_space_is_a_letter(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("slash", "a", "space", "b")
        assert open_console.app.screen.query_one("#search").value == "a b"  # type: ignore[attr-defined]


async def test_after_the_session_the_bar_says_that_nothing_can_move(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever control said last, and though a STOP at its end was never acknowledged."""
    async with console() as open_console:
        host = open_console.host
        poll = host.poll
        monkeypatch.setattr(host, "poll", lambda: replace(poll(), stop_sent_ns=1))
        await open_console.press("space")
        await open_console.shows("STOP SENT, NOT ACKNOWLEDGED")
        await open_console.press("e")
        await open_console.shows("After the session")
        since_ns = time.monotonic_ns()
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.now_ns > since_ns)
        bar = open_console.app.screen.query_one(StopBar)
        assert bar.text == tr("stop.idle")
        assert not bar.has_class("-held")


@pytest.mark.parametrize(
    ("fields", "left_on"),
    [
        ({"state": GaitState.UNPOWERED}, False),
        ({"state": GaitState.STANDING, "guardian_gone": True}, True),
        ({"state": GaitState.STANDING, "switched_off": True}, False),
        ({"state": GaitState.STANDING, "switched_off": True, "unanswered": ("left_knee",)}, True),
        ({"state": GaitState.UNPOWERED, "unanswered": ("left_knee",)}, True),
    ],
    ids=["off", "control and guardian gone", "switched off by the guardian", "one silent", "one not confirmed"],
)
async def test_after_a_session_whose_drives_nobody_saw_off_the_bar_asks_for_the_emergency_stop(
    console: Opener, home: Home, fields: dict[str, Any], left_on: bool
) -> None:
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, "483920"))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        app = open_console.app
        await open_console.shows("demo")
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        await open_console.press("enter")
        await open_console.until(lambda: isinstance(app.screen, SignInDialog))
        await open_console.sign_in("Ada", "483920")
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot)
        host = open_console.host
        host.rests_at_once = False
        await open_console.press("e")
        await open_console.until(lambda: OperatorKind.SHUT_DOWN in host.kinds())
        for name, value in fields.items():
            setattr(host, name, value)
        host.control_ended = True
        await open_console.shows("After the session")
        expected = tr("stop.left_on" if left_on else "stop.idle")
        await open_console.until(lambda: app.screen.query_one(StopBar).text == expected)
        await app.close_session()
        await open_console.until(
            lambda: isinstance(app.screen, PatientsScreen) and app.screen.query_one(StopBar).text == expected
        )
