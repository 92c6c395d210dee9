"""The laptop's sockets where a network refuses: no way to the other computer, a firewall's answer."""

from __future__ import annotations

import errno
import socket
import threading
import time
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from app.demo.two_hosts import free_port
from app.link import remote as remote_sockets
from app.link.keys import Peer, add_peer, own_key
from app.link.port import JointsPort
from app.link.questions import find, resolve, why_silent
from app.link.remote import RETRY_NS, Remote
from app.link.wire import VERSION, LinkFault, Welcome, program, split_address
from app.session.setup import make_setup
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.errors import AppError
from app.system.paths import Home
from logs.reason import key_of
from profiles.schema import DEMO_PATIENT

PATIENCE_S = 30.0
NO_WAY = "255.255.255.255:7447"  # the kernel connects no socket to everybody, as to a network without a route


class RejectingSocket(socket.socket):
    """A firewall on the way answers each packet with "prohibited" (ICMP), which the kernel tells as this error."""

    def recv(self, _size: int, _flags: int = 0, /) -> bytes:
        raise OSError(errno.EHOSTUNREACH, "No route to host")


def paired_with(home: Home, host: str) -> SessionSetup:
    """A session whose joints are there."""
    add_peer(home, Peer(name="joints", public=own_key(home).public, paired_at="", host=host))
    setup = make_setup(home, Config(joints=JointsConfig(host=host)), DEMO_PATIENT, None, permission=None)
    setup.links.path.rmdir()
    return setup


def test_packets_that_a_firewall_rejects_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "socket", RejectingSocket)
    with closing(Remote(paired_with(Home(tmp_path), "127.0.0.1:7447"))) as remote:
        remote.send_packet(b"x")
        assert list(remote.packets()) == []


def test_a_new_connection_has_a_new_socket_for_packets(tmp_path: Path) -> None:
    """An old one keeps the address that the laptop had: on another network nothing would leave, or come back."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as joints:
        joints.bind(("127.0.0.1", 0))
        joints.settimeout(PATIENCE_S)
        host = f"127.0.0.1:{joints.getsockname()[1]}"
        with closing(Remote(paired_with(Home(tmp_path), host))) as remote:
            seen = []
            for number in range(2):
                remote.connect(number + 1)
                remote.send_packet(b"there")
                seen.append(joints.recvfrom(100)[1])
                joints.sendto(b"back", seen[-1])
                assert dict(remote.poller.poll(1000 * int(PATIENCE_S)))
                assert list(remote.packets()) == [b"back"]
    assert seen[0] != seen[1]


def test_an_answer_comes_from_the_address_that_was_asked(tmp_path: Path) -> None:
    """As with Wi-Fi and cable in one network: the asker's socket is connected and hears no other address."""
    number = free_port()
    with (
        closing(JointsPort(Home(tmp_path), number)) as joints,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as laptop,
    ):
        laptop.bind(("127.0.0.1", 0))
        laptop.connect(("127.0.0.2", number))
        laptop.settimeout(PATIENCE_S)
        laptop.send(b"question")
        joints.wait(1000 * int(PATIENCE_S))
        ((datagram, where),) = joints.packets()
        assert (datagram, where.peer) == (b"question", laptop.getsockname())
        joints.send_packet(b"answer", where)
        assert laptop.recv(100) == b"answer"


