"""Watching: an observer finds the running session, hears it, and can't act on it."""

from __future__ import annotations

import os
import re
import shutil
import threading
import time
from pathlib import Path

import msgspec
import pytest
from aiohttp.test_utils import TestClient, TestServer
from textual.widgets import Static

from app.console.guidance import Light, results
from app.console.observer import PORT, ObserverHost, browser_server, speak_session, watching_command
from app.console.screens.help import HelpPage
from app.console.state import SessionState, fold
from app.console.widgets.bars import KeyBar, StopBar
from app.ipc import streams as processes
from app.ipc.links import OrderedReceiver, Publisher, address, new_link_directory
from app.ipc.messages import (
    GuardianHealth,
    HandCommand,
    LinkHealth,
    OperatorCommand,
    OperatorKind,
    ProcessStatus,
    SessionStatus,
    TriggerReport,
)
from app.ipc.states import Effect
from app.session.setup import make_setup
from app.session.shared import share, shared, unshare
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import tr, use_language
from profiles.schema import DEMO_PATIENT
from testing.authors import signed_in
from tests.app.console.conftest import Opener

LIMIT_S = 10.0


@pytest.fixture
def setup(home: Home, tmp_path: Path) -> SessionSetup:
    made = make_setup(home, Config(), DEMO_PATIENT, signed_in(home))
    made.links.path.rmdir()
    (tmp_path / "links").mkdir()
    return msgspec.structs.replace(made, links=new_link_directory(tmp_path / "links"))


def test_what_is_shared_is_found(home: Home, setup: SessionSetup) -> None:
    running = msgspec.structs.replace(setup, host_pid=os.getpid())
    share(running)
    assert shared(home) == running


def test_without_a_session_there_is_nothing_to_watch(home: Home, setup: SessionSetup) -> None:
    with pytest.raises(AppError, match="NO_SESSION_TO_WATCH"):
        shared(home)
    share(setup)
    unshare(setup)
    with pytest.raises(AppError, match="NO_SESSION_TO_WATCH"):
        shared(home)
    share(msgspec.structs.replace(setup, host_pid=os.getpid()))
    setup.links.path.rmdir()
    with pytest.raises(AppError, match="SESSION_ENDED"):
        shared(home)


def test_an_observer_receives_and_reports_nothing(setup: SessionSetup) -> None:
    publisher = Publisher(address(setup.links, processes.TRIGGER.name))
    operator = OrderedReceiver(address(setup.links, processes.OPERATOR.name), OperatorCommand)
    observer = ObserverHost(setup)
    report = TriggerReport(incarnation=1, sequence=7, captured_ns=0, sent_ns=0, hand=False, gesture=None)
    try:
        limit = time.monotonic() + LIMIT_S
        while observer.poll().report != report:
            publisher.send(report)
            assert time.monotonic() < limit
        observer.send(OperatorKind.SHUT_DOWN)
        observer.send_to_perception(HandCommand(press=True))
        observer.heartbeat()
        assert operator.receive(timeout_s=0.2) is None
    finally:
        for link in (publisher, operator, observer):
            link.close()


def test_an_observer_is_told_which_process_has_died_and_whose_drives_are_silent(setup: SessionSetup) -> None:
    dead = ProcessStatus(name="guardian", pid=7, alive=False, restarts=0, exit_code=-9)
    status = SessionStatus(at_ns=1, processes=(dead,))
    health = GuardianHealth(at_ns=1, acted=True, unanswered=("left_knee",))
    session, guardian = (Publisher(address(setup.links, one.name)) for one in (processes.SESSION, processes.GUARDIAN))
    observer = ObserverHost(msgspec.structs.replace(setup, host_pid=os.getpid()))
    seen: dict[str, object] = {}
    try:
        limit = time.monotonic() + LIMIT_S
        while seen != {"processes": (dead,), "guardian": health}:
            session.send(status)
            guardian.send(health)
            latest = observer.poll()
            seen = {"processes": latest.processes, "guardian": latest.guardian or seen.get("guardian")}
            assert time.monotonic() < limit
    finally:
        for link in (session, guardian, observer):
            link.close()


def running(*names: str) -> tuple[ProcessStatus, ...]:
    """Processes that live."""
    return tuple(ProcessStatus(name=name, pid=7, alive=True, restarts=0, exit_code=None) for name in names)


def test_an_observer_of_two_computers_sees_the_processes_of_both(setup: SessionSetup) -> None:
    config = Config(joints=JointsConfig(host="exo.local"))
    setup = msgspec.structs.replace(setup, config=config, host_pid=os.getpid())
    here, there = running("audit", "perception", "link"), running("guardian", "planner", "control")
    status = SessionStatus(at_ns=1, processes=here)
    health = LinkHealth(at_ns=1, host="exo.local:7447", connected=True, processes=there)
    session, link = (Publisher(address(setup.links, one.name)) for one in (processes.SESSION, processes.LINK))
    observer = ObserverHost(setup)
    state = SessionState(setup=setup, started_ns=0, now_ns=0)
    try:
        limit = time.monotonic() + LIMIT_S
        while (state.processes, state.link) != (here, health):
            session.send(status)
            link.send(health)
            state = fold(state, observer.poll(), 0)
            assert time.monotonic() < limit
    finally:
        for each in (session, link, observer):
            each.close()
    assert results(state)["processes"] is Light.GREEN


