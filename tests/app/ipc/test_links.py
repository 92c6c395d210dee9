"""Links: the newest wins on one kind, nothing is lost or reordered on the other, and a full queue says so."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
import pytest

from app.ipc.links import LatestReceiver, OrderedReceiver, OrderedSender, Publisher, address, new_link_directory
from app.ipc.messages import HandCommand, Heartbeat
from app.ipc.streams import LinkDirectory


def beat(at_ns: int) -> Heartbeat:
    return Heartbeat(at_ns=at_ns, enabled=False)


def until(condition: Callable[[], bool], limit_s: float = 5.0) -> bool:
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.002)
    return False


def test_latest_keeps_only_the_newest(tmp_path: Path) -> None:
    where = address(new_link_directory(tmp_path), "x")
    sender, receiver = Publisher(where), LatestReceiver(where, Heartbeat)
    try:
        observed: list[int] = []

        def connected() -> bool:
            sender.send(beat(1))
            return receiver.receive(0.01) is not None

        assert until(connected)
        for at_ns in range(2, 200):
            sender.send(beat(at_ns))

        def drained() -> bool:
            message = receiver.receive(0.01)
            observed.extend([message.at_ns] if message else [])
            return bool(observed) and observed[-1] == 199

        assert until(drained)
        assert observed == sorted(observed)
        assert receiver.receive() is None
    finally:
        sender.close()
        receiver.close()


ROUNDS = 40


def comes(receiver: LatestReceiver[Heartbeat], at_ns: int, limit_s: float) -> bool:
    return until(lambda: (beat := receiver.receive(0.01)) is not None and beat.at_ns == at_ns, limit_s)


def speak_and_close(links: LinkDirectory, heard: Connection) -> None:
    for number in range(ROUNDS):
        publisher = Publisher(address(links, str(number)), queue=8)
        while not heard.poll(0.005):
            publisher.send(beat(1))
        heard.recv()
        publisher.send(beat(2))
        publisher.close(linger_s=5.0)


def test_the_last_message_of_a_publisher_with_a_queue_arrives_though_it_is_closed_behind_it(tmp_path: Path) -> None:
    links = new_link_directory(tmp_path)
    context = multiprocessing.get_context("spawn")  # another process, or the closing would wait for this one's thread
    mine, theirs = context.Pipe()
    speaker = context.Process(target=speak_and_close, args=(links, theirs), daemon=True)
    speaker.start()
    lost = []
    for number in range(ROUNDS):  # a conflating publisher lost up to half of them
        receiver = LatestReceiver(address(links, str(number)), Heartbeat)
        assert comes(receiver, 1, 30.0)
        mine.send("heard")
        if not comes(receiver, 2, 5.0):
            lost.append(number)
        receiver.close()
    speaker.join(30.0)
    assert speaker.exitcode == 0
    assert not lost


def test_ordered_loses_and_reorders_nothing(tmp_path: Path) -> None:
    where = address(new_link_directory(tmp_path), "x")
    receiver, sender = OrderedReceiver(where, Heartbeat), OrderedSender(where)
    try:
        assert all(sender.send(beat(number)) for number in range(1000))
        got: list[int] = []
        while len(got) < 1000 and (message := receiver.receive(2.0)) is not None:
            got.append(message.at_ns)
        assert got == list(range(1000))
    finally:
        sender.close()
        receiver.close()


def test_full_queue_is_reported_to_the_sender(tmp_path: Path) -> None:
    sender = OrderedSender(address(new_link_directory(tmp_path), "nobody-listens"))
    try:
        accepted = 0
        while sender.send(beat(accepted)) and accepted < 1_000_000:
            accepted += 1
        assert 0 < accepted < 1_000_000
    finally:
        sender.close()


@pytest.mark.parametrize(
    "garbage",
    [
        b"",
        b"\xff\xfe",
        b"x" * 5000,
        b"\x81\xa1x" + b"\x91" * 1000 + b"\x01",
        msgspec.msgpack.encode(HandCommand()),
        msgspec.msgpack.encode({"a": 1}),
    ],
    ids=["empty", "bytes", "long", "nested too deeply", "another message", "another map"],
)
def test_malformed_messages_are_counted_and_skipped(tmp_path: Path, garbage: bytes) -> None:
    where = address(new_link_directory(tmp_path), "x")
    receiver = OrderedReceiver(where, Heartbeat)
    raw = OrderedSender(where)
    try:
        raw.socket.send(garbage)
        raw.send(beat(7))
        message = receiver.receive(2.0)
        assert message is None or message.at_ns == 7
        assert until(lambda: message is not None or receiver.receive(0.05) is not None)
        assert receiver.rejected == 1
    finally:
        raw.close()
        receiver.close()
