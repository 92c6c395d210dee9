"""Keys and clicks that waited while the console stood still: dropped, but for STOP; the others date their commands."""

from __future__ import annotations

import os
import pty
import threading
import time
import tty
from collections.abc import Iterator

import pytest
from textual import events
from textual.widgets import Button, Input

from app.console import session_flow, terminal_app
from app.console.app import ConsoleApp
from app.console.input_time import LATE_NS, input_time_ns, is_late, stamp
from app.console.screens.after import AfterScreen
from app.console.screens.compare import CompareScreen
from app.console.screens.dialogs import HealthPage, Question, TherapistAct
from app.console.screens.session import SessionScreen
from app.console.terminal import InputLoop
from app.control.requests import ACT_STALE_MS
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState
from app.system.config import Config
from app.text.catalogue import tr
from testing.fake_host import FakeHost, walk_steps
from testing.messages import event
from tests.app.console.conftest import Console, Opener

LATE_S = LATE_NS / 1e9 + 0.1
NEVER_LATE_S = -3600.0  # by its date it is given in an hour: however long the machine stalls, it is not too late


def give(app: ConsoleApp, message: events.Event, ago_s: float) -> int:
    """As `TerminalDriver` does, which had it so long ago; its date."""
    at_ns = time.monotonic_ns() - int(ago_s * 1e9)
    stamp(message, at_ns)
    assert app._driver is not None
    app._driver.process_message(message)
    return at_ns


def press(app: ConsoleApp, *keys: str, ago_s: float = NEVER_LATE_S) -> list[int]:
    """Give these keys; their dates, each its own."""
    return [
        give(app, events.Key(key, key if len(key) == 1 else None), ago_s - number / 1000)
        for number, key in enumerate(keys)
    ]


async def handled(open_console: Console) -> None:
    """Wait until all that was given has been handled: what comes behind it has."""
    theme = open_console.app.theme
    press(open_console.app, "f2")
    await open_console.until(lambda: open_console.app.theme != theme)
    await open_console.pilot.pause()


def notices(open_console: Console) -> int:
    return sum(note.message == tr("input.late") for note in open_console.app._notifications)


async def stands(open_console: Console) -> None:
    """With power, so that leaving and ending are asked about."""
    open_console.host.state = GaitState.STANDING
    await open_console.until(open_console.app.powered)


def test_a_key_is_late_as_control_counts_it() -> None:
    assert ACT_STALE_MS * 1_000_000 == LATE_NS
    key = events.Key("a", "a")
    assert input_time_ns(key) is None
    assert not is_late(key, LATE_NS + 1), "nobody dated it"
    stamp(key, 0)
    assert not is_late(key, LATE_NS)
    assert is_late(key, LATE_NS + 1)


@pytest.mark.parametrize(
    ("first", "late"),
    [
        ((), ("a",)),
        ((), ("c", "y")),
        ((), ("e", "y")),
        (("e",), ("y",)),
        (("t",), ("1",)),
        ((), ("t", "1")),
        (("t", "down"), ("enter",)),
        ((), ("enter",)),
        ((), ("p",)),
        ((), ("ctrl+c", "ctrl+c")),
        ((), ("ctrl+q", "ctrl+q")),
    ],
    ids=lambda keys: "-".join(keys) or "nothing",
)
async def test_what_was_pressed_while_the_console_stood_still_does_nothing(
    console: Opener, monkeypatch: pytest.MonkeyPatch, first: tuple[str, ...], late: tuple[str, ...]
) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        await stands(open_console)
        monkeypatch.setattr(terminal_app, "needs_sign_in", lambda _: True)  # as with drives that can move somebody
        await open_console.press(*first)
        screen, sent, hands = app.screen, list(host.sent), list(host.hands)
        press(app, *late, ago_s=LATE_S)
        await handled(open_console)
        assert (host.sent, host.hands, host.closed) == (sent, hands, False)
        assert app.screen is screen
        assert notices(open_console) == 1


async def test_a_stop_is_not_acknowledged_by_keys_from_before_it(console: Opener) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        host.events = (event(Event.CAMERA_STALE, Effect.NOTE),)
        await open_console.until(lambda: (state := app.live_state()) and state.events)
        press(app, "k", "y", ago_s=LATE_S)
        app.switch.takes(events.Key("space", " "))
        await handled(open_console)
        assert OperatorKind.STOP in host.kinds()
        assert OperatorKind.ACKNOWLEDGE not in host.kinds()
        assert host.effect is Effect.HOLD
        assert isinstance(app.screen, SessionScreen)


