"""Who may move legs: sign-in, lock and sign-out, over the host we own."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
from textual import events
from textual.widgets import Input

from app.console.screens.after import AfterScreen
from app.console.screens.help import HelpPage
from app.console.screens.patient_form import PatientForm
from app.console.screens.patients import PatientsScreen
from app.console.screens.session import SessionScreen
from app.console.screens.signin import SignInDialog
from app.ipc.messages import OperatorKind
from app.system.config import Config, JointsConfig
from app.system.operators import Role, add_operator, load_store, save_store
from app.system.paths import Home
from app.system.sign_in import SignInResult, try_pin
from logs.journal import CHANGES, OPERATORS
from logs.read import records
from logs.records import SignIn, SignInFailed
from testing.authors import signed_in
from tests.app.console.conftest import Console, Opener

pytestmark = pytest.mark.usefixtures("cheap_pins")
PIN = "483920"


async def test_real_joints_need_a_sign_in_and_a_second_ctrl_c(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Rex", Role.REVIEWER, PIN))
    config = Config(joints=JointsConfig(kind="can"))
    async with console(profile=None, config=config) as open_console:
        await _begin_as(open_console, "Ada", "000111")
        await open_console.shows("Name or PIN is wrong")
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        assert open_console.app.operator == "Ada"
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.snapshot)
        await open_console.press("t", "0")
        await open_console.shows("standing")
        await open_console.press("ctrl+c")
        await open_console.shows("Quit while the joints are powered?")
        assert not open_console.host.closed
        await open_console.press("ctrl+c")
        await open_console.until(lambda: open_console.host.closed)


async def test_a_reviewer_may_not_move_anybody(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Rex", Role.REVIEWER, PIN))
    config = Config(joints=JointsConfig(kind="can"), keys={"sign_out": "f9"})
    async with console(profile=None, config=config) as open_console:
        await _begin_as(open_console, "Rex", PIN)
        await open_console.tells("The role reviewer may not move a patient. Outside a session f9 signs out")
        assert open_console.app.live is None


async def test_a_reviewer_signs_in_by_key_and_changes_no_patient(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Rex", Role.REVIEWER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        await open_console.press("f4")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.sign_in("Rex", PIN)
        await open_console.shows("Rex, reviewer")
        await open_console.press("n")
        await open_console.tells("may not create or change patients")
        await open_console.press("c")
        await open_console.tells("may not calibrate")
        assert isinstance(open_console.app.screen, PatientsScreen)
        open_console.app.trail.keep(home)
    (signed_in,) = (one.body for one in records(home.logs / OPERATORS) if isinstance(one.body, SignIn))
    assert signed_in == SignIn(name="Rex", role="reviewer", unlocked=False)


async def test_who_can_not_sign_in_or_out_here_is_told_where(console: Opener, home: Home) -> None:
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        await open_console.press("n")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.press("f4")
        await open_console.tells("sign in from the list of patients")
        await open_console.press("escape")
        await _begin_as(open_console, "Ada", PIN)
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.snapshot)
        await open_console.press("e")
        await open_console.until(lambda: isinstance(open_console.app.screen, AfterScreen))
        await open_console.press("f4")
        await open_console.tells("save note and ratings (Ctrl-S), then sign out")


async def test_a_patient_is_changed_by_who_signs_in_for_it(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Ben", Role.THERAPIST, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        await open_console.press("e")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.sign_in("Ben", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientForm))
        assert open_console.app.operator == "Ben"
        await open_console.until(lambda: (field := open_console.app.focused) and field.id == "stature_m")


async def test_who_only_watches_signs_nobody_in(console: Opener) -> None:
    config = Config(joints=JointsConfig(kind="can"))
    async with console(config=config, read_only=True) as open_console:
        assert isinstance(open_console.app.screen, SessionScreen)
        await open_console.press("f4")
        await open_console.tells("needs no sign-in")


async def test_a_locked_console_opens_with_the_operators_pin_only(console: Opener, home: Home) -> None:
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await _begin_as(open_console, "Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        await open_console.press("ctrl+l")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.press("escape")
        assert isinstance(open_console.app.screen, SignInDialog)
        await open_console.press("space")
        await open_console.until(lambda: OperatorKind.STOP in open_console.host.kinds())
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))


async def test_the_next_therapist_signs_in_without_leaving_the_program(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Ben", Role.THERAPIST, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        await _begin_as(open_console, "Ada", PIN)
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.snapshot)
        await open_console.press("f4")
        await open_console.tells("The session is Ada's")
        await open_console.app.close_session()
        await open_console.press("f4")
        await open_console.tells("Ada is signed out")
        await _begin_as(open_console, "Ben", PIN)
        await open_console.until(lambda: open_console.app.operator == "Ben")


async def test_simulation_without_operators_signs_nobody_in(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("f4")
        await open_console.tells("Nobody is signed in")


async def test_no_palette_opens_where_a_pin_is_asked_for(console: Opener, home: Home) -> None:
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await _choose_and_begin(open_console)
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.press("ctrl+p")
        assert isinstance(open_console.app.screen, SignInDialog)
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        await open_console.press("ctrl+l", "ctrl+p")
        assert isinstance(open_console.app.screen, SignInDialog)


async def test_a_lock_outlasts_the_session_and_asks_for_the_same_pin(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Rex", Role.REVIEWER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        app = open_console.app
        await _begin_as(open_console, "Ada", PIN)
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot)
        open_console.host.rests_at_once = False
        await open_console.press("e", "ctrl+l")
        open_console.host.control_ended = True
        await open_console.until(lambda: any(isinstance(screen, AfterScreen) for screen in app.screen_stack))
        assert isinstance(app.screen, SignInDialog)
        await open_console.until(lambda: app.screen.query("#pin"))
        await open_console.press("escape")
        await open_console.sign_in("Rex", PIN)
        await open_console.shows("Ada locked")
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(app.screen, AfterScreen))
        await open_console.press("ctrl+l")
        await app.close_session()  # as after saving, which takes seconds
        assert isinstance(app.screen, SignInDialog)
        await open_console.until(lambda: app.screen.query("#pin"))
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))


@pytest.mark.parametrize("asked_before", [False, True], ids=["", "asked while the legs came to rest"])
async def test_ctrl_c_after_a_session_over_real_joints_keeps_the_note_or_asks(
    console: Opener, home: Home, asked_before: bool
) -> None:
    """What control said last, that the joints are powered, does not count any more."""
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    in_the_way = home.root / "sessions"
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        app = open_console.app
        await _begin_as(open_console, "Ada", PIN)
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot)
        await open_console.press("t", "0")
        await open_console.shows("standing")
        open_console.host.rests_at_once = False
        await open_console.press("e", "y")
        if asked_before:
            await open_console.press("ctrl+c")
            await open_console.shows("Quit while the joints are powered?")
        open_console.host.control_ended = True
        await open_console.shows("After the session")
        open_console.type("note", "tired")
        in_the_way.write_text("a file where the folder should be")
        await open_console.press("ctrl+c")
        await open_console.shows("Leave without saving?")
        await open_console.press("n")
        in_the_way.unlink()
        await open_console.press("ctrl+c")
        await open_console.until(lambda: app._exit)
        assert [record.note for record in app.sessions.of("demo")] == ["tired"]


async def test_nobody_elses_pin_opens_a_locked_console_but_it_can_be_signed_out(console: Opener, home: Home) -> None:
    store = add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN)
    save_store(home.keys, add_operator(store, "Rex", Role.REVIEWER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await _begin_as(open_console, "Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        await open_console.press("ctrl+l")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.sign_in("Rex", PIN)
        await open_console.shows("Ada locked")
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        await open_console.app.close_session()
        await open_console.press("ctrl+l")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.press("f4")
        await open_console.until(lambda: not isinstance(open_console.app.screen, SignInDialog))
        assert open_console.app.signed_in is None


async def test_a_pin_that_is_entered_twice_signs_in_once(console: Opener, home: Home) -> None:
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        app = open_console.app
        await open_console.shows("demo")
        await open_console.press("f4")
        await open_console.until(lambda: isinstance(app.screen, SignInDialog) and app.screen.composed)
        open_console.type("name", "Ada")
        open_console.type("pin", PIN)
        app.screen.query_one("#pin").focus()
        for _ in range(2):  # both are there before the first is handled
            app.post_message(events.Key("enter", None))
        await open_console.shows("Ada, engineer")
        await open_console.press("h")
        await open_console.shows("No changes recorded.")
        assert isinstance(app.screen_stack[-2], PatientsScreen)
    tried = [one.body for one in app.trail._waiting if isinstance(one.body, (SignIn, SignInFailed))]
    assert tried == [SignIn(name="Ada", role="engineer", unlocked=False)]


async def test_help_that_opens_while_a_pin_is_tried_does_not_keep_the_console_locked(
    console: Opener, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    asked, answered = threading.Event(), threading.Event()

    def slow(*given: Any) -> SignInResult:
        asked.set()
        assert answered.wait(20)
        return try_pin(*given)

    monkeypatch.setattr("app.console.screens.signin.try_pin", slow)
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        app = open_console.app
        await open_console.shows("demo")
        app.signed_in = signed_in(home)
        await open_console.press("ctrl+l")
        await open_console.until(lambda: isinstance(app.screen, SignInDialog) and app.screen.composed)
        lock = app.screen
        open_console.type("pin", PIN)
        lock.query_one("#pin").focus()
        app.post_message(events.Key("enter", None))  # the pilot would wait for the answer
        assert await asyncio.to_thread(asked.wait, 20)
        app.post_message(events.Key("f1", None))
        async with asyncio.timeout(20):
            while not isinstance(app.screen, HelpPage):
                await asyncio.sleep(0.01)
        answered.set()
        await open_console.until(lambda: [one for one in app.trail._waiting if isinstance(one.body, SignIn)])
        assert lock in app.screen_stack
        await open_console.press("escape")
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))


async def test_a_journal_that_can_t_be_written_is_told_where_the_pin_is_asked_for(console: Opener, home: Home) -> None:
    (home.logs / CHANGES).mkdir(parents=True)
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        await open_console.press("f4")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await open_console.sign_in("Ada", PIN)
        await open_console.shows("✗ The journal")  # its path is broken anywhere
        assert isinstance(open_console.app.screen, SignInDialog)
        (home.logs / CHANGES).rmdir()
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientsScreen))


async def test_a_console_that_is_locked_while_a_session_is_prepared_stays_locked(
    console: Opener, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other computer's answer may take two seconds."""
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    asked, answered = threading.Event(), threading.Event()

    def slow(*_: object) -> None:
        asked.set()
        assert answered.wait(20)

    monkeypatch.setattr("app.link.questions.require_joints", slow)
    async with console(profile=None, config=Config(joints=JointsConfig(host="exo.local"))) as open_console:
        app = open_console.app
        app.signed_in = signed_in(home)
        await open_console.shows("demo")
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        app.post_message(events.Key("enter", None))  # the pilot would wait for the answer
        assert await asyncio.to_thread(asked.wait, 20)
        app.post_message(events.Key("ctrl+l", None))
        async with asyncio.timeout(20):
            while not isinstance(app.screen, SignInDialog):
                await asyncio.sleep(0.01)
        answered.set()
        await open_console.until(lambda: any(isinstance(screen, SessionScreen) for screen in app.screen_stack))
        assert [type(screen) for screen in app.screen_stack[-2:]] == [SessionScreen, SignInDialog]
        await open_console.until(lambda: app.screen.query("#pin"))
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(app.screen, SessionScreen))
        await open_console.press("ctrl+l")
        assert isinstance(app.screen, SignInDialog), "the session can be locked again"


