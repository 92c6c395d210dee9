"""What a session's key costs: CPU time a message with CURVE and without, and a receiver under forged messages.

`python tools/bench_links.py [--senders 4] [--seconds 5] [--session]`. CPU time of both ends with ZeroMQ's threads; of
the receiving thread apart. The flood comes from as many processes as are named: half write an unencrypted conversation
of forged commands to the socket, again and again, half are ZeroMQ senders with another session's key. With `--session`
the same flood meets a real session of simulated joints, whose trail tells what it recorded.
"""

from __future__ import annotations

import multiprocessing
import os
import socket
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
import zmq
from rich.console import Console
from rich.table import Table

from app.ipc.links import Address, OrderedReceiver, OrderedSender, address, new_link_directory
from app.ipc.messages import Heartbeat, OperatorCommand, OperatorKind
from app.ipc.states import Action, Event
from app.ipc.streams import AUDIT, OPERATOR
from app.system.paths import Home
from logs.read import records, session_paths
from logs.records import Command, EventCleared, EventRaised
from testing.session import RealSession

SIZES = {"heartbeat": 50, "snapshot": 2_000, "plan": 60_000, "preview 160 x 90": 43_200}
MESSAGES = 2_000
TICKS_HZ = 500
FRAMES = 50  # forged messages that a connection writes at once
FORGED = msgspec.msgpack.encode(OperatorCommand(sequence=99, kind=OperatorKind.ACT, action=Action.WALK, sent_ns=1))
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(48)  # ZMTP 3.0, no security
READY = b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x04PUSH"
Counts = tuple["Synchronized[int]", "Synchronized[int]"]  # connections without a handshake, handshakes with another key
CONVERSATION = GREETING + READY + FRAMES * (b"\x00" + bytes([len(FORGED)]) + FORGED)


def main(
    senders: Annotated[int, typer.Option(help="Processes that flood.")] = 4,
    seconds: Annotated[float, typer.Option(help="How long.")] = 5.0,
    session: Annotated[bool, typer.Option("--session", help="Flood a real session instead.")] = False,
) -> None:
    """Print the table, then the flood's lines."""
    if session:
        flood_session(senders, seconds)
        return
    table = Table("message", "bytes", "without key, us", "with key, us")
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        at = address(new_link_directory(Path(folder)), "bench")
        for name, size in SIZES.items():
            table.add_row(
                name, str(size), f"{cost_us(at, size, keyed=False):.1f}", f"{cost_us(at, size, keyed=True):.1f}"
            )
        Console().print(table)
        receiver = OrderedReceiver(at, OperatorCommand)
        quiet_us, true, _ = tick_us(receiver, at, seconds)
        print_line(f"no flood: receiving thread {quiet_us:.1f} us of CPU a tick; true commands {true}")
        with flood([at.where], senders) as counts:
            flooded_us, true, peers = tick_us(receiver, at, seconds)
            reached = rates(counts, seconds)
        receiver.close()
    print_line(f"{reached}: receiving thread {flooded_us:.1f} us of CPU a tick; true commands {true}; {peers} told of")


def flood_session(senders: int, seconds: float) -> None:
    """A standing session, flooded at the operator's link and the audit's."""
    with tempfile.TemporaryDirectory(prefix="bench-") as folder, RealSession(Path(folder)) as running:
        before = running.stand()
        where = [address(running.setup.links, stream.name).where for stream in (OPERATOR, AUDIT)]
        with flood(where, senders) as counts:
            until_s = time.monotonic() + seconds
            running.until(lambda _: time.monotonic() > until_s)
            reached = rates(counts, seconds)
        after = running.until(lambda now: not any(one.event is Event.FOREIGN_PEER for one in now.events))
        running.finish()
        (trail,) = session_paths(Home(running.setup.home).logs)
        bodies = [record.body for record in records(trail)]
    raised = [one for one in bodies if isinstance(one, EventRaised) and one.event == Event.FOREIGN_PEER.value]
    cleared = [one for one in bodies if isinstance(one, EventCleared) and one.event == Event.FOREIGN_PEER.value]
    walked = [one for one in bodies if isinstance(one, Command) and one.action == Action.WALK.value]
    totals = [int(one.total or 0) for one in cleared]
    print_line(
        f"{reached}: {len(walked)} commands granted, state {before.state.value} → {after.state.value}; "
        f"{len(raised)} records of it coming, {len(cleared)} of it going, peers told {totals}"
    )


def print_line(text: str) -> None:
    Console(soft_wrap=True, highlight=False).print(text)


