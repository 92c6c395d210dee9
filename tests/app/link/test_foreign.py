"""Who counts as foreign at the port: strangers, and not the paired laptop on a poor network."""

from __future__ import annotations

import socket
import time
from contextlib import closing
from pathlib import Path

import pytest

from app.demo.two_hosts import free_port
from app.link.port import HANDSHAKE_S, JointsPort
from app.link.remote import GREETING_TRIPS, RETRY_AT_MOST_NS, RETRY_NS, Remote
from app.link.wire import VERSION, Hello, ToJoints, Welcome, program
from app.system.paths import Home
from tests.app.link.test_remote import paired_with
from tests.app.link.test_server import PATIENCE_S, Joints, messages, paired, running
from tests.support.relay import Relay

pytestmark = pytest.mark.serial


def test_frames_of_the_laptop_after_a_reset_are_not_foreign(tmp_path: Path) -> None:
    """ZeroMQ connects anew by itself, under another identity and without a greeting."""
    with running(Home(tmp_path / "joints")) as joints, Relay(joints.port) as relay:
        setup = paired(joints, Home(tmp_path / "laptop"), f"127.0.0.1:{relay.port}")
        with closing(Remote(setup)) as remote:
            remote.connect(time.monotonic_ns())
            await_welcome(remote)
            assert foreign(joints) == 0
            relay.reset()
            deadline = time.monotonic() + PATIENCE_S
            while relay.connections < 2:
                assert time.monotonic() < deadline, "no second connection came"
                time.sleep(0.01)
            for number in range(1, 4):
                remote.send(ToJoints(number=number, acknowledged=0))
            remote.send(Hello(link=VERSION, program=program(), request=remote._request))
            await_welcome(remote)  # the answer comes behind what was sent before
            assert foreign(joints) == 0
    assert joints.server._session is None


def test_a_stranger_is_foreign_when_a_slow_laptop_would_have_shaken_hands(tmp_path: Path) -> None:
    number, began_s = free_port(), 1e6
    with closing(JointsPort(Home(tmp_path), number)) as port:
        count = port._monitor.count
        assert count(began_s) == 0
        with socket.create_connection(("127.0.0.1", number)):
            events = port._monitor._events
            assert events is not None
            assert events.poll(int(PATIENCE_S * 1000))
            assert [count(began_s + at_s) for at_s in (1.0, 2.0, HANDSHAKE_S, 2 * HANDSHAKE_S)] == [0, 0, 0, 1]


@pytest.mark.parametrize(
    ("round_trip_ns", "patience_ns"),
    [(0, RETRY_NS), (300_000_000, GREETING_TRIPS * 300_000_000), (3_000_000_000, RETRY_AT_MOST_NS)],
)
def test_a_connection_is_given_up_after_the_time_that_the_network_needs(
    tmp_path: Path, round_trip_ns: int, patience_ns: int
) -> None:
    with closing(Remote(paired_with(Home(tmp_path), f"127.0.0.1:{free_port()}"))) as remote:
        remote.connect(1)
        remote.expect_soon(round_trip_ns)
        assert not remote.must_reconnect(1 + patience_ns, packets_lost=True)
        assert remote.must_reconnect(2 + patience_ns, packets_lost=True)


def await_welcome(remote: Remote) -> None:
    assert any(isinstance(message, Welcome) for message in messages(remote)), "no welcome came"


def foreign(joints: Joints) -> int:
    return joints.server._link_health(time.monotonic_ns()).foreign_peers
