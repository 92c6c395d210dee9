"""A therapist at a console over real processes, who copes with a host that stalls.

A busy machine stands still for 40 ms now and then. Control then holds the legs, and a therapist acknowledges and begins
again. So does `RealConsole`, at most `PATIENCE` times a session; any other stop is a failure (see also stalls.py).
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest
from textual.pilot import Pilot
from textual.screen import Screen

from app.console.app import ConsoleApp
from app.console.keys import GESTURE_KEYS
from app.console.screens.dialogs import Question
from app.console.widgets.bars import StopBar
from app.ipc.messages import TriggerReport
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import ACTION_OF, Action, Effect, Event, GaitState, Outcome
from app.session.host import SessionHost
from app.system.config import Config, SessionSetup
from app.system.hand_model import find_model
from app.system.paths import Home, find_home
from kgdfa.gesture import Gesture
from logs.read import records, session_paths
from logs.records import Stop
from profiles.schema import DEMO_PATIENT, Profile
from testing.session import control_core_of_worker
from tests.app.console.conftest import Console, wait_until
from tests.app.console.stalls import AFTER_STALLS, STALLS, HostStalled
from tests.app.console.ways import THROUGH, first_action

LIMIT_S = 60.0  # five interpreters, the hand model, the physics and the legs, on a machine that tests other things too
PATIENCE = 12  # times that a stalling host may interrupt a session
TRIES = 4 * PATIENCE  # looks and keys on the way to one goal
PUSH_S = 4.0  # a push that was not seen is made again after this
KEY_OF = {ACTION_OF[gesture]: key for key, gesture in GESTURE_KEYS.items()}


AnyScreen = type[Screen[Any]]


class RealConsole(Console):
    """A console over real processes, with what control and perception last said."""

    def __init__(self, app: ConsoleApp, pilot: Pilot[None], home: Path, *, perception: bool) -> None:
        super().__init__(app, pilot, [])
        self.home = home
        self._perception = perception
        self.interruptions: list[str] = []

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

    @property
    def waiting(self) -> frozenset[tuple[Event, int]]:
        """What keeps the legs from going on until it is acknowledged: names, and since when."""
        return frozenset(
            (event.event, event.since_ns)
            for event in self.snapshot.events
            if not event.acknowledged and (event.effect >= Effect.HOLD or event.event in STALLS | AFTER_STALLS)
        )

    @property
    def held(self) -> bool:
        """Whether the legs are held, or something waits to be acknowledged."""
        return self.snapshot.effect >= Effect.HOLD or bool(self.waiting)

    def in_force(self, event: Event) -> bool:
        """Whether this event is there, or waits for its acknowledgement."""
        return any(one.event is event and (one.present or not one.acknowledged) for one in self.snapshot.events)

    def pid(self, name: str) -> int:
        """The process of this name."""
        state = self.app.live_state()
        assert state is not None
        return next(process.pid for process in state.processes if process.name == name)

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a process."""
        os.kill(self.pid(name), number)

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait until the condition holds; legs take their time."""
        await wait_until(self.pilot, lambda: condition() or self._lost(), LIMIT_S)
        if self._lost():
            raise HostStalled(self._tell("the guardian took the legs"))

    async def begun(self) -> None:
        """Wait until the processes of a session have spoken."""
        await self.until(self._has_spoken)

    async def confirm_and_arm(self) -> None:
        """What a therapist does first."""
        await self.press("c")
        await self.shows("Is this the patient?")
        await self.press("y")
        await self.until(lambda: self.snapshot.patient_confirmed)
        await self.press("a")
        await self.until(lambda: self.snapshot.armed)

    async def acknowledge(self) -> None:
        """Two deliberate keys, for as long as something waits for them."""
        for _ in self._tries("going on after an acknowledgement"):
            if not self.held:
                return
            waiting = self.waiting
            if waiting:
                await self.press("k")
                await self.until(lambda: isinstance(self.app.screen, Question) or not self.held)
            if isinstance(self.app.screen, Question):
                await self.press("y")
            await self.until(partial(self._has_moved_on, waiting))

    async def bring(self, goal: GaitState) -> None:
        """Lead the legs to a state by the therapist's keys, as often as a stalling host interrupts them."""
        for _ in self._tries(goal.value):
            if self.at(goal):
                return
            if self.held:
                await self.pick_up()
            elif self.snapshot.action is None:
                await self.begin(first_action(self.snapshot.state, goal))
            else:
                await self.until(lambda: self.snapshot.action is None or self.at(goal) or self.held)

    async def whole(self, action: Action) -> None:
        """An action from standing to its end, as often as a stalling host interrupts it."""
        for _ in self._tries(action.value):
            await self.bring(GaitState.STANDING)
            number = self._newest_report
            await self.begin(action)
            await self.until(lambda: self.snapshot.action is None or self.held)
            report = next((one for one in self.snapshot.reports if one.number > number), None)
            if report is not None and report.outcome is Outcome.COMPLETED:
                return

    def at(self, goal: GaitState) -> bool:
        """Whether the legs are in a state: at rest, or in the middle of the movement that passes through it."""
        now = self.snapshot
        if now.state is not goal or self.held:
            return False
        return now.progress > 0 if goal in THROUGH else now.action is None

    async def walk(self, steps: int) -> None:
        """Walk so many steps at one go; the legs go on walking."""
        for _ in self._tries("walking"):
            await self.bring(GaitState.STANDING)
            wanted = self.snapshot.steps + steps
            await self.begin(Action.WALK)
            await self.until(partial(self._has_walked, wanted))
            if self._walking:
                return

    async def stop_in(self, goal: GaitState) -> None:
        """STOP in a state, as the trail records it: between the look and the key a movement may leave it."""
        for _ in self._tries(f"STOP in {goal.value}"):
            await self.bring(goal)
            recorded = partial(self._stopped_more_than, len(self.stops()))
            await self.stop()
            await self.until(recorded)
            if self.stops()[-1] == goal.value:
                return
            await self.pick_up(f"{goal.value} was over before STOP")

    def _stopped_more_than(self, times: int) -> bool:
        return len(self.stops()) > times

    def stops(self) -> list[str]:
        """The state of every STOP that the session's trail holds so far."""
        (trail,) = session_paths(self.home / "logs")
        return [record.body.state for record in records(trail) if isinstance(record.body, Stop)]

    async def stop(self) -> None:
        """One key, and the bar of every screen of ours says what it did."""
        await self.press("space")
        await self.until(lambda: self.in_force(Event.STOP) and self.snapshot.action is None)
        if self.app.screen.query(StopBar):
            await self.until(lambda: "LEGS HELD" in self.text() or "JOINTS OFF" in self.text())  # off until gesture 0

    async def request(self, gesture: Gesture) -> None:
        """The wearer's way: sign, push, draw back, until the legs have begun."""
        action = ACTION_OF[gesture]
        for _ in self._tries(f"{action.value} by gesture"):
            if self.held:
                await self.pick_up()
            await self.until(lambda: action in self.snapshot.allowed or self.held)
            begun = partial(self._has_begun, action, self._newest_report)
            await self.press(KEY_OF[action])
            await self.until(lambda: self.report.gesture is gesture)
            await self.press("p")
            await self._for_a_while(lambda: self.report.pressed)
            await self.press("p")
            await self._for_a_while(begun)
            if begun():
                return
            self._note(f"no push: {self.report.cancel_reason or self.report.press_hint or self.snapshot.refusal}")

    async def _for_a_while(self, condition: Callable[[], bool]) -> None:
        """Wait as a person does who then tries again."""
        end_s = time.monotonic() + PUSH_S
        await self.until(lambda: condition() or time.monotonic() > end_s)

    def _has_moved_on(self, waiting: frozenset[tuple[Event, int]]) -> bool:
        return not self.held or self.waiting != waiting

    def _has_walked(self, steps: int) -> bool:
        return self.snapshot.steps >= steps or not self._walking

    def _has_begun(self, action: Action, before: int) -> bool:
        """By its report: an action may be over before a console that stands still for a while looks again."""
        return any(report.action is action and report.number > before for report in self.snapshot.reports)

    @property
    def _walking(self) -> bool:
        return self.snapshot.action is Action.WALK and not self.held

    @property
    def _newest_report(self) -> int:
        return max((report.number for report in self.snapshot.reports), default=0)

    async def begin(self, action: Action) -> None:
        """The therapist's key, once it is allowed: legs that have just come to rest swing for a while."""
        await self.until(lambda: action in self.snapshot.allowed or self.held)
        if self.held:
            return
        refusals = self.snapshot.refusal_count
        begun = partial(self._has_begun, action, self._newest_report)
        await self.press("t", KEY_OF[action])
        await self.until(lambda: begun() or self.snapshot.refusal_count > refusals or self.held)
        if self.snapshot.refusal_count > refusals:
            self._note(f"refused: {self.snapshot.refusal}")

    async def pick_up(self, why: str = "") -> None:
        """Acknowledge what a stalling host has done; fail for anything else."""
        found = {event for event, _ in self.waiting}
        names = sorted(event.value for event in found)
        if not why and not found <= STALLS and not (found <= STALLS | AFTER_STALLS and self.interruptions):
            pytest.fail(self._tell(f"the legs were stopped by {names}"))
        self._note(why or f"held: {names}")
        await self.acknowledge()

    def _tries(self, what: str) -> Iterator[int]:
        """Often enough for a host that stalls; then a failure."""
        yield from range(TRIES)
        pytest.fail(self._tell(f"{what} did not come about"))

    def _note(self, what: str) -> None:
        self.interruptions.append(what)
        if len(self.interruptions) > PATIENCE:
            pytest.fail(self._tell("the session was interrupted too often"))

    def _has_spoken(self) -> bool:
        state = self.app.live_state()
        if state is None or state.snapshot is None:
            return False
        return state.report is not None or not self._perception

    def _lost(self) -> bool:
        return self._has_spoken() and self.in_force(Event.GUARDIAN_ACTED)

    def _tell(self, what: str) -> str:
        return f"{what}; before: {self.interruptions}; control: {self.snapshot}"