def rates(counts: Counts, seconds: float) -> str:
    """What the flood reached, as text. What waits for a handshake that never succeeds was not sent."""
    conversations, keys = (count.value / seconds for count in counts)
    return (
        f"{conversations:.0f} connections/s that write {FRAMES} forged messages each without a handshake, "
        f"{keys:.0f} handshakes/s with another key"
    )


@contextmanager
def flood(where: list[str], senders: int) -> Iterator[Counts]:
    """Senders, each with its link and kind in turn; how often each kind has connected. None: nothing."""
    context = multiprocessing.get_context("spawn")
    counts: Any = (context.Value("q", 0), context.Value("q", 0))
    kinds = (write_conversations, send_with_another_key)
    processes = [
        context.Process(
            target=kinds[number % 2], args=(where[number // 2 % len(where)], counts[number % 2]), daemon=True
        )
        for number in range(senders)
    ]
    for process in processes:
        process.start()
    begun = counts[: min(senders, 2)]
    while not all(count.value for count in begun) and all(process.is_alive() for process in processes):
        time.sleep(0.01)
    for count in counts:
        count.value = 0
    try:
        yield counts
    finally:
        for process in processes:
            process.kill()
            process.join()


def write_conversations(where: str, connections: Synchronized[int]) -> None:
    """Connect, write all at once, leave; a connection that was ended before all was written counts as well."""
    while True:
        with socket.socket(socket.AF_UNIX) as one:
            one.connect(where.removeprefix("ipc://"))
            with suppress(ConnectionError):
                one.sendall(CONVERSATION)
        with connections:
            connections.value += 1


def send_with_another_key(where: str, handshakes: Synchronized[int]) -> None:
    """As a process of an earlier session does; ZeroMQ gives a server that refuses it up, so each socket is new."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
    while True:
        one = context.socket(zmq.PUSH)
        one.setsockopt(zmq.LINGER, 0)
        one.curve_serverkey, _ = zmq.curve_keypair()
        one.curve_publickey, one.curve_secretkey = zmq.curve_keypair()
        one.connect(where)
        one.send(FORGED)  # it waits
        time.sleep(0.002)  # for its handshake
        one.close()
        with handshakes:
            handshakes.value += 1


def cost_us(at: Address, size: int, *, keyed: bool) -> float:
    """CPU time of one message from end to end, microseconds."""
    sender, receiver = ends(at, keyed=keyed)
    payload = os.urandom(size)
    send_one(sender, receiver, payload)  # connects
    began_s = time.process_time()
    for _ in range(MESSAGES):
        send_one(sender, receiver, payload)
    spent_s = time.process_time() - began_s
    sender.close(linger=0)
    receiver.close(linger=0)
    return spent_s / MESSAGES * 1e6


def ends(at: Address, *, keyed: bool) -> tuple[zmq.Socket[bytes], zmq.Socket[bytes]]:
    """A sender and a receiver; with the key, those of the product."""
    if keyed:
        receiver = OrderedReceiver(at, Heartbeat).socket
        return OrderedSender(at).socket, receiver
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
    pull, push = context.socket(zmq.PULL), context.socket(zmq.PUSH)
    pull.bind(at.where)
    push.connect(at.where)
    return push, pull


def send_one(sender: zmq.Socket[bytes], receiver: zmq.Socket[bytes], payload: bytes) -> None:
    """Through the sockets and back into Python."""
    sender.send(payload)
    receiver.recv()


def tick_us(receiver: OrderedReceiver[OperatorCommand], at: Address, seconds: float) -> tuple[float, str, int]:
    """CPU time of a tick's receiving, mean; how a true sender's commands arrived; how many peers were told of."""
    true = OrderedSender(at)
    spent_ns = ticks = peers = sent = 0
    delays_ms: list[float] = []
    until_s = time.monotonic() + seconds
    while (now_s := time.monotonic()) < until_s:
        if ticks % 25 == 0:
            sent += 1
            true.send(OperatorCommand(sequence=sent, kind=OperatorKind.HEARTBEAT, sent_ns=time.monotonic_ns()))
        began_ns = time.thread_time_ns()
        message = receiver.receive()
        peers += receiver.foreign_peers()
        spent_ns += time.thread_time_ns() - began_ns
        if message is not None:
            delays_ms.append((time.monotonic_ns() - message.sent_ns) / 1e6)
        ticks += 1
        time.sleep(max(0.0, now_s + 1.0 / TICKS_HZ - time.monotonic()))
    true.close()
    longest_ms = max(delays_ms, default=float("nan"))
    return spent_ns / ticks / 1e3, f"{len(delays_ms)} of {sent}, the slowest after {longest_ms:.0f} ms", peers


if __name__ == "__main__":
    typer.run(main)
