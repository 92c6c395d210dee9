"""Whose the console's records are, and of when: of before a session, and of a takeover's beginning."""

from __future__ import annotations

import asyncio
import shutil
import threading
import time
from contextlib import closing
from pathlib import Path

import pytest

from app.console.operator import ConsoleTrail
from app.console.screens.session import SessionScreen
from app.console.screens.signin import SignInDialog
from app.ipc.links import OrderedReceiver, address
from app.ipc.streams import AUDIT
from app.session.setup import make_setup
from app.system.config import Config, JointsConfig
from app.system.operators import Role, add_operator, load_store, save_store
from app.system.paths import Home
from logs.errors import AuditError
from logs.journal import OPERATORS
from logs.keys import ANCHOR_FOLDER, by_fingerprint, load_or_make_key
from logs.line import wall_text
from logs.read import records
from logs.records import Checkpoint, Entry, SignIn, SignOut
from logs.verify import Evidence, Status, verify
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
    assert [(type(one.body), one.operator) for one in found] == [(SignIn, "Ada"), (SignOut, "Ada"), (SignIn, "Bea")]
    assert [one.body.name for one in found if isinstance(one.body, SignIn)] == ["Ada", "Bea"]
    assert [one.monotonic_ns < signed_out_ns for one in found] == [True, True, False]


def test_a_record_that_waited_for_its_session_has_its_own_time_and_operator(tmp_path: Path) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    signed_in = "Ada"
    trail = ConsoleTrail(lambda: signed_in)
    with closing(OrderedReceiver(address(setup.links, AUDIT.name), Entry)) as receiver:
        before = time.time_ns(), time.monotonic_ns()
        trail.emit(SignOut(name="Ada", reason="signed out"))
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


def test_what_waits_is_kept_in_one_piece_each_with_its_own_time_and_operator(tmp_path: Path) -> None:
    home = Home(tmp_path)
    signed_in = "Ada"
    trail = ConsoleTrail(lambda: signed_in)
    trail.emit(SignOut(name="Ada", reason="locked"))
    trail.emit(SignOut(name="Ada", reason="locked"))
    signed_in = ""
    trail.emit(SignIn(name="Bea", role="therapist"))
    made = [(one.wall_ns, one.monotonic_ns) for one in trail._waiting]
    trail.keep(home)
    *kept, seal = records(home.logs / OPERATORS)
    assert [one.operator for one in kept] == ["Ada", "Ada", "Bea"]
    assert [(one.wall, one.monotonic_ns) for one in kept] == [(wall_text(wall), ns) for wall, ns in made]
    assert isinstance(seal.body, Checkpoint)
    assert seal.monotonic_ns > kept[-1].monotonic_ns
    (finding,) = verify([home.logs / OPERATORS], Evidence(keys=by_fingerprint([load_or_make_key(home.keys).public])))
    assert finding.status is Status.SOUND


def test_what_stands_in_the_journal_without_its_anchor_is_not_written_again(tmp_path: Path) -> None:
    home = Home(tmp_path)
    in_the_way = load_or_make_key(home.keys).folder / ANCHOR_FOLDER
    in_the_way.write_bytes(b"a file where the folder should be")
    trail = ConsoleTrail(lambda: "Ada")
    trail.emit(SignOut(name="Ada", reason="first"))
    with pytest.raises(AuditError, match="ANCHOR_NOT_WRITTEN"):
        trail.keep(home)
    in_the_way.unlink()
    trail.emit(SignOut(name="Ada", reason="second"))
    trail.keep(home)
    kept = [one.body.reason for one in records(home.logs / OPERATORS) if isinstance(one.body, SignOut)]
    assert kept == ["first", "second"]


class _SlowTrail(ConsoleTrail):
    """Whose journal is busy until it may be written."""

    may_keep = threading.Event()

    def keep(self, home: Home) -> None:
        assert self.may_keep.wait(10.0)
        super().keep(home)


async def test_the_console_goes_on_while_the_journal_is_written(console: Opener, home: Home) -> None:
    async with console(profile=None) as opened:
        await opened.shows("demo")
        _SlowTrail.may_keep.clear()
        trail = opened.app.trail = _SlowTrail(lambda: "Ada")
        trail.emit(SignOut(name="Ada", reason="first"))
        begun = [asyncio.create_task(opened.app.begin_session(DEMO_PATIENT, Config())) for _ in range(2)]
        await opened.pilot.pause()
        trail.emit(SignOut(name="Ada", reason="second"))
        trail.may_keep.set()
        await asyncio.gather(*begun)
        assert len(opened.hosts) == 1, "the second one finds the session of the first"
        kept = [one.body.reason for one in records(home.logs / OPERATORS) if isinstance(one.body, SignOut)]
        assert kept[0] == "first"
        assert kept.count("first") == 1


async def _sign_in(opened: Console, name: str, key: str) -> None:
    await opened.press(key)
    await opened.until(lambda: isinstance(opened.app.screen, SignInDialog))
    await opened.sign_in(name, PIN)
    await opened.until(lambda: opened.app.operator == name)