async def test_a_loop_that_stood_still_carries_out_stop_alone(console: Opener) -> None:
    """Keys come from the terminal's thread while the event loop is blocked."""
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        given, over = threading.Event(), threading.Event()

        def operator() -> None:
            for key in ("a", "c", "y"):
                give(app, events.Key(key, key), 0.0)
            app.switch.takes(events.Key("space", " "))
            given.set()
            while time.monotonic_ns() - begun_ns <= 2 * LATE_NS:
                over.wait(0.01)
            over.set()

        begun_ns = time.monotonic_ns()
        thread = threading.Thread(target=operator)
        thread.start()
        assert given.wait(60.0)
        assert host.kinds() == [OperatorKind.STOP], "at once, from the terminal's thread"
        thread.join()  # the loop has stood still since the first key
        await handled(open_console)
        assert host.kinds() == [OperatorKind.STOP]
        assert notices(open_console) == 1


@pytest.mark.parametrize(
    ("pressed_s", "released_s", "clicked"),
    [
        (NEVER_LATE_S, NEVER_LATE_S, True),
        (LATE_S, LATE_S, False),
        (LATE_S, NEVER_LATE_S, False),
        (NEVER_LATE_S, LATE_S, False),
    ],
)
async def test_a_late_click_does_nothing(console: Opener, pressed_s: float, released_s: float, clicked: bool) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("c")
        await open_console.until(lambda: isinstance(app.screen, Question) and app.screen.query(Button))
        await open_console.pilot.pause()
        x, y = app.screen.query_one("#no", Button).region.offset
        mouse = (None, x + 2, y, 0, 0, 1, False, False, False, x + 2, y)
        app._mouse_down_widget = app.screen.query_one("#no")  # clicked before, in vain
        give(app, events.MouseDown(*mouse), pressed_s)
        give(app, events.MouseUp(*mouse), released_s)
        await handled(open_console)
        assert isinstance(app.screen, Question) is not clicked
        assert notices(open_console) == (not clicked)
        assert OperatorKind.CONFIRM_PATIENT not in host.kinds()


async def test_text_for_a_field_stays_and_nothing_else(console: Opener) -> None:
    async with console(config=Config(keys={"lock": "j"})) as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("v")
        await open_console.until(lambda: isinstance(app.screen, CompareScreen) and app.screen.query("#ruler"))
        field = app.screen.query_one("#ruler", Input)
        field.focus()
        await open_console.until(lambda: app.focused is field)
        press(app, "1", "j", "2", "enter", ago_s=LATE_S)  # j would lock
        give(app, events.Paste("34"), LATE_S)
        await handled(open_console)
        assert field.value == "1234"
        assert not app.locked
        assert host.sent == []


async def test_after_the_session_keys_may_be_late(console: Opener) -> None:
    async with console() as open_console:
        app = open_console.app
        await open_console.press("e")
        await open_console.until(lambda: isinstance(app.screen, AfterScreen))
        note = app.screen.query_one("#note", Input)
        note.focus()
        await open_console.until(lambda: app.focused is note)
        press(app, "w", "e", ago_s=LATE_S)
        await handled(open_console)
        assert note.value == "we"
        assert notices(open_console) == 0


@pytest.mark.parametrize(
    ("first", "keys", "kind"),
    [
        ((), ("a",), OperatorKind.ARM),
        ((), ("c", "y"), OperatorKind.CONFIRM_PATIENT),
        ((), ("k", "y"), OperatorKind.ACKNOWLEDGE),
        ((), ("t", "1"), OperatorKind.ACT),
        ((), ("e", "y"), OperatorKind.SHUT_DOWN),
    ],
)
async def test_a_command_carries_the_moment_of_its_key(
    console: Opener, first: tuple[str, ...], keys: tuple[str, ...], kind: OperatorKind
) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        host.rests_at_once = False
        host.events = (event(Event.CAMERA_STALE, Effect.NOTE),)
        await stands(open_console)
        await open_console.until(lambda: (state := app.live_state()) and state.events)
        asks = len(keys) > 1
        *_, before_ns = press(app, *keys[:-1]) if asks else [0]
        await open_console.until(lambda: not asks or isinstance(app.screen, (Question, TherapistAct)))
        await open_console.pilot.pause()
        at_ns, _ = press(app, keys[-1], "shift+f12")  # another key on its heels
        await open_console.until(lambda: kind in host.kinds())
        assert host.input_ns[host.kinds().index(kind)] == at_ns != before_ns