@pytest.mark.parametrize("locked", [False, True])
async def test_signing_out_asks_before_it_drops_what_was_typed(console: Opener, home: Home, locked: bool) -> None:
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        app = open_console.app
        await open_console.shows("demo")
        app.signed_in = signed_in(home, Role.THERAPIST)
        await open_console.press("n")
        await open_console.until(lambda: isinstance(app.screen, PatientForm) and app.screen.composed)
        form = app.screen
        open_console.type("identifier", "P-7")
        await open_console.until(lambda: not form.keep())  # type: ignore[attr-defined]
        await open_console.press(*(("ctrl+l",) if locked else ()))
        below = app.screen
        await open_console.press("f4", "f4")
        await open_console.shows("Leave without saving?")
        await open_console.press("n")
        await open_console.until(lambda: app.screen is below)
        assert app.operator == "Ada"
        assert form.query_one("#identifier", Input).value == "P-7"
        await open_console.press("f4")
        await open_console.shows("Leave without saving?")
        await open_console.press("y")
        await open_console.tells("Ada is signed out")
        assert isinstance(app.screen, PatientsScreen)


async def test_the_first_run_sets_up_its_engineer(console: Opener, home: Home) -> None:
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await _choose_and_begin(open_console)
        await open_console.shows("set up the engineer")
        await open_console.sign_in("Ada", "123456")
        await open_console.shows("easily guessed")
        await open_console.sign_in("Ada", PIN)
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        assert load_store(home.keys).find("ada")


async def _choose_and_begin(open_console: Console) -> None:
    await open_console.shows("demo")
    await open_console.press("enter")
    await open_console.shows("Begin (Enter)")
    await open_console.press("enter")


async def _begin_as(open_console: Console, name: str, pin: str) -> None:
    await _choose_and_begin(open_console)
    await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
    await open_console.sign_in(name, pin)
