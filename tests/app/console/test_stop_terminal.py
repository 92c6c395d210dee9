"""A real terminal at its worst: the event loop is stuck, nobody reads, it is closed, the console is asked to end.

STOP must reach control, and the console must be gone within two seconds.
"""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from app.console.input_time import LATE_NS
from app.console.terminal_output import FRAME_TIMEOUT_S, TerminalOutput
from app.ipc.states import ConsoleChange
from app.session.shared import held_session, shared
from app.system.config import Config
from app.system.hand_model import find_model
from app.system.paths import Home, find_home, hold_home
from logs.read import read, records, session_paths
from logs.reason import Reason, key_of
from logs.records import Note, ProcessEnd, Record, SessionEnd, Stop

pytestmark = pytest.mark.serial

BEGIN = """
import fcntl, sys, termios, time
from pathlib import Path
from app.console.app import ConsoleApp
from app.ipc.messages import OperatorKind
from app.system.config import CameraConfig, Config
from app.system.paths import Home, hold_home
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost
from testing.session import control_core_of_worker

home, report = Home(Path(sys.argv[1])), Path(sys.argv[2])
beat = ConsoleApp._tick
"""
FAKE = """
class Reporting(FakeHost):
    def send(self, kind, action=None, *, input_ns=None):
        with report.open("a") as file:
            file.write(kind.name + " ")
        return super().send(kind, action, input_ns=input_ns)

    def heartbeat(self):
        report.with_suffix(".alive").touch()
        super().heartbeat()

def run():
    with hold_home(home):
        app = ConsoleApp(home, Config(), profile=DEMO_PATIENT, make_host=Reporting)
        app.run()
"""
REAL = """
from app.console.run import run_console

def run():
    camera, core = CameraConfig(rate_hz=15.0), control_core_of_worker()
    with hold_home(home):
        run_console(
            home, Config(camera=camera, control_core=core, idle_lock_s=0, model=sys.argv[3]), straight=True
        )
"""
STUCK = """
def stick(self):
    beat(self)
    if self.live and self.live.state.snapshot:
        report.with_suffix(".begun").touch()
        while not (ends and report.exists()):
            time.sleep(0.01)
        self.exit()

ConsoleApp._tick = stick
"""
RUNNING = """
def busy(self):
    beat(self)
    if self.live and self.live.state.snapshot and self.live.state.report:
        report.with_suffix(".begun").touch()
        self.sub_title = str(time.monotonic())
        self.screen.refresh()  # a whole screen at every beat

ConsoleApp._tick = busy
"""
FAILING = """
from app.console.run import run_console

class Left(FakeHost):
    def leave(self):
        report.write_text("left")

    def close(self):
        report.write_text("closed")
        super().close()

def run():
    ConsoleApp.__init__.__kwdefaults__["make_host"] = Left
    with hold_home(home):
        run_console(home, Config(), straight=True)

def fail(self):
    beat(self)
    if self.live and self.live.state.snapshot:
        raise RuntimeError

ConsoleApp._tick = fail
"""
RUN = """
if __name__ == "__main__":  # the session's processes load this file again
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    run()
"""
LIMIT_S = 90.0  # seven interpreters and the hand model, on a machine that tests other things too
GONE_S = 2.0
AGAIN_S = 3.0
ENDED_S = 20.0  # control's and the trail's own end, on a busy machine


