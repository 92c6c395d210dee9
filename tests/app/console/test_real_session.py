"""The console over the real processes: digital hand, simulated joints, audit trail, guardian."""

from __future__ import annotations

import os
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest

from app.config import Config
from app.console.after.screen import AfterScreen
from app.console.app import ConsoleApp
from app.control.states import Action, Effect, GaitState
from app.messages import ControlSnapshot, TriggerReport
from app.model import find_model
from app.paths import Home, find_home
from kgdfa.gesture import Gesture
from logs.read import session_paths
from profiles.schema import DEMO_PATIENT
from tests.app.console.conftest import Console, wait_until

START_LIMIT_S = 60.0  # five interpreters, the hand model and the physics, on a machine that tests other things too
STEP_LIMIT_S = 60.0


class RealConsole(Console):
    """A console over real processes, with what control and perception last said."""

    @property
    def snapshot(self) -> ControlSnapshot:
        """Control's newest word."""
        state = self.app.live_state()
        assert state is not None
        assert state.snapshot is not None
        return state.snapshot

    @property
    def report(self) -> TriggerReport:
        """Perception's newest word."""
        state = self.app.live_state()
        assert state is not None
        assert state.report is not None
        return state.report

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait until the condition holds; legs take their time."""
        await wait_until(self.pilot, condition, STEP_LIMIT_S)

    async def confirm_and_arm(self) -> None:
        """What a therapist does first."""
        await self.press("c")
        await self.shows("Is this the patient?")
        await self.press("y")
        await self.until(lambda: self.snapshot.patient_confirmed)
        await self.press("a")
        await self.until(lambda: self.snapshot.armed)

    async def acknowledge(self) -> None:
        """Two deliberate keys."""
        await self.press("k")
        await self.shows("Acknowledge?")
        await self.press("y")
        await self.until(lambda: self.snapshot.effect < Effect.HOLD)

    async def begin(self, key: str, action: Action) -> None:
        """The therapist's action, once it is allowed: freshly started legs swing for a while."""
        await self.until(lambda: action in self.snapshot.allowed)
        await self.press("t", key)
        await self.until(lambda: self.snapshot.action is action)

    async def act(self, key: str, action: Action, state: GaitState) -> None:
        """The therapist's action to its end."""
        await self.begin(key, action)
        await self.until(lambda: self.snapshot.state is state and self.snapshot.action is None)


def real_config() -> Config:
    """Half the frames a second: whether the console works must not hang on how busy the machine is."""
    config = Config(model=str(find_model(find_home(), Config())), idle_lock_s=0)
    return msgspec.structs.replace(config, camera=msgspec.structs.replace(config.camera, rate_hz=15.0))


@asynccontextmanager
async def real_console(home: Path, size: tuple[int, int] = (80, 24)) -> AsyncIterator[RealConsole]:
    """Open a console with a running session; its processes end whatever happens."""
    app = ConsoleApp(Home(home), real_config(), profile=DEMO_PATIENT)
    async with app.run_test(size=size, notifications=True) as pilot:
        try:
            await wait_until(pilot, lambda: (state := app.live_state()) and state.snapshot, START_LIMIT_S)
            await wait_until(pilot, lambda: (state := app.live_state()) and state.report, START_LIMIT_S)
            yield RealConsole(app, pilot, [])
        finally:
            app.close_live()


async def test_a_session_with_walking_a_stair_and_stop(tmp_path: Path) -> None:
    async with real_console(tmp_path) as console:
        await console.press("5")
        await console.until(lambda: console.report.gesture is Gesture.FIVE)
        await console.press("p")
        await console.until(lambda: console.report.pressed)
        await console.press("p")
        await console.until(lambda: not console.report.pressed)
        assert console.snapshot.state is GaitState.UNPOWERED  # nobody has armed gestures

        await console.confirm_and_arm()
        await console.act("0", Action.INITIALISE, GaitState.STANDING)
        await console.begin("5", Action.WALK)
        await console.until(lambda: console.snapshot.steps >= 2)
        await console.press("space")
        await console.until(lambda: console.snapshot.effect is Effect.HOLD)
        await console.shows("HELD")

        await console.acknowledge()
        await console.act("0", Action.INITIALISE, GaitState.STANDING)
        await console.act("7", Action.STAIR_UP, GaitState.STANDING)
        await console.press("e")
        await console.shows("End the session?")
        await console.press("y")
        await console.until(lambda: isinstance(console.app.screen, AfterScreen) and console.app.focused)
        await console.press(*"good", "ctrl+s")
        await console.shows("good")
    (trail,) = session_paths(tmp_path / "logs")
    text = trail.read_text()
    assert '"kind":"note","text":"good"' in text
    assert '"kind":"stop"' in text


async def test_a_perception_that_dies_comes_back_and_nothing_moves_meanwhile(tmp_path: Path) -> None:
    async with real_console(tmp_path) as console:
        await console.confirm_and_arm()
        await console.act("0", Action.INITIALISE, GaitState.STANDING)
        state = console.app.live_state()
        assert state is not None
        first = next(process.pid for process in state.processes if process.name == "perception")
        os.kill(first, signal.SIGKILL)
        await console.shows("No picture reaches the program")
        await console.until(lambda: console.report.incarnation and console.app.live_state().report_fresh)  # type: ignore[union-attr]
        state = console.app.live_state()
        assert state is not None
        assert next(process.pid for process in state.processes if process.name == "perception") != first
        assert console.snapshot.state is GaitState.STANDING


@pytest.mark.parametrize("presses", [1, 2])
async def test_stop_while_standing(tmp_path: Path, presses: int) -> None:
    wanted = {1: Effect.HOLD, 2: Effect.DAMP}[presses]
    async with real_console(tmp_path) as console:
        await console.confirm_and_arm()
        await console.act("0", Action.INITIALISE, GaitState.STANDING)
        await console.press("space")
        await console.until(lambda: console.snapshot.effect is Effect.HOLD)
        if presses == 2:
            await console.press("space")
        await console.until(lambda: console.snapshot.effect is wanted)