def test_who_listens_hears_a_session_that_goes_on_without_a_process_to_its_end(home: Home, setup: SessionSetup) -> None:
    """As a perception that is restarted."""
    name = "perception"
    share(msgspec.structs.replace(setup, host_pid=os.getpid()))
    ended = msgspec.structs.replace(*running(name), alive=False, exit_code=1)
    told: list[str] = []
    publisher = Publisher(address(setup.links, processes.SESSION.name))
    listener = threading.Thread(target=speak_session, args=(home, told.append))
    starting, down = tr("watch.starting"), tr("watch.process_down")
    try:
        listener.start()
        limit = time.monotonic() + LIMIT_S
        for status, line in ((running(name), starting), ((ended,), down), (running(name), starting)):
            while told[-1:] != [line]:
                publisher.send(SessionStatus(at_ns=1, processes=status))
                listener.join(0.01)
                assert time.monotonic() < limit, told
    finally:
        shutil.rmtree(setup.links)
        listener.join(LIMIT_S)
        publisher.close()
    assert told == [starting, down, starting, tr("plain.session_ended")]


def test_an_ended_session_is_over_for_its_observer(setup: SessionSetup) -> None:
    observer = ObserverHost(msgspec.structs.replace(setup, host_pid=os.getpid()))
    try:
        assert [process.alive for process in observer.poll().processes] == [True] * 5
        shutil.rmtree(setup.links)
        assert not any(process.alive for process in observer.poll().processes)
    finally:
        observer.close()


async def test_the_bar_reports_that_stop_is_elsewhere(console: Opener) -> None:
    async with console(read_only=True) as open_console:
        await open_console.shows("View only")
        await open_console.shows("The patient is not confirmed yet")
        open_console.host.confirmed = True
        await open_console.shows("Gestures are not armed")
        open_console.host.armed = True
        await open_console.shows("Waiting for gesture 0")
        open_console.host.send(OperatorKind.STOP)
        await open_console.shows("until the therapist acknowledges")
        open_console.host.sent.clear()
        await open_console.press("space")
        assert open_console.host.sent == []


@pytest.mark.parametrize("code", ["en", "zh"])
async def test_an_observer_s_keys_and_help_are_those_of_who_only_watches(console: Opener, code: str) -> None:
    use_language(code)
    async with console(read_only=True, size=(60, 20)) as open_console:
        bar = open_console.app.screen.query_one(KeyBar)
        await open_console.until(lambda: bar.keys)
        assert {key: does for key, _, does in bar.keys}["e"] == tr("bind.leave")
        assert not any(does == tr("bind.end") for _, _, does in bar.keys)
        await open_console.press("f1")
        await open_console.until(lambda: isinstance(open_console.app.screen, HelpPage))
        page = open_console.app.screen.query_one(Static).content
        assert tr("help.watching", **open_console.app.key_names) in str(page)
        assert tr("help.stop_elsewhere") in str(page)


async def test_a_click_on_what_happened_asks_an_observer_nothing(console: Opener) -> None:
    async with console(read_only=True, size=(120, 36)) as open_console:
        app, host = open_console.app, open_console.host
        host.send(OperatorKind.STOP)
        host.sent.clear()
        await open_console.shows("The therapist acknowledges")
        session = app.screen
        await open_console.pilot.click("#hold")
        await open_console.press("y")
        assert app.screen is session
        assert host.sent == []


async def test_the_bar_does_not_show_what_an_ended_control_said_last(console: Opener) -> None:
    async with console(read_only=True) as open_console:
        app, host = open_console.app, open_console.host
        bar = app.screen.query_one(StopBar)
        host.effect = Effect.HOLD
        await open_console.until(lambda: bar.has_class("-held"))
        host.control_ended = host.silent = True
        await open_console.until(lambda: not bar.has_class("-held"))
        assert (state := app.live_state()) is not None
        assert state.effect is Effect.HOLD


def test_a_browser_shows_the_language_in_use(home: Home) -> None:
    use_language("zh")
    assert " --language zh run --read-only " in watching_command(home)


async def test_the_page_in_a_browser_is_as_wide_as_a_phone_and_asks_for_nothing_elsewhere() -> None:
    server = browser_server("true", PORT)
    async with TestClient(TestServer(await server._make_app())) as client:
        page = await (await client.get("/")).text()
        assert 'name="viewport" content="width=device-width' in page
        linked = [link for link in re.findall(r'(?:src|href)="([^"]*)"', page) if link and not link.startswith("data:")]
        assert len(linked) == 2
        for link in linked:
            assert link.startswith(f"{server.public_url}/static/")
            assert (await client.get(link.removeprefix(server.public_url))).status == 200