class TerminalUnderTest:
    """A console in a pseudo terminal of its own, whose other side is ours to read, to leave, or to close."""

    def __init__(self, folder: Path, program: str) -> None:
        self.report = folder / "report"
        self.home = Home(folder / "home")
        self._master, theirs = pty.openpty()
        termios.tcsetwinsize(theirs, (24, 80))
        script = folder / "console_under_test.py"
        script.write_text(program, encoding="utf-8")
        model = str(find_model(find_home(), Config()))
        environment = os.environ | {"TERM": "xterm-256color", "PYTHONPATH": os.pathsep.join(sys.path)}
        self.process = subprocess.Popen(
            [sys.executable, str(script), str(self.home.root), str(self.report), model],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=environment,
            start_new_session=True,
        )
        os.close(theirs)
        self._reads = threading.Event()
        self._reads.set()
        self._open = True
        self._reader = threading.Thread(target=self._drain, daemon=True)
        self._reader.start()

    def until(self, condition: Callable[[], object], what: str, limit_s: float = LIMIT_S) -> None:
        """Wait for a condition."""
        end_s = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < end_s, f"{what} did not come in {limit_s:g} s"
            time.sleep(0.01)

    def begun(self) -> None:
        """Wait until the session runs."""
        self.until(lambda: self.report.with_suffix(".begun").exists() or self._ended(), "the session")

    def type(self, keys: bytes) -> None:
        """As from the keyboard."""
        os.write(self._master, keys)

    def again(self, keys: bytes, condition: Callable[[], object]) -> None:
        """Type it until the condition holds: on a machine that stalls, keys may come too late."""
        end_s, next_s = time.monotonic() + LIMIT_S, 0.0
        while not condition():
            now_s = time.monotonic()
            assert now_s < end_s, f"{keys!r} had no effect in {LIMIT_S:g} s"
            if now_s > next_s:
                next_s = now_s + AGAIN_S
                self.type(keys)
            time.sleep(0.01)

    def quit(self) -> None:
        """By Ctrl-Q."""
        self.again(b"\x11", lambda: self.process.poll() is not None)
        assert self.process.returncode == 0

    @property
    def sent(self) -> list[str]:
        """What a `FAKE` console has sent to control, oldest first."""
        return self.report.read_text().split() if self.report.exists() else []

    @property
    def alive(self) -> Path:
        """What a `FAKE` console touches as often as its input thread says that it runs."""
        return self.report.with_suffix(".alive")

    def stop(self) -> None:
        """By SIGSTOP: wait until it stands still."""
        self.process.send_signal(signal.SIGSTOP)
        self.until(lambda: self.stopped, "the stop")

    @property
    def stopped(self) -> bool:
        """Whether the console's process stands still."""
        return psutil.Process(self.process.pid).status() == psutil.STATUS_STOPPED

    def stop_reading(self) -> None:
        """As a suspended SSH client: wait until the terminal is full."""
        self._reads.clear()
        time.sleep(2 * FRAME_TIMEOUT_S)

    def read_lines(self) -> None:
        """The terminal's modes as a shell has them."""
        modes = termios.tcgetattr(self._master)
        modes[3] |= termios.ICANON | termios.ECHO
        termios.tcsetattr(self._master, termios.TCSANOW, modes)

    def read_on(self) -> None:
        """As one that is resumed."""
        self._reads.set()

    def close(self) -> None:
        """The window is closed."""
        if self._open:
            self._open = False
            self._reads.set()
            self._reader.join()  # else it could read from the next file that gets this number
            os.close(self._master)

    def gone(self, since_s: float) -> float:
        """Wait for the console's end; the seconds that it took."""
        self.process.wait(LIMIT_S)
        return time.monotonic() - since_s

    def _ended(self) -> bool:
        assert self.process.poll() is None, f"the console ended with {self.process.returncode}"
        return False

    def _drain(self) -> None:
        while True:
            self._reads.wait()
            if not self._open:
                return
            with suppress(OSError, ValueError):
                if select.select([self._master], [], [], 0.05)[0] and self._reads.is_set():
                    os.read(self._master, 65536)


@contextmanager
def terminal(folder: Path, *parts: str) -> Iterator[TerminalUnderTest]:
    """A console in a terminal; it is ended whatever happens."""
    under_test = TerminalUnderTest(folder, "".join((BEGIN, *parts, RUN)))
    try:
        yield under_test
    finally:
        if under_test.process.poll() is None:
            under_test.process.kill()
        under_test.process.wait()
        under_test.close()


def test_stop_is_sent_while_the_event_loop_is_stuck(tmp_path: Path) -> None:
    with terminal(tmp_path, FAKE, "ends = True", STUCK) as console:
        console.begun()
        console.type(b" ")
        console.until(console.report.exists, "STOP")


