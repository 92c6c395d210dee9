"""A session in lines: what is said of each change, once, and the command that says it."""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from app.cli.tree import command
from app.console.spoken import changes
from app.console.state import SessionState, fold
from app.ipc import streams
from app.ipc.links import Publisher, address, new_link_directory
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ActionReport
from app.ipc.states import Action, Effect, Event, GaitState, Outcome, Source
from app.ipc.streams import LinkDirectory
from app.session.setup import make_setup
from app.session.shared import share
from app.system.config import Config, SessionSetup
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import use_language
from kgdfa.gesture import Gesture
from profiles.schema import DEMO_PATIENT
from testing.authors import signed_in
from testing.fake_host import FakeHost
from testing.messages import event
from tests.app.console.test_sizes import READY

NOW_NS = 1_000_000_000_000
LATIN = re.compile("[A-Za-z]{3,}")


class Told:
    """A session with a host we own, and what was said of it."""

    def __init__(self) -> None:
        links = LinkDirectory(path=Path(), public=b"", secret=b"")
        setup = SessionSetup(
            session="S", home=Path(), links=links, config=Config(), profile=DEMO_PATIENT, operator="therapist"
        )
        self.host = FakeHost(setup, clock=lambda: NOW_NS)
        self.state: SessionState | None = None
        self.empty = SessionState(setup=setup, started_ns=NOW_NS, now_ns=NOW_NS)

    def hear(self, **snapshot: object) -> tuple[str, ...]:
        """The lines since the last time."""
        before, now = self.state, fold(self.state or self.empty, self.host.poll(), NOW_NS)
        if now.snapshot is not None and snapshot:
            now = replace(now, snapshot=msgspec.structs.replace(now.snapshot, **snapshot))
        self.state = now
        return changes(before, now)


def test_a_session_is_told_from_its_start_to_a_stop_and_on() -> None:
    told = Told()
    assert told.hear() == ("The session starts …",)
    told.host.start()
    assert told.hear() == (
        "The patient is not confirmed yet. Nothing moves.",
        "Gestures not armed.",
        "Legs: unpowered.",
    )
    assert told.hear() == ()
    told.host.confirmed = told.host.armed = True
    told.host.state = GaitState.STANDING
    armed = told.hear()
    assert armed[:2] == ("Gestures armed.", "Legs: standing.")
    assert armed[2].startswith("Gestures that act now: 1 step, right first, 5 walk, 7 climb stair")
    told.host.gesture = Gesture.FIVE
    assert told.hear() == ("Gesture 5.",)
    told.host.pressed = True
    assert told.hear() == ("Button pressed.",)
    told.host.pressed = False
    assert told.hear() == ()
    told.host.send(OperatorKind.STOP)
    stopped = told.hear()
    assert stopped[0] == "Legs held, gestures blocked until the therapist acknowledges."
    assert stopped[1].startswith("hold: STOP")
    told.host.send(OperatorKind.ACKNOWLEDGE)
    assert "Acknowledged." in told.hear()


def test_an_action_is_told_with_its_outcome() -> None:
    told = Told()
    told.host.start()
    told.hear()
    assert "walk begins." in told.hear(action=Action.WALK)
    report = ActionReport(
        number=1, action=Action.WALK, source=Source.GESTURE, from_state=GaitState.STANDING, outcome=Outcome.STOPPED
    )
    assert "walk: stopped." in told.hear(reports=(report,))


def test_what_goes_by_itself_is_told_when_it_is_over() -> None:
    told = Told()
    told.host.start()
    told.host.events = (event(Event.OVER_TEMPERATURE_WARNING, Effect.NOTE, temperature_c=61.0),)
    assert any("61 °C" in line for line in told.hear())
    told.host.events = ()
    (over,) = told.hear()
    assert over.startswith("Over: ")


@pytest.fixture
def chinese() -> Iterator[None]:
    """For one test."""
    use_language("zh")
    yield
    use_language("en")


@pytest.mark.usefixtures("chinese")
def test_it_is_told_in_chinese() -> None:
    told = Told()
    told.host.start()
    told.host.gesture = Gesture.FIVE
    told.host.confirmed = told.host.armed = True
    lines = told.hear()
    assert lines
    assert [line for line in lines if LATIN.search(line.replace("love", ""))] == []


class Output(io.StringIO):
    """Standard output that ends the session once the legs are said to stand."""

    def __init__(self, links: Path) -> None:
        super().__init__()
        self._links = links

    def write(self, text: str) -> int:
        if "Legs: standing." in text:
            shutil.rmtree(self._links)
        return super().write(text)


def test_the_command_follows_a_running_session_to_its_end(
    home: Home, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = make_setup(home, Config(), DEMO_PATIENT, signed_in(home))
    made.links.path.rmdir()
    (tmp_path / "links").mkdir()
    setup = msgspec.structs.replace(made, links=new_link_directory(tmp_path / "links"), host_pid=os.getpid())
    share(setup)
    publisher, over = Publisher(address(setup.links, streams.SNAPSHOT.name)), threading.Event()

    def publish() -> None:
        assert READY.snapshot is not None
        while not over.wait(0.05):
            publisher.send(READY.snapshot)

    sender = threading.Thread(target=publish)
    sender.start()
    output = Output(setup.links.path)
    monkeypatch.setattr(sys, "stdout", output)
    try:
        command().main(["run", "--plain", "--home", str(home.root)], standalone_mode=False)
    finally:
        over.set()
        sender.join()
        publisher.close()
    text = output.getvalue()
    assert "Gestures armed.\nLegs: standing.\n" in text
    assert text.endswith("The session has ended.\n")
    assert "\x1b" not in text


def test_without_a_session_the_command_says_so(home: Home) -> None:
    with pytest.raises(AppError, match="NO_SESSION_TO_WATCH"):
        command().main(["run", "--plain", "--home", str(home.root)], standalone_mode=False)