def test_lost_packets_look_the_address_up_again_without_blocking(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The exoskeleton's computer got another address, or moved from Wi-Fi to the cable."""
    asked, answered = threading.Event(), threading.Event()
    means = ["127.0.0.5"]

    def look_up(host: str) -> tuple[str, int]:
        if threading.current_thread() is not threading.main_thread():
            asked.set()
            assert answered.wait(PATIENCE_S)
        return means[0], split_address(host)[1]

    monkeypatch.setattr(remote_sockets, "resolve", look_up)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as before,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as after,
    ):
        before.bind(("127.0.0.5", 0))
        number = before.getsockname()[1]
        after.bind(("127.0.0.9", number))
        with closing(Remote(paired_with(Home(tmp_path), f"exo.local:{number}"))) as remote:

            def reaches(there: socket.socket) -> bool:
                there.settimeout(PATIENCE_S)
                remote.send_packet(b"stop")
                return there.recv(100) == b"stop"

            remote.connect(1, silent=True)
            remote.connect(2)
            assert reaches(before)
            assert not asked.is_set(), "it has just been looked up, or packets come"
            means[0] = "127.0.0.9"
            remote.connect(3, silent=True)
            assert asked.wait(PATIENCE_S)
            assert reaches(before), "STOP leaves during the look-up"
            remote.connect(4, silent=True)
            assert reaches(before)
            answered.set()
            assert remote._lookup is not None
            remote._lookup.join(PATIENCE_S)
            remote.connect(5)
            assert reaches(after)


def test_an_address_that_is_not_known_now_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(host: str) -> tuple[str, int]:
        raise AppError(LinkFault.UNKNOWN_HOST, host=host, detail="")

    with closing(Remote(paired_with(Home(tmp_path), "127.0.0.1:7447"))) as remote:
        remote.connect(1)
        monkeypatch.setattr(remote_sockets, "resolve", unknown)
        remote.connect(2, silent=True)
        assert remote._lookup is not None
        remote._lookup.join(PATIENCE_S)
        remote.connect(3)
        assert remote._packets.getpeername() == ("127.0.0.1", 7447)


def test_a_new_connection_without_a_way_there_keeps_its_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(Remote(paired_with(Home(tmp_path), "127.0.0.1:7447"))) as remote:
        before = remote._packets
        with monkeypatch.context() as moved:
            moved.setattr(remote, "_where", ("255.255.255.255", 7447))
            remote._renew_packets()
        assert remote._packets is before
        remote.send_packet(b"x")


def test_lost_packets_ask_for_a_new_connection_although_frames_come(tmp_path: Path) -> None:
    home, number = Home(tmp_path), free_port()
    setup = paired_with(home, f"127.0.0.1:{number}")
    with closing(JointsPort(home, number)) as joints, closing(Remote(setup)) as remote:
        remote.connect(1)
        deadline = time.monotonic() + PATIENCE_S
        while not remote.may_send:
            assert time.monotonic() < deadline, "no welcome came"
            joints.wait(20)
            for identity, _, _ in joints.frames():
                welcome = Welcome(link=VERSION, program=program(), connection=1, packet_key=b"")
                joints.send_frame(identity, msgspec.msgpack.encode(welcome))
            list(remote.frames(2))
        assert not remote.must_reconnect(RETRY_NS + 1, packets_lost=True), "it has just been made"
        assert not remote.must_reconnect(RETRY_NS + 2, packets_lost=False)
        assert remote.must_reconnect(RETRY_NS + 2, packets_lost=True)


def test_without_a_way_there_the_fault_is_told(tmp_path: Path) -> None:
    with pytest.raises(AppError) as refused:
        Remote(paired_with(Home(tmp_path), NO_WAY))
    assert refused.value.code is LinkFault.UNKNOWN_HOST
    with pytest.raises(AppError) as refused:
        find(NO_WAY)
    assert refused.value.code is LinkFault.UNKNOWN_HOST
    assert why_silent(NO_WAY, 5.0).code == key_of(LinkFault.NOBODY_ANSWERS)


@pytest.mark.parametrize("host", ["exo..local", f"{'a' * 64}.local"])
def test_a_name_that_is_none_is_told_as_unknown(host: str) -> None:
    with pytest.raises(AppError) as refused:
        resolve(host)
    assert refused.value.code is LinkFault.UNKNOWN_HOST
    assert refused.value.values["host"] == host
    assert refused.value.values["detail"]