def test_of_what_waited_while_the_process_was_stopped_stop_alone_is_carried_out(tmp_path: Path) -> None:
    """The bytes wait in the kernel; what is typed after it has gone on is carried out."""
    with terminal(tmp_path, FAKE, RUNNING) as console:
        console.begun()
        console.stop()
        console.type(b"acye")
        typed_ns = time.monotonic_ns()
        console.until(lambda: time.monotonic_ns() - typed_ns > LATE_NS, "the end of half a second")
        console.type(b" ")
        console.process.send_signal(signal.SIGCONT)
        console.until(console.report.exists, "STOP")
        console.again(b"t1", lambda: "ACT" in console.sent)
        assert set(console.sent) == {"STOP", "ACT"}, "neither armed, confirmed nor ended"
        console.quit()


def test_a_console_that_was_stopped_twice_still_says_after_every_key_that_stop_can_be_given(tmp_path: Path) -> None:
    with terminal(tmp_path, FAKE, RUNNING) as console:
        console.begun()
        for _ in range(2):
            console.stop()
            console.process.send_signal(signal.SIGCONT)
            console.until(lambda: not console.stopped, "the end of the stop")
        console.again(b"t1", lambda: "ACT" in console.sent)
        for _ in range(10):
            console.type(b"z")
            for _ in range(3):  # the thread that reads the key may have touched it just before
                console.alive.unlink(missing_ok=True)
                console.until(console.alive.exists, "a heartbeat")
        console.quit()


def test_stop_is_sent_by_a_console_that_was_stopped_while_a_shell_had_its_terminal(tmp_path: Path) -> None:
    """The shell reads whole lines, with an echo; it leaves the terminal so."""
    with terminal(tmp_path, FAKE, RUNNING) as console:
        console.begun()
        console.stop()
        console.read_lines()
        console.process.send_signal(signal.SIGCONT)
        console.type(b" ")
        console.until(console.report.exists, "STOP")
        console.quit()


def test_stop_is_sent_while_the_terminal_does_not_read(tmp_path: Path) -> None:
    with terminal(tmp_path, FAKE, RUNNING) as console:
        console.begun()
        console.stop_reading()
        console.type(b" ")
        console.until(console.report.exists, "STOP", GONE_S)
        console.read_on()
        console.quit()  # the event loop has gone on


ENDS: dict[str, Callable[[TerminalUnderTest], object]] = {
    "SIGTERM": lambda console: console.process.send_signal(signal.SIGTERM),
    "SIGHUP": lambda console: console.process.send_signal(signal.SIGHUP),
    "SIGINT": lambda console: console.process.send_signal(signal.SIGINT),
    "closed": lambda console: console.close(),
}


@pytest.mark.parametrize("how", ENDS)
@pytest.mark.parametrize("state", ["reading", "not reading", "stuck"])
def test_the_console_is_gone_within_two_seconds(tmp_path: Path, how: str, state: str) -> None:
    parts = ("ends = False", STUCK) if state == "stuck" else (RUNNING,)
    with terminal(tmp_path, FAKE, *parts) as console:
        console.begun()
        if state == "not reading":
            console.stop_reading()
        since_s = time.monotonic()
        ENDS[how](console)
        assert console.gone(since_s) < GONE_S
        with hold_home(console.home):
            pass  # a new console may start


def test_a_console_that_fails_leaves_its_session_to_the_next(tmp_path: Path) -> None:
    with terminal(tmp_path, FAILING) as console:
        assert console.process.wait(LIMIT_S) != 0
        assert console.report.read_text() == "left"


