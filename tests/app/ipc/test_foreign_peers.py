"""Who has no key of the session gets no message in or out, over real sockets; it is counted, and holds nobody up."""

from __future__ import annotations

import errno
import os
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
import zmq

from app.ipc import links
from app.ipc.links import (
    Address,
    LatestReceiver,
    OrderedReceiver,
    OrderedSender,
    Publisher,
    address,
    new_link_directory,
)
from app.ipc.messages import Heartbeat, OperatorCommand, OperatorKind

LIMIT_S = 20.0
NOBODY = 65534
STOP = OperatorCommand(sequence=1, kind=OperatorKind.STOP, sent_ns=1)
FORGED = msgspec.msgpack.encode(msgspec.structs.replace(STOP, sequence=99))
_GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(48)


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end, "did not come"
        time.sleep(0.01)


@pytest.fixture(autouse=True)
def period_s(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Foreign peers are told soon: most tests wait for a number, and none of them for its absence."""
    monkeypatch.setattr(links, "PEERS_PERIOD_S", getattr(request, "param", 0.02))


@pytest.fixture
def at(tmp_path: Path) -> Address:
    return address(new_link_directory(tmp_path), "x")


@pytest.fixture
def receiver(at: Address) -> Iterator[OrderedReceiver[OperatorCommand]]:
    made = OrderedReceiver(at, OperatorCommand)
    made.foreign_peers()  # listens from now on
    yield made
    made.close()


def raw(kind: int, prepare: Callable[[zmq.Socket[bytes]], None] = lambda _: None) -> zmq.Socket[bytes]:
    made: zmq.Socket[bytes] = zmq.Context.instance().socket(kind)
    made.setsockopt(zmq.LINGER, 0)
    prepare(made)
    return made


def with_another_key(one: zmq.Socket[bytes]) -> None:
    """As a process of an earlier session has it."""
    one.curve_serverkey, _ = zmq.curve_keypair()
    one.curve_publickey, one.curve_secretkey = zmq.curve_keypair()


def as_another_server(one: zmq.Socket[bytes]) -> None:
    one.curve_server = True
    _, one.curve_secretkey = zmq.curve_keypair()


def with_a_password(one: zmq.Socket[bytes]) -> None:
    one.plain_username, one.plain_password = b"therapist", b"1234"


def believes_only_its_own(receiver: OrderedReceiver[OperatorCommand], at: Address) -> None:
    sender = OrderedSender(at)
    try:
        assert sender.send(STOP)
        assert receiver.receive(LIMIT_S) == STOP
        assert receiver.receive() is None
    finally:
        sender.close()


@pytest.mark.parametrize("prepare", [lambda _: None, with_another_key, with_a_password])
def test_a_sender_without_the_key_is_turned_away_and_counted(
    receiver: OrderedReceiver[OperatorCommand], at: Address, prepare: Callable[[zmq.Socket[bytes]], None]
) -> None:
    foreign = raw(zmq.PUSH, prepare)
    try:
        foreign.connect(at.where)
        foreign.send(FORGED)
        until(lambda: receiver.foreign_peers() > 0)
        believes_only_its_own(receiver, at)
    finally:
        foreign.close()


@pytest.mark.parametrize(
    "bytes_sent", [b"", b"x" * 5000, b"\x01\x00" + FORGED, _GREETING + b"\x00" + FORGED, b"\xff" * 100, FORGED]
)
def test_garbage_on_the_socket_is_counted(
    receiver: OrderedReceiver[OperatorCommand], at: Address, bytes_sent: bytes
) -> None:
    with socket.socket(socket.AF_UNIX) as foreign:
        foreign.connect(at.where.removeprefix("ipc://"))
        foreign.sendall(bytes_sent)
        until(lambda: receiver.foreign_peers() > 0)
        believes_only_its_own(receiver, at)


def test_a_conversation_of_the_session_played_again_brings_nothing(
    receiver: OrderedReceiver[OperatorCommand], at: Address, tmp_path: Path
) -> None:
    """Everything that a true sender wrote to its socket, byte for byte, on a connection of its own."""
    copied: list[bytes] = []
    middle = tmp_path / "middle.sock"
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(middle))
    listening.listen()

    def pass_on() -> None:
        near, _ = listening.accept()
        far = socket.socket(socket.AF_UNIX)
        far.connect(at.where.removeprefix("ipc://"))
        back = threading.Thread(target=_pump, args=(far, near, []))
        back.start()
        _pump(near, far, copied)
        far.shutdown(socket.SHUT_RDWR)
        back.join()
        for one in (near, far):
            one.close()

    thread = threading.Thread(target=pass_on)
    thread.start()
    sender = OrderedSender(Address(f"ipc://{middle}", at.links))
    assert sender.send(STOP)
    assert receiver.receive(LIMIT_S) == STOP
    sender.close()
    thread.join()
    listening.close()
    with socket.socket(socket.AF_UNIX) as again:
        again.connect(at.where.removeprefix("ipc://"))
        again.sendall(b"".join(copied))
        until(lambda: receiver.foreign_peers() > 0)
        assert receiver.receive() is None
    assert receiver.rejected == 0


def _another(counts: list[int], receiver: OrderedReceiver[OperatorCommand]) -> int:
    counts.append(receiver.foreign_peers())
    return sum(counts)


def _pump(source: socket.socket, sink: socket.socket, copied: list[bytes]) -> None:
    try:
        while chunk := source.recv(65536):
            copied.append(chunk)
            sink.sendall(chunk)
    except OSError:
        return


@pytest.mark.parametrize("prepare", [lambda _: None, as_another_server])
def test_a_false_publisher_is_not_heard_and_the_true_one_is_when_it_comes(
    at: Address, prepare: Callable[[zmq.Socket[bytes]], None]
) -> None:
    """As when another process takes the place of a perception that has died."""
    false = raw(zmq.PUB, prepare)
    false.bind(at.where)
    receiver = LatestReceiver(at, Heartbeat)
    true: Publisher | None = None
    forged = msgspec.msgpack.encode(Heartbeat(at_ns=13, enabled=True))
    try:

        def turned_away() -> bool:
            false.send(forged)
            assert receiver.receive() is None
            return receiver.foreign_peers() > 0

        if prepare is not as_another_server:  # that one turns the receiver away itself
            until(turned_away)
        for _ in range(20):
            turned_away()
            time.sleep(0.01)
        false.close()
        true = Publisher(at)

        def heard() -> bool:
            assert true is not None
            true.send(Heartbeat(at_ns=7, enabled=False))
            receiver.foreign_peers()
            return receiver.receive() == Heartbeat(at_ns=7, enabled=False)

        until(heard)
    finally:
        for link in (false, receiver, true):
            if link is not None:
                link.close()


def test_a_listener_without_the_key_learns_nothing(at: Address) -> None:
    publisher, own = Publisher(at), LatestReceiver(at, Heartbeat)
    publisher.foreign_peers()
    foreign = raw(zmq.SUB)
    foreign.setsockopt(zmq.SUBSCRIBE, b"")
    foreign.connect(at.where)
    try:
        heard: list[Heartbeat | None] = []

        def told() -> bool:
            publisher.send(Heartbeat(at_ns=7, enabled=True))
            heard.append(own.receive())
            return publisher.foreign_peers() > 0 and any(heard)

        until(told)
        assert not foreign.poll(0)
    finally:
        foreign.close()
        own.close()
        publisher.close()


def test_a_flood_is_a_few_numbers_and_a_true_command_passes(
    receiver: OrderedReceiver[OperatorCommand], at: Address
) -> None:
    """Ten thousand forged messages and hundreds of broken connections."""
    where = at.where.removeprefix("ipc://")
    foreign = raw(zmq.PUSH)
    foreign.connect(at.where)
    for _ in range(500):
        foreign.send(FORGED, zmq.NOBLOCK)
    told: list[int] = []
    for _ in range(300):
        with socket.socket(socket.AF_UNIX) as one:
            one.connect(where)
        told.append(receiver.foreign_peers())
    believes_only_its_own(receiver, at)
    until(lambda: _another(told, receiver) > 0)
    foreign.close()
    assert receiver.rejected == 0


@pytest.mark.parametrize("period_s", [links.PEERS_PERIOD_S], indirect=True)
def test_the_processes_of_the_session_are_not_foreign(receiver: OrderedReceiver[OperatorCommand], at: Address) -> None:
    """They come and go; whoever is in its handshake for less than a period is not counted."""
    for _ in range(5):
        believes_only_its_own(receiver, at)
        assert receiver.foreign_peers() == 0
    with socket.socket(socket.AF_UNIX) as foreign:
        foreign.connect(at.where.removeprefix("ipc://"))
        counts: list[int] = []
        until(lambda: _another(counts, receiver) > 0)
    assert sum(counts) == 1


def _connects(where: str, user: int | None) -> int:
    """The errno of connecting in another process, as that user; 0: connected."""
    child = os.fork()
    if child == 0:
        try:
            if user is not None:
                os.setgroups([])
                os.setgid(user)
                os.setuid(user)
            with socket.socket(socket.AF_UNIX) as one:
                one.connect(where)
            os._exit(0)
        except OSError as error:
            os._exit(error.errno or 255)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can try as another user")
@pytest.mark.filterwarnings("ignore:This process")  # of fork beside ZeroMQ's threads: the child only connects
def test_another_user_of_the_host_does_not_come_near() -> None:
    folder = Path(tempfile.mkdtemp(prefix="rleex-"))  # as a session makes it
    at = address(new_link_directory(folder), "x")
    receiver = OrderedReceiver(at, OperatorCommand)
    try:
        where = at.where.removeprefix("ipc://")
        assert _connects(where, None) == 0
        assert _connects(where, NOBODY) == errno.EACCES
    finally:
        receiver.close()
        shutil.rmtree(folder)


def test_the_key_stands_in_no_text(at: Address) -> None:
    for text in (repr(at), repr(at.links), str(at.links)):
        assert at.links.public.decode() not in text
        assert at.links.secret.decode() not in text
