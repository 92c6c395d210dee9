"""The lock: after the time, never while legs move, and never by itself where somebody only watches."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from textual import events
from textual.command import CommandPalette

from app.console.lock import Idle, since_boot_s
from app.console.screens.after import AfterScreen
from app.console.screens.dialogs import Question
from app.console.screens.patients import PatientsScreen
from app.console.screens.signin import LockScreen
from app.console.widgets.bars import StopBar
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState
from app.system.config import Config
from testing.fake_host import FakeHost
from testing.messages import event
from tests.app.console.conftest import Console, Opener

Passes = Callable[[float], None]
NIGHT_S = 8 * 3600.0


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> Passes:
    """Lets so many seconds pass by the clock that also counts sleep; all others stand still meanwhile."""
    read, passed_s = time.clock_gettime, {time.CLOCK_BOOTTIME: 0.0}
    monkeypatch.setattr(time, "clock_gettime", lambda clock: read(clock) + passed_s.get(clock, 0.0))

    def passes(seconds: float) -> None:
        passed_s[time.CLOCK_BOOTTIME] += seconds

    return passes


@pytest.mark.parametrize(("limit_s", "now_s", "over"), [(10, 9.9, False), (10, 10, True), (0, 1e9, False)])
def test_when_the_time_is_over(limit_s: float, now_s: float, over: bool) -> None:
    assert Idle(touched_s=0.0, limit_s=limit_s).is_over(now_s) is over


def test_a_touch_starts_the_time_anew() -> None:
    assert not Idle(touched_s=0.0, limit_s=10).touched(50).is_over(59)


async def test_an_idle_console_locks_stops_and_unlocks(console: Opener) -> None:
    async with console(config=Config(idle_lock_s=1.0)) as open_console:
        await open_console.until(lambda: isinstance(open_console.app.screen, LockScreen))
        await open_console.press("space")
        await open_console.until(lambda: OperatorKind.STOP in open_console.host.kinds())
        await open_console.press("a")
        assert OperatorKind.ARM not in open_console.host.kinds()
        await open_console.press("escape")
        locked = open_console.app.screen
        assert isinstance(locked, LockScreen)
        await open_console.press("enter")
        # On a slow machine the time is over again by now, with a new lock.
        await open_console.until(lambda: locked not in open_console.app.screen_stack)


@pytest.mark.parametrize("over", [(), ("f1",)], ids=["lock", "help over the lock"])
async def test_a_locked_console_gives_no_orders_by_the_palette(console: Opener, over: tuple[str, ...]) -> None:
    async with console() as open_console:
        await open_console.press("ctrl+l")
        await open_console.shows("Press Enter to go on")
        await open_console.press(*over, "ctrl+p")
        assert not any(isinstance(screen, CommandPalette) for screen in open_console.app.screen_stack)
        await open_console.press(*"sitdown", "enter")
        assert OperatorKind.ACT not in open_console.host.kinds()


async def test_the_lock_outlasts_the_session(console: Opener) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        host.rests_at_once = False
        await open_console.press("e", "ctrl+l")
        host.control_ended = True
        await open_console.until(lambda: any(isinstance(screen, AfterScreen) for screen in app.screen_stack))
        assert isinstance(app.screen, LockScreen)
        await open_console.press("enter")
        await open_console.shows("After the session")
        await open_console.press("ctrl+l")
        await app.close_session()  # as after saving, which takes seconds
        assert isinstance(app.screen, LockScreen)
        await open_console.press("enter")
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))


async def test_it_locks_after_a_session_too(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session")
        open_console.host.silent = True
        await open_console.until(lambda: (state := open_console.app.live_state()) and not state.snapshot_fresh)
        _touched(open_console, ago_s=11.0)
        await open_console.until(lambda: isinstance(open_console.app.screen, LockScreen))


async def test_it_locks_over_a_session_that_could_not_start(console: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_: FakeHost) -> None:
        raise OSError("no processes")

    monkeypatch.setattr(FakeHost, "start", refused)
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        await open_console.press("enter")
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.fault)
        _touched(open_console, ago_s=11.0)
        await open_console.until(lambda: isinstance(open_console.app.screen, LockScreen))


async def test_a_console_locks_when_its_computer_wakes(console: Opener, passes: Passes) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        passes(NIGHT_S)
        await open_console.app.on_event(events.Key("down", None))  # that woke it
        await open_console.until(lambda: isinstance(open_console.app.screen, LockScreen))


@pytest.mark.parametrize(
    ("before", "key", "kind"), [((), "a", OperatorKind.ARM), (("k",), "y", OperatorKind.ACKNOWLEDGE)]
)
async def test_the_key_that_wakes_a_computer_commands_nothing(
    console: Opener, passes: Passes, before: tuple[str, ...], key: str, kind: OperatorKind
) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("c", "y")
        await open_console.until(lambda: host.confirmed)
        if before:
            await open_console.press("space")
            await open_console.until(lambda: (state := app.live_state()) and state.effect is Effect.HOLD)
            await open_console.press(*before)
            await open_console.until(lambda: isinstance(app.screen, Question))
        passes(NIGHT_S)
        await open_console.press(key)
        await open_console.until(lambda: isinstance(app.screen, LockScreen))
        assert kind not in host.kinds()


@pytest.mark.parametrize("silent", [False, True], ids=["at rest", "moving, as far as the console knows"])
@pytest.mark.parametrize("by", ["key", "click"])
async def test_the_stop_that_wakes_a_computer_acts_and_leads_to_the_lock(
    console: Opener, passes: Passes, by: str, silent: bool
) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        host.silent = silent
        await open_console.until(lambda: (state := app.live_state()) and state.moving is silent)
        passes(NIGHT_S)
        await (open_console.press("space") if by == "key" else open_console.pilot.mouse_down(StopBar))
        await open_console.until(lambda: OperatorKind.STOP in host.kinds())
        host.silent = False
        await open_console.until(lambda: isinstance(app.screen, LockScreen))
        await open_console.press("k", "y", "a")
        assert {OperatorKind.ACKNOWLEDGE, OperatorKind.ARM}.isdisjoint(host.kinds())


async def test_a_control_that_wakes_later_delays_the_lock_only_so_long(console: Opener, passes: Passes) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        host.silent = True
        await open_console.until(lambda: (state := app.live_state()) and not state.snapshot_fresh)
        passes(NIGHT_S)
        await _beat(open_console)  # as far as the console knows, the legs may move
        assert not isinstance(app.screen, LockScreen)
        host.silent = False
        await open_console.until(lambda: isinstance(app.screen, LockScreen))


async def test_who_stops_legs_at_rest_sees_them_for_the_whole_time(console: Opener, passes: Passes) -> None:
    async with console(config=Config(idle_lock_s=1000.0)) as open_console:
        app, host = open_console.app, open_console.host
        passes(900.0)
        await open_console.press("space")
        await open_console.until(lambda: OperatorKind.STOP in host.kinds())
        await _beat(open_console)
        passes(900.0)
        await _beat(open_console)
        assert not isinstance(app.screen, LockScreen)
        passes(100.0)
        await open_console.until(lambda: isinstance(app.screen, LockScreen))


async def test_a_hold_in_the_middle_of_a_walk_stays_in_sight_for_the_whole_time(
    console: Opener, passes: Passes
) -> None:
    async with console(config=Config(idle_lock_s=1000.0)) as open_console:
        app, host = open_console.app, open_console.host
        await _walk(open_console)
        for _ in range(3):  # nobody touches a key: the patient walks by gestures
            passes(900.0)
            await _beat(open_console)
        host.walked, host.effect, host.state = {"enabled": True}, Effect.HOLD, GaitState.BETWEEN
        host.events = (event(Event.FOLLOWING_LIMIT, Effect.HOLD, time.monotonic_ns(), angle_rad=0.2),)
        await open_console.until(lambda: (state := app.live_state()) and state.effect is Effect.HOLD)
        passes(900.0)
        await _beat(open_console)
        await open_console.shows("HELD")
        assert not isinstance(app.screen, LockScreen)
        passes(100.0)
        await open_console.until(lambda: isinstance(app.screen, LockScreen))


async def test_an_observers_console_never_locks_by_itself(console: Opener, passes: Passes) -> None:
    async with console(read_only=True) as open_console:
        app, host = open_console.app, open_console.host
        passes(NIGHT_S)
        await _beat(open_console)
        assert not isinstance(app.screen, LockScreen)
        host.control_ended = host.silent = True
        await open_console.until(lambda: (state := app.live_state()) and not state.snapshot_fresh)
        await _beat(open_console)
        assert not isinstance(app.screen, LockScreen)


async def _walk(open_console: Console) -> None:
    open_console.host.walked = {"action": Action.WALK, "progress": 0.2}
    await open_console.until(lambda: (state := open_console.app.live_state()) and state.moving)


async def _beat(open_console: Console) -> None:
    """The session has been looked at once more, with all that goes with it."""
    since_ns = time.monotonic_ns()
    await open_console.until(lambda: (state := open_console.app.live_state()) and state.now_ns > since_ns)


def _touched(open_console: Console, *, ago_s: float) -> None:
    """The last key or click was so long ago, in a console that locks after ten seconds."""
    open_console.app._idle = Idle(touched_s=since_boot_s() - ago_s, limit_s=10.0)
