"""A held session in another terminal: who may take it over, and what that leaves untouched; over the host we own."""

from __future__ import annotations

import os
import threading
from dataclasses import replace

import msgspec
import pytest

from app.console.app import ConsoleApp
from app.console.run import run_console
from app.console.screens.patients import PatientsScreen
from app.console.screens.session import SessionScreen
from app.console.screens.signin import SignInDialog
from app.console.screens.start import StartSession
from app.ipc.messages import OperatorKind
from app.link.wire import LinkFault
from app.session.setup import make_setup
from app.session.shared import current_lease, share, take_lease, unshare
from app.system.config import Config, JointsConfig, Purpose, SessionSetup
from app.system.errors import AppError
from app.system.operators import Role, add_operator, load_store, may_take_over, save_store
from app.system.paths import Home
from app.text.catalogue import tr
from logs.journal import OPERATORS
from logs.read import records
from logs.records import SignInFailed
from profiles.schema import DEMO_PATIENT
from testing.authors import signed_in
from testing.fake_host import FakeHost
from tests.app.console.conftest import LIMIT_S, Opener

pytestmark = pytest.mark.usefixtures("cheap_pins")
PIN, OTHER = "483920", "592817"


@pytest.fixture
def held(home: Home) -> SessionSetup:
    """Of the engineer Ada, over real drives; there is a therapist Tom, an engineer Eve and a reviewer Rex."""
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    for name, role in (("Tom", Role.THERAPIST), ("Eve", Role.ENGINEER), ("Rex", Role.REVIEWER)):
        store = add_operator(store, name, role, OTHER)
    save_store(home.keys, store)
    return make_setup(home, Config(joints=JointsConfig(kind="can")), DEMO_PATIENT, signed_in(home))


def test_only_the_same_operator_and_therapists_may(held: SessionSetup, home: Home) -> None:
    may = {one.name for one in load_store(home.keys).operators if may_take_over(one, held.operator)}
    assert may == {"Ada", "Tom"}


@pytest.mark.parametrize("size", [(80, 24), (20, 5)])
async def test_the_same_operator_takes_over_by_the_pin_alone(
    console: Opener, held: SessionSetup, size: tuple[int, int]
) -> None:
    async with console(held=held, config=held.config, profile=None, size=size) as open_console:
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.press("space")
        assert open_console.host.sent == [(OperatorKind.STOP, None)], "everybody may stop"
        await open_console.press(*"000111", "enter")
        await open_console.shows("wrong.")
        open_console.type("name", "Rex")
        await open_console.press(*OTHER, "enter")
        await open_console.shows("take over." if size[0] > 20 else "over.")
        open_console.type("name", "Ada")
        await open_console.press(*PIN[:3])
        await open_console.shows("•••")
        await open_console.press(*PIN[3:], "enter")
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.snapshot)
        assert open_console.app.live_setup().session == held.session
        assert open_console.app.operator == "Ada"
        await open_console.press("space")
        await open_console.until(lambda: (OperatorKind.STOP, None) in open_console.host.sent)


@pytest.mark.parametrize(
    ("name", "pin", "told"),
    [
        ("Ada", "000111", "Name or PIN is wrong"),
        ("Rex", OTHER, "Only Ada or a therapist can take over"),
        ("Eve", OTHER, "Only Ada or a therapist can take over"),
    ],
)
async def test_others_read_one_sentence_and_touch_nothing_and_a_therapist_takes_over(
    console: Opener, held: SessionSetup, name: str, pin: str, told: str
) -> None:
    async with console(held=held, config=held.config, profile=None) as open_console:
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        open_console.type("name", name)
        open_console.type("pin", pin)
        await open_console.press("enter")
        await open_console.shows(told)
        assert not open_console.host.started
        assert {kind for kind, _ in open_console.host.sent} <= {OperatorKind.STOP}
        open_console.type("name", "Tom")
        open_console.type("pin", OTHER)
        await open_console.press("enter")
        await open_console.until(lambda: open_console.host.started)
        assert open_console.app.live_setup().operator == "Tom"


async def test_who_leaves_the_question_leaves_the_session_held(console: Opener, held: SessionSetup, home: Home) -> None:
    async with console(held=held, config=held.config, profile=None) as open_console:
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.press(*"000111", "enter")
        await open_console.shows("Name or PIN is wrong")
        await open_console.press("escape")
        await open_console.until(lambda: not open_console.app.is_running or open_console.app._exit)
        assert not open_console.host.started
    open_console.app.trail.keep(home)
    assert any(isinstance(one.body, SignInFailed) for one in records(home.logs / OPERATORS))


