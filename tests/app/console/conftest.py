"""Shared by the console's tests: a home, an application over the host we own, waiting without sleeping blindly."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Input

from app.console import live
from app.console.app import ConsoleApp
from app.console.operator import ConsoleTrail
from app.system.config import Config, SessionSetup
from app.system.paths import Home
from app.text.catalogue import use_language
from logs.records import Body
from profiles.schema import DEMO_PATIENT, Profile
from testing.fake_host import FakeHost, screen_text

Opener = Callable[..., AbstractAsyncContextManager["Console"]]
LIMIT_S = 120.0  # a busy machine is slow, not wrong


class Console:
    """An open console with its pilot and, once a session has begun, its host."""

    def __init__(self, app: ConsoleApp, pilot: Pilot[None], hosts: list[FakeHost]) -> None:
        self.app = app
        self.pilot = pilot
        self.hosts = hosts

    @property
    def host(self) -> FakeHost:
        """The newest session's host."""
        return self.hosts[-1]

    async def press(self, *keys: str) -> None:
        """Press keys one after the other."""
        await self.pilot.press(*keys)

    def type(self, field: str, text: str) -> None:
        """Put these words into a field of the open screen."""
        self.app.screen.query_one(f"#{field}", Input).value = text

    async def sign_in(self, name: str, pin: str) -> None:
        """Into the open dialog; test_takeover types it key by key."""
        self.type("name", name)
        self.type("pin", pin)
        self.app.screen.query_one("#pin").focus()
        await self.press("enter")

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait until the condition holds; fail after a limit."""
        await wait_until(self.pilot, condition)

    async def shows(self, text: str) -> None:
        """Wait until the screen shows this text, on one line or broken over several."""
        await self.until(lambda: text in self.text() or text in " ".join(self.text().split()))

    async def tells(self, text: str) -> None:
        """Wait until a message to the operator contains these words."""
        await self.until(lambda: any(text in note.message for note in self.app._notifications))

    def text(self) -> str:
        """What is on the screen, line by line."""
        return screen_text(self.app)


async def wait_until(pilot: Pilot[None], condition: Callable[[], object], limit_s: float = LIMIT_S) -> None:
    """Let the application work until the condition holds."""
    try:
        async with asyncio.timeout(limit_s):
            while not condition():
                await pilot.pause(0.01)
    except TimeoutError:
        pytest.fail(f"did not come within {limit_s:g} s; the screen shows:\n{screen_text(pilot.app)}")


async def change_language(
    pilot: Pilot[None], monkeypatch: pytest.MonkeyPatch, meanwhile: Callable[[], Awaitable[None]]
) -> None:
    """By its key; meanwhile: what happens when the open screen's widgets are gone and the new ones not there yet."""
    screen = pilot.app.screen
    mount = screen.mount_all

    async def mount_later(widgets: Iterable[Widget]) -> None:
        await meanwhile()
        await mount(widgets)

    with monkeypatch.context() as patch:
        patch.setattr(screen, "mount_all", mount_later)
        await pilot.press("f3")


async def three_beats(screen: Screen[Any], period_s: float) -> None:
    """Until another timer of this screen, of this period, has come at least twice."""
    seen, over = 0, asyncio.Event()

    def count() -> None:
        nonlocal seen
        seen += 1
        if seen == 3:
            over.set()

    timer = screen.set_interval(period_s, count)
    async with asyncio.timeout(LIMIT_S):  # none comes once the application has ended
        await over.wait()
    timer.stop()


@pytest.fixture(autouse=True)
def english() -> Iterator[None]:
    """A language that one test chose must not reach the next."""
    use_language("en")
    yield
    use_language("en")


@pytest.fixture(autouse=True)
def without_collections(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """No session begins by collecting the garbage of all tests before it: test_warm and real sessions show that."""
    if request.path.name != "test_warm.py" and request.node.get_closest_marker("serial") is None:
        nothing = dict.fromkeys(("collect", "freeze", "unfreeze", "set_threshold"), lambda *_: None)
        monkeypatch.setattr(live, "gc", SimpleNamespace(**nothing))


@pytest.fixture
def home(tmp_path: Path) -> Home:
    """An empty home."""
    return Home(tmp_path / "home")


@pytest.fixture
def trail(monkeypatch: pytest.MonkeyPatch) -> list[Body]:
    """What the console would put in the trail."""
    found: list[Body] = []
    monkeypatch.setattr(ConsoleTrail, "emit", lambda _, body: found.append(body))
    return found


@pytest.fixture
def console(home: Home) -> Opener:
    """Opens a console over the host we own; `profile=None` begins with the patients' list."""

    @asynccontextmanager
    async def opened(
        *,
        size: tuple[int, int] = (80, 24),
        config: Config | None = None,
        profile: Profile | None = DEMO_PATIENT,
        read_only: bool = False,
        held: SessionSetup | None = None,
        host: type[FakeHost] = FakeHost,
    ) -> AsyncIterator[Console]:
        hosts: list[FakeHost] = []

        def make_host(setup: SessionSetup) -> FakeHost:
            hosts.append(host(setup))
            return hosts[-1]

        app = ConsoleApp(home, config or Config(), profile=profile, make_host=make_host, read_only=read_only, held=held)
        async with app.run_test(size=size, notifications=True) as pilot:
            opened_console = Console(app, pilot, hosts)
            if profile is not None and held is None:
                await opened_console.until(lambda: (state := app.live_state()) and state.snapshot)
            try:
                yield opened_console
            finally:
                app.close_live()

    return opened
