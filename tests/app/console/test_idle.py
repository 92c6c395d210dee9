"""The lock: after the time, never while legs move."""

from __future__ import annotations

import pytest

from app.console.operator import Idle
from app.console.screens.signin import LockScreen
from app.ipc.messages import OperatorKind
from app.system.config import Config
from tests.app.console.conftest import Opener


@pytest.mark.parametrize(
    ("limit_s", "now_s", "moving", "locks"),
    [(10, 9.9, False, False), (10, 10, False, True), (10, 99, True, False), (0, 1e9, False, False)],
)
def test_when_it_locks(limit_s: float, now_s: float, moving: bool, locks: bool) -> None:
    assert Idle(touched_s=0.0, limit_s=limit_s).must_lock(now_s, moving=moving) is locks


def test_a_touch_starts_the_time_anew() -> None:
    assert not Idle(touched_s=0.0, limit_s=10).touched(50).must_lock(59, moving=False)


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