async def test_a_session_that_is_taken_over_counts_its_time_from_its_own_begin(
    console: Opener, held: SessionSetup, home: Home
) -> None:
    simulated = msgspec.structs.replace(held, config=Config(), began_ns=held.began_ns - 600_000_000_000)
    async with console(held=simulated, profile=None) as open_console:
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.snapshot)
        state = open_console.app.live_state()
        assert state is not None
        assert replace(state, now_ns=state.started_ns).starting, "this console has only begun"
        await open_console.press("e")
        await open_console.shows("After the session")
        await open_console.press("ctrl+s")
        await open_console.until(lambda: open_console.host.closed)
    (record,) = open_console.app.sessions.of("demo")
    assert 600 <= record.duration_s < 600 + LIMIT_S


class _SlowHost(FakeHost):
    """Ends only when it may."""

    may_end = threading.Event()

    def close(self) -> None:
        assert self.may_end.wait(LIMIT_S)
        super().close()


@pytest.mark.parametrize(("purpose", "key"), [("training", "t"), ("enrolment", "g")])
async def test_a_held_training_or_enrolment_is_ended_and_never_armed(
    console: Opener, held: SessionSetup, home: Home, purpose: Purpose, key: str
) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        open_console.app.signed_in = signed_in(home, Role.THERAPIST)
        await open_console.press(key)
        await open_console.until(lambda: open_console.app.live is not None)
        setup = open_console.app.live_setup()
    assert setup.purpose == purpose
    _SlowHost.may_end.clear()
    running = msgspec.structs.replace(setup, host_pid=os.getpid())
    async with console(held=running, host=_SlowHost) as open_console:
        app = open_console.app
        await open_console.tells("being ended")
        await open_console.shows("demo")
        assert isinstance(app.screen, PatientsScreen)
        await open_console.press("enter")
        await open_console.until(lambda: isinstance(app.screen, StartSession))
        app.clear_notifications()
        await open_console.press("enter")
        await open_console.tells("being ended")
        assert (len(open_console.hosts), open_console.host.closed) == (1, False), "nothing has begun"
        app.clear_notifications()
        await app.calibrate(setup.profile)
        await open_console.tells("being ended")
        assert type(app.screen).__name__ == "StartSession", "the camera is not free yet"
        _SlowHost.may_end.set()
        await open_console.until(lambda: open_console.host.closed and not app._notifications)
        assert open_console.host.started
        assert OperatorKind.ARM not in open_console.host.kinds()
        assert app.live is None
        assert app.sessions.of("demo") == ()
        await open_console.press("ctrl+s")
        await open_console.until(lambda: isinstance(app.screen, SessionScreen))


def test_who_leaves_before_the_takeover_is_done_reads_that_the_session_stays(
    held: SessionSetup, home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    running = msgspec.structs.replace(held, host_pid=os.getpid())
    first = take_lease(running.links)
    monkeypatch.setattr("app.console.run.held_session", lambda _: running)
    monkeypatch.setattr("app.console.run.set_scheduling", lambda _: True)
    shown: list[Config] = []

    def leave(app: ConsoleApp) -> None:  # Ctrl-Q before anything else
        app._live_of(running)
        shown.append(app.config)

    monkeypatch.setattr(ConsoleApp, "run", leave)
    run_console(home, Config())
    assert shown == [Config()], "what was chosen for the held session is for that one alone"
    assert current_lease(running.links) == first
    reported = capsys.readouterr().err
    assert "`rleex run` takes it over" in reported
    assert "120 seconds" in reported


@pytest.mark.parametrize("left_on", [True, False])
def test_who_leaves_legs_that_may_be_held_reads_it_in_the_terminal(
    home: Home, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], left_on: bool
) -> None:
    monkeypatch.setattr("app.console.run.set_scheduling", lambda _: True)
    monkeypatch.setattr(ConsoleApp, "run", lambda app: setattr(app.switch, "left_on", left_on))
    run_console(home, Config())
    assert (tr("stop.left_on") in capsys.readouterr().err) is left_on


def test_a_session_that_is_held_for_a_laptop_is_left_to_rleex_joints(
    held: SessionSetup, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Control numbers leases as `rleex joints` does, ahead of the file from which a console takes the next."""
    running = msgspec.structs.replace(held, host_pid=os.getpid(), linked=True)
    first = take_lease(running.links)
    share(running)
    monkeypatch.setattr(ConsoleApp, "run", lambda _: None)
    with pytest.raises(AppError) as refused:
        run_console(home, Config())
    unshare(running)
    assert (refused.value.code, refused.value.values) == (LinkFault.HELD_FOR_LAPTOP, {"session": held.session})
    assert current_lease(running.links) == first
