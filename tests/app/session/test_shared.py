"""Who commands a session, and what another terminal finds of it."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pytest

from app.ipc.links import new_link_directory
from app.ipc.streams import LinkDirectory
from app.session.host import SessionHost, make_setup
from app.session.shared import Peer, current_lease, held_session, share, take_lease, unshare
from app.system.config import Config
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT


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


def test_a_peer_is_seen_to_end_whoever_reaps_it() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        peer = Peer(process.pid)
        assert peer.alive
        peer.end(10.0)
        assert peer.wait(0.0)
        peer.close()
    assert not Peer(process.pid).alive


def test_after_the_end_another_thread_still_reads_which_processes_there_were(tmp_path: Path) -> None:
    host = SessionHost(make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None))
    host.close()
    with ThreadPoolExecutor(1) as other:
        assert other.submit(host.processes).result() == ()