async def test_an_action_from_the_list_carries_the_moment_of_enter(console: Opener) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("t", "down")
        (at_ns,) = press(app, "enter")
        await open_console.until(lambda: OperatorKind.ACT in host.kinds())
        assert host.sent == [(OperatorKind.ACT, Action.INITIALISE)]
        assert host.input_ns == [at_ns]


async def test_a_key_that_no_terminal_dated_counts_from_now(console: Opener) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        press(app, "i")
        await open_console.until(lambda: isinstance(app.screen, HealthPage))
        await open_console.press("escape", "a")
        await open_console.until(lambda: OperatorKind.ARM in host.kinds())
        assert host.input_ns == [None]


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        os.close(end)


@pytest.fixture
def loop(pipe: tuple[int, int]) -> InputLoop:
    """This thread is the input's."""
    found = InputLoop(pipe[0], lambda: None)
    found.thread = threading.get_ident()
    return found


def test_input_after_idle_turns_is_dated_by_the_newest(loop: InputLoop, pipe: tuple[int, int]) -> None:
    for _ in range(3):
        before_ns = time.monotonic_ns()
        assert not loop.is_set()
        assert before_ns <= loop.input_ns <= time.monotonic_ns()
    os.write(pipe[1], b"a")
    assert before_ns <= loop.input_ns


def test_input_that_waited_at_a_turn_is_dated_by_the_one_before(loop: InputLoop, pipe: tuple[int, int]) -> None:
    """As when the process was stopped anywhere between the two."""
    assert not loop.is_set()
    looked_ns = loop.input_ns
    os.write(pipe[1], b"a")
    assert not loop.is_set()
    assert loop.input_ns == looked_ns
    os.read(pipe[0], 1)
    between_ns = time.monotonic_ns()
    os.write(pipe[1], b"b")  # without a moment of silence, as when much is pasted
    assert not loop.is_set()
    assert looked_ns < loop.input_ns <= between_ns
    os.read(pipe[0], 1)
    assert not loop.is_set()
    assert loop.input_ns >= between_ns


def arrived(loop: InputLoop, count: int) -> None:
    """Wait until so many bytes have come through the terminal: the kernel hands them on by and by."""
    limit_s = time.monotonic() + 20.0
    while loop._waiting() < count:
        assert time.monotonic() < limit_s
        time.sleep(0.001)


def test_all_that_waited_is_old_where_it_fills_more_than_one_turn() -> None:
    """The mouse over a console that stands still: the key behind its reports was pressed long before it is read."""
    terminal, other = pty.openpty()
    try:
        tty.setraw(other)
        loop = InputLoop(other, lambda: None)
        loop.thread = threading.get_ident()
        assert not loop.is_set()
        looked_ns = loop.input_ns
        written = os.write(terminal, b"x" * 4095)
        arrived(loop, written)
        assert not loop.is_set()
        assert loop.input_ns == looked_ns
        os.read(other, 4096)
        os.write(terminal, b"a")
        arrived(loop, 1)
        assert not loop.is_set()
        assert (written, loop.input_ns) == (4095, looked_ns)
        os.read(other, 4096)
        assert not loop.is_set()
        assert loop.input_ns > looked_ns
    finally:
        os.close(terminal)
        os.close(other)


class _StepsWhileEnding(FakeHost):
    """Its last steps come with the end of its control."""

    def send(self, kind: OperatorKind, action: Action | None = None, *, input_ns: int | None = None) -> int:
        if kind is OperatorKind.SHUT_DOWN:
            walk_steps(self, 104)
        return super().send(kind, action, input_ns=input_ns)


async def test_a_console_that_stood_still_while_the_legs_came_to_rest_stores_control_s_last_figures(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_flow, "CONTROL_ENDS_S", 0.0)  # over before the next tick
    async with console(host=_StepsWhileEnding) as open_console:
        app = open_console.app
        await stands(open_console)
        walk_steps(open_console.host, 100)
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot and state.snapshot.steps == 100)
        await open_console.press("e", "y")
        await open_console.until(lambda: isinstance(app.screen, AfterScreen))
        assert isinstance(app.screen, AfterScreen)
        assert app.screen._record.steps == 104
        assert not app.switch.live, "space is for the note"
