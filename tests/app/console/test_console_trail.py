"""Whose the console's records are, and of when: of before a session, and of a takeover's beginning."""

from __future__ import annotations

import shutil
import time
from contextlib import closing
from pathlib import Path

import pytest

from app.console.operator import ConsoleTrail
from app.console.screens.session import SessionScreen
from app.console.screens.signin import SignInDialog
from app.ipc.links import OrderedReceiver, address
from app.ipc.streams import AUDIT
from app.session.host import make_setup
from app.system.config import Config, JointsConfig
from app.system.operators import Role, add_operator, load_store, save_store
from app.system.paths import Home
from logs.errors import AuditError
from logs.journal import OPERATORS
from logs.line import wall_text
from logs.read import records
from logs.records import Entry, SignIn, SignOut
from profiles.schema import DEMO_PATIENT
from tests.app.console.conftest import Console, Opener

pytestmark = pytest.mark.usefixtures("cheap_pins")
PIN = "483920"


async def test_what_was_before_a_session_is_in_the_operators_journal_as_it_was(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Bea", Role.THERAPIST, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as opened:
        await opened.shows("demo")
        await _sign_in(opened, "Ada", "f4")
        await opened.press("f4")
        await opened.until(lambda: opened.app.signed_in is None)
        signed_out_ns = time.monotonic_ns()
        await opened.press("enter")
        await opened.shows("Begin (Enter)")
        await _sign_in(opened, "Bea", "enter")
        await opened.until(lambda: isinstance(opened.app.screen, SessionScreen))
        assert opened.app.trail._waiting == []
    found = [one for one in records(home.logs / OPERATORS) if isinstance(one.body, (SignIn, SignOut))]
    assert [(type(one.body), one.operator) for one in found] == [(SignIn, ""), (SignOut, "Ada"), (SignIn, "")]
    assert [one.body.name for one in found if isinstance(one.body, SignIn)] == ["Ada", "Bea"]
    assert [one.monotonic_ns < signed_out_ns for one in found] == [True, True, False]


def test_a_record_that_waited_for_its_session_has_its_own_time_and_operator(tmp_path: Path) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    signed_in = "Ada"
    trail = ConsoleTrail(lambda: signed_in)
    with closing(OrderedReceiver(address(setup.links, AUDIT.name), Entry)) as receiver:
        before = time.time_ns(), time.monotonic_ns()
        trail.emit(SignIn(name="Tom", role="therapist", unlocked=False))
        after = time.time_ns(), time.monotonic_ns()
        signed_in = "Tom"
        trail.open(setup)
        entry = receiver.receive(60.0)
        trail.close()
    shutil.rmtree(setup.links.path)
    assert entry is not None
    assert (entry.process, entry.operator) == ("console", "Ada")
    assert before[0] <= entry.wall_ns <= after[0]
    assert before[1] <= entry.monotonic_ns <= after[1]


def test_what_the_journal_refuses_is_kept_the_next_time(tmp_path: Path) -> None:
    home = Home(tmp_path)
    trail = ConsoleTrail(lambda: "Ada")
    trail.emit(SignOut(name="Ada", reason="signed out"))
    (made,) = trail._waiting
    (home.logs / OPERATORS).mkdir(parents=True)
    with pytest.raises(AuditError):
        trail.keep(home)
    (home.logs / OPERATORS).rmdir()
    trail.keep(home)
    trail.keep(home)
    (kept,) = (one for one in records(home.logs / OPERATORS) if isinstance(one.body, SignOut))
    assert (kept.operator, kept.monotonic_ns, kept.wall) == ("Ada", made.monotonic_ns, wall_text(made.wall_ns))


async def _sign_in(opened: Console, name: str, key: str) -> None:
    await opened.press(key)
    await opened.until(lambda: isinstance(opened.app.screen, SignInDialog))
    await opened.sign_in(name, PIN)
    await opened.until(lambda: opened.app.operator == name)
