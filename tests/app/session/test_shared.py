"""Who commands a session, and what another terminal finds of it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from app.ipc.links import OrderedReceiver, Publisher, address, new_link_directory
from app.ipc.messages import OperatorCommand, OperatorKind, ProcessStatus, SessionStatus
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Effect
from app.ipc.streams import OPERATOR, SESSION, SNAPSHOT, LinkDirectory
from app.session.host import SessionHost
from app.session.setup import make_setup
from app.session.shared import Peer, current_lease, held_session, share, shared, start_of, take_lease, unshare
from app.system.config import Config, SessionSetup
from app.system.errors import AppError
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT
from testing.messages import STANDING

ALIVE = ProcessStatus(name="control", pid=1, alive=True, restarts=0, exit_code=None)


@pytest.fixture
def links(tmp_path: Path) -> LinkDirectory:
    return new_link_directory(tmp_path)


def test_each_console_gets_a_number_of_its_own_and_the_newest_commands(links: LinkDirectory) -> None:
    assert current_lease(links) is None
    with ThreadPoolExecutor(8) as pool:
        taken = list(pool.map(lambda _: take_lease(links).number, range(40)))
    assert sorted(taken) == list(range(1, 41))
    newest = current_lease(links)
    assert newest is not None
    assert (newest.number, newest.pid) == (40, os.getpid())


def test_a_session_is_found_while_its_process_lives(tmp_path: Path) -> None:
    home = Home(tmp_path / "home")
    made = make_setup(home, Config(), DEMO_PATIENT, None)
    assert held_session(home) is None
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        setup = msgspec.structs.replace(made, host_pid=process.pid)
        share(setup)
        assert home.session_file.stat().st_mode & 0o777 == 0o600
        assert held_session(home) == setup
        process.kill()
    assert held_session(home) is None
    unshare(setup)
    made.links.path.rmdir()


def test_another_process_with_the_hosts_number_is_neither_found_nor_ended(tmp_path: Path) -> None:
    home = Home(tmp_path / "home")
    made = make_setup(home, Config(), DEMO_PATIENT, None)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        setup = msgspec.structs.replace(made, host_pid=process.pid, host_started=start_of(process.pid))
        share(setup)
        assert held_session(home) == setup
        stale = msgspec.structs.replace(setup, host_started=start_of(os.getpid()))
        share(stale)
        assert held_session(home) is None
        with pytest.raises(AppError, match="SESSION_ENDED"):
            shared(home)
        console = SessionHost(stale)
        with pytest.raises(AppError, match="NOT_STARTED"):
            console.start()
        console.close()
        assert process.poll() is None


def test_a_peer_is_seen_to_end_whoever_reaps_it() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        peer = Peer(process.pid)
        assert peer.alive
        peer.end(10.0)
        assert peer.wait(0.0)
        peer.close()
    assert not Peer(process.pid).alive


def test_the_acknowledged_stop_of_an_earlier_console_is_none_of_a_later_one(tmp_path: Path) -> None:
    made = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    setup = msgspec.structs.replace(made, host_pid=os.getpid())  # neither has taken over yet
    with closing(Publisher(address(setup.links, SNAPSHOT.name))) as control, ExitStack() as consoles:
        earlier, later = (consoles.enter_context(console_of(setup)) for _ in range(2))
        acted_on = earlier.send(OperatorKind.STOP)
        later.send(OperatorKind.STOP)
        assert waits_after(control, snapshot(acted_on), earlier) == 0
        assert waits_after(control, snapshot(acted_on), later) > 0
    shutil.rmtree(made.links.path)


@pytest.mark.parametrize("after", [False, True])
def test_a_stop_from_before_the_takeover_is_acknowledged_after_it(tmp_path: Path, after: bool) -> None:
    made = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    setup = msgspec.structs.replace(made, host_pid=os.getpid())
    take_lease(setup.links)
    with (
        closing(Publisher(address(setup.links, SNAPSHOT.name))) as control,
        closing(Publisher(address(setup.links, SESSION.name))) as session,
        console_of(setup) as console,
        ThreadPoolExecutor(1) as pool,
    ):
        acted_on = replace(snapshot(console.send(OperatorKind.STOP)), sequence=1)
        begun, limit_s = pool.submit(console.start), time.monotonic() + 30.0
        while not begun.done():
            assert time.monotonic() < limit_s
            session.send(SessionStatus(at_ns=time.monotonic_ns(), processes=(ALIVE,)))
        begun.result()
        again = console.send(OperatorKind.STOP)
        if after:  # only the newer STOP of the two is heard of
            acted_on = replace(acted_on, stop_lease=2, stop_sequence=again)
            assert waits_after(control, acted_on, console) == 0
        else:
            first = waits_after(control, replace(acted_on, sequence=2, stop_sequence=0), console)
            assert 0 < first < waits_after(control, acted_on, console)
    shutil.rmtree(made.links.path)


def test_a_process_is_seen_to_end_while_the_sessions_own_process_says_nothing(tmp_path: Path) -> None:
    made = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    setup = msgspec.structs.replace(made, host_pid=os.getpid())  # lives, and reports no more
    with (
        closing(Publisher(address(setup.links, SESSION.name))) as session,
        console_of(setup) as console,
        subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as control,
    ):
        told = replace(ALIVE, pid=control.pid)
        limit_s = time.monotonic() + 30.0
        while not console.processes():
            assert time.monotonic() < limit_s
            session.send(SessionStatus(at_ns=time.monotonic_ns(), processes=(told,)))
        control.kill()
        control.wait()
        while console.processes() != (replace(told, alive=False),):  # one status may still be on its way
            assert time.monotonic() < limit_s
    shutil.rmtree(made.links.path)


def test_a_command_counts_from_its_key_and_without_one_from_now(tmp_path: Path) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    with closing(OrderedReceiver(address(setup.links, OPERATOR.name), OperatorCommand)) as control:
        with console_of(setup) as console:
            before_ns = time.monotonic_ns()
            console.send(OperatorKind.ACKNOWLEDGE, input_ns=before_ns - 7)
            console.send(OperatorKind.ARM)
            acknowledged, armed = (control.receive(30.0) for _ in range(2))
        assert acknowledged is not None
        assert acknowledged.sent_ns == before_ns - 7
        assert armed is not None
        assert before_ns <= armed.sent_ns <= time.monotonic_ns()
    shutil.rmtree(setup.links.path)


@contextmanager
def console_of(setup: SessionSetup) -> Iterator[SessionHost]:
    host = SessionHost(setup)
    try:
        yield host
    finally:
        host.leave()


def snapshot(stop_sequence: int) -> ControlSnapshot:
    return replace(STANDING, effect=Effect.HOLD, armed=False, stop_sequence=stop_sequence)


def waits_after(control: Publisher, now: ControlSnapshot, console: SessionHost) -> int:
    """When its oldest STOP was sent that control has not acknowledged, once it has this snapshot."""
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        control.send(now)
        latest = console.poll()
        if latest.snapshot == now:
            return latest.stop_sent_ns
    raise AssertionError("the snapshot did not come")


def test_after_the_end_another_thread_still_reads_which_processes_there_were(tmp_path: Path) -> None:
    host = SessionHost(make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None))
    host.close()
    with ThreadPoolExecutor(1) as other:
        assert other.submit(host.processes).result() == ()