@pytest.mark.parametrize("how", ["SIGHUP", "closed"])
def test_the_session_outlives_its_console_and_is_taken_over_from_another_terminal(
    tmp_path: Path, how: str, ends: ExitStack
) -> None:
    """Over the real processes, with a terminal that has not read for a while and STOP pressed meanwhile."""
    with terminal(tmp_path, REAL, RUNNING) as console:
        console.begun()
        session = psutil.Process(shared(console.home).host_pid)
        ends.callback(_end, session)
        children = [session, *session.children()]
        assert len(children) >= 5
        links = shared(console.home).links
        console.stop_reading()
        console.type(b" ")
        (trail,) = session_paths(console.home.logs)
        console.until(lambda: any(isinstance(one.body, Stop) for one in records(trail)), "STOP in the trail")
        since_s = time.monotonic()
        ENDS[how](console)
        assert console.gone(since_s) < GONE_S
        assert all(_lives(child) for child in children)
        assert held_session(console.home) is not None
    console.report.with_suffix(".begun").unlink()
    with terminal(tmp_path, REAL, RUNNING) as second:
        second.begun()
        assert all(_lives(child) for child in children)
        assert shared(second.home).links == links
        second.until(
            lambda: _taken_over(trail), "the takeover in the trail"
        )  # before it, Ctrl-Q would leave the session
        second.quit()  # ended by hand
    console.until(lambda: not any(_lives(child) for child in children), "the processes' end", ENDED_S)
    lines = [*read(trail)]
    found = [one.body for one in lines if isinstance(one, Record)]
    assert any(isinstance(one, SessionEnd) for one in found), f"the trail has its end: {lines[-3:]}"
    assert "console" in {one.ended for one in found if isinstance(one, ProcessEnd)}
    assert not links.path.exists()
    assert held_session(console.home) is None


def _taken_over(trail: Path) -> bool:
    notes = (one.body.text for one in records(trail) if isinstance(one.body, Note))
    return any(isinstance(text, Reason) and text.code == key_of(ConsoleChange.TAKEN_OVER) for text in notes)


@pytest.fixture
def ends() -> Iterator[ExitStack]:
    """What is to be done when the test is over, however it ended."""
    with ExitStack() as stack:
        yield stack


def _end(process: psutil.Process) -> None:
    with suppress(psutil.NoSuchProcess):
        process.terminate()


def _lives(process: psutil.Process) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


class Pipe:
    """A pipe that is read when we like."""

    def __init__(self) -> None:
        self.reads, self.writes = os.pipe()
        os.set_blocking(self.writes, False)
        self.repainted = 0
        self.lost = 0
        self.output = TerminalOutput(self.writes, lost=self._lose, repaint=self._repaint)

    def read(self, limit_s: float = 5.0) -> bytes:
        """All there is, once there is something."""
        select.select([self.reads], [], [], limit_s)
        return os.read(self.reads, 1_000_000)

    def _lose(self) -> None:
        self.lost += 1

    def _repaint(self) -> None:
        self.repainted += 1


def test_frames_are_dropped_and_modes_kept_until_somebody_reads() -> None:
    pipe = Pipe()
    end_s = time.monotonic() + 5.0
    while pipe.output.dropped < 50 and time.monotonic() < end_s:
        pipe.output.write("frame " * 2000)
        time.sleep(0.01)
    pipe.output.write("mode", droppable=False)
    assert pipe.output.dropped >= 50
    assert pipe.repainted == 0
    text = b""
    while not text.endswith(b"mode"):
        text += pipe.read()
    while pipe.repainted == 0 and time.monotonic() < end_s + 5.0:
        time.sleep(0.01)
    assert pipe.repainted == 1
    pipe.output.write("anew")
    assert pipe.read() == b"anew"
    pipe.output.close()


def test_frames_come_again_after_the_output_s_own_thread_was_kept_from_running() -> None:
    """As on a busy machine, while its frames grow too old."""
    pipe = Pipe()
    end_s = time.monotonic() + 5.0
    with pipe.output._changed:
        while pipe.output.dropped == 0 and time.monotonic() < end_s:
            pipe.output.write("frame")
            time.sleep(0.01)
    while pipe.repainted == 0 and time.monotonic() < end_s:
        time.sleep(0.01)
    assert pipe.repainted == 1
    assert pipe.output.dropped > 0
    pipe.output.write("anew")
    assert pipe.read() == b"anew"
    pipe.output.close()


def test_an_output_that_nobody_reads_is_closed_in_time() -> None:
    pipe = Pipe()
    for _ in range(20):
        pipe.output.write("frame " * 20_000)
    since_s = time.monotonic()
    pipe.output.close()
    assert time.monotonic() - since_s < 1.0
    assert pipe.lost == 0


def test_an_output_whose_reader_has_gone_is_reported() -> None:
    pipe = Pipe()
    os.close(pipe.reads)
    pipe.output.write("frame")
    end_s = time.monotonic() + 5.0
    while not pipe.lost and time.monotonic() < end_s:
        time.sleep(0.01)
    assert pipe.lost == 1
