"""`rleex joints` started again in a session: what its laptop sends to the process before is no foreign peer's."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest

from app.demo.two_hosts import free_port
from app.link.packets import PacketSeal, new_packet_key
from app.link.port import Where
from app.link.server import JointsServer
from app.link.service import config_at_start
from app.link.wire import VERSION, Hello, Packet, SessionRequest, StopMark, ToJoints, program
from app.session.setup import make_setup
from app.session.shared import share
from app.system.config import Config
from app.system.errors import AppError
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT

WHERE = Where(("127.0.0.1", 9), bytes(4))
FRAME = msgspec.msgpack.encode(ToJoints(number=1, acknowledged=0))


class NoWorkers(Executor):
    """Starts and ends no process."""

    def submit(self, _call: Callable[..., Any], /, *_args: Any, **_kwargs: Any) -> Future[Any]:
        return Future()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[JointsServer]:
    """It has found a session of an earlier process."""
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None, permission=None)
    share(msgspec.structs.replace(setup, operator="ann", linked=True, host_pid=os.getpid()))
    with closing(JointsServer(Home(tmp_path), free_port(), NoWorkers())) as resumed:
        assert resumed._session is not None
        yield resumed
        resumed._session.close_links()
        resumed._session._host.leave()
    shutil.rmtree(setup.links.path)


def ask_for(server: JointsServer, session: str, user: str = "key") -> None:
    """A laptop greets."""
    request = SessionRequest(session=session, profile=DEMO_PATIENT, operator="ann", role="", signed_in=False)
    hello = Hello(link=VERSION, program=program(), request=request)
    server._take_frame(b"new", user, msgspec.msgpack.encode(hello))


def greet(server: JointsServer) -> PacketSeal:
    """Its laptop comes back; what it seals with from now on."""
    assert server._session is not None
    ask_for(server, server._session.name)
    assert server._laptop is not None
    seal = server._laptop.seal
    return PacketSeal(connection=seal.connection, key=seal.key, at_joints=False)


def send(server: JointsServer, seal: PacketSeal, number: int) -> None:
    """A packet of a laptop arrives."""
    server._take_packet(seal.seal(Packet(number=number, sent_ns=number)), WHERE, time.monotonic_ns())


def foreign(server: JointsServer) -> int:
    """Peers that control is to record."""
    return server._link_health(time.monotonic_ns()).foreign_peers


def test_what_the_laptop_sent_to_the_process_before_is_not_foreign(server: JointsServer) -> None:
    before = PacketSeal(connection=1, key=new_packet_key(), at_joints=False)
    for number in range(1, 51):
        send(server, before, number)
    server._take_frame(b"old", "key", FRAME)
    now = greet(server)
    send(server, before, 51)  # was under way
    assert foreign(server) == 0
    send(server, now, 1)
    assert foreign(server) == 0
    send(server, before, 52)
    assert foreign(server) == 1
    server._take_frame(b"old", "another key", FRAME)
    assert foreign(server) == 2


def test_a_held_session_is_resumed_whatever_the_file_says_meanwhile(server: JointsServer, tmp_path: Path) -> None:
    Home(tmp_path).config.write_text('unattended_s = "soon"', encoding="utf-8")
    assert config_at_start(Home(tmp_path)) == Config()
    ask_for(server, server._session.name if server._session else "")
    assert server._laptop is not None
    empty = Home(tmp_path / "without a session")
    empty.root.mkdir()
    empty.config.write_text('unattended_s = "soon"', encoding="utf-8")
    with pytest.raises(AppError, match="UNREADABLE"):
        config_at_start(empty)


def test_what_no_laptop_seals_is_foreign_in_a_resumed_session_too(server: JointsServer) -> None:
    for datagram in (b"", b"\0 nothing of ours"):
        server._take_packet(datagram, WHERE, time.monotonic_ns())
    server._take_frame(b"old", "key", b"nothing of ours")
    assert foreign(server) == 3


def test_a_laptop_that_asks_for_its_next_session_knows_of_the_last_ones_end(server: JointsServer) -> None:
    greet(server)
    last = server._session
    assert last is not None
    following = "20261127T120000Z-1a2b"
    ask_for(server, following)
    assert server._session is last, "it still runs"
    last.ended = True
    ask_for(server, following, user="another laptop's")
    assert server._session is last
    ask_for(server, following)
    assert server._session is not None
    assert server._session.name == following
    assert server._laptop is not None
    assert foreign(server) == 0
    last._host.leave()
    shutil.rmtree(server._session._host.setup.links.path)


def test_after_this_computer_slept_a_stop_is_handed_on_without_a_round_trip(server: JointsServer) -> None:
    seal, now_ns, ms = greet(server), time.monotonic_ns(), 1_000_000
    session = server._session
    assert session is not None
    session.commands._lease = 1  # as control's snapshot tells it
    whole = Packet(number=1, sent_ns=8 * ms, echo_sent_ns=now_ns - 10 * ms, echo_received_ns=5 * ms, lease=1)
    server._take_packet(seal.seal(whole), WHERE, now_ns)
    stop = StopMark(1, 7, 40_000 * ms)
    slept = Packet(
        number=2,
        sent_ns=40_005 * ms,
        echo_sent_ns=now_ns,
        echo_received_ns=18 * ms,
        stops=(stop,),
        heartbeat_ns=40_005 * ms,
        lease=1,
    )
    server._take_packet(seal.seal(slept), WHERE, now_ns + 20 * ms)
    assert stop in session.commands._handed.values()
    assert session.commands._heartbeat_ns == 0, "nothing that holds a motion up counts"
