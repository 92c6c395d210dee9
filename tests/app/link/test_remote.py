"""The laptop's sockets where a network refuses: no way to the other computer, a firewall's answer."""

from __future__ import annotations

import errno
import socket
from contextlib import closing
from pathlib import Path

import pytest

from app.link.keys import Peer, add_peer, own_key
from app.link.questions import find, why_silent
from app.link.remote import Remote
from app.link.wire import LinkFault
from app.session.host import make_setup
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.errors import AppError
from app.system.paths import Home
from logs.reason import key_of
from profiles.schema import DEMO_PATIENT

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


def test_without_a_way_there_the_fault_is_told(tmp_path: Path) -> None:
    with pytest.raises(AppError) as refused:
        Remote(paired_with(Home(tmp_path), NO_WAY))
    assert refused.value.code is LinkFault.UNKNOWN_HOST
    with pytest.raises(AppError) as refused:
        find(NO_WAY)
    assert refused.value.code is LinkFault.UNKNOWN_HOST
    assert why_silent(NO_WAY, 5.0).code == key_of(LinkFault.NOBODY_ANSWERS)