async def stop_on(console: RealConsole, screen: AnyScreen) -> None:
    """STOP while this is on top: control holds, and the screen stays."""
    await console.until(lambda: isinstance(console.app.screen, screen))
    await console.begun()
    await console.stop()
    assert isinstance(console.app.screen, screen), screen


def real_config(**changes: object) -> Config:
    """Half the frames a second: whether the console works must not hang on how busy the machine is."""
    config = Config(model=str(find_model(find_home(), Config())), control_core=control_core_of_worker(), idle_lock_s=0)
    camera = msgspec.structs.replace(config.camera, rate_hz=15.0)
    return msgspec.structs.replace(config, camera=camera, **changes)


def keys_only(setup: SessionSetup) -> SessionHost:
    """A session without perception."""
    return SessionHost(setup, without=frozenset({"perception"}))


@asynccontextmanager
async def real_console(
    home: Path,
    *,
    profile: Profile | None = DEMO_PATIENT,
    config: Config | None = None,
    make_host: Callable[[SessionSetup], SessionHost] = SessionHost,
    size: tuple[int, int] = (80, 24),
    perception: bool = True,
) -> AsyncIterator[RealConsole]:
    """Open a console, with a running session unless `profile` is None; its processes end whatever happens.

    perception: whether `make_host` starts it; without it the therapist's keys alone lead the legs.
    """
    app = ConsoleApp(Home(home), config or real_config(), profile=profile, make_host=make_host)
    async with app.run_test(size=size, notifications=True) as pilot:
        console = RealConsole(app, pilot, home, perception=perception)
        try:
            if profile is not None:
                await console.begun()
            yield console
        finally:
            app.close_live()
