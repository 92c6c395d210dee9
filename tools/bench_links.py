"""What a session's key costs: CPU time a message with CURVE and without, and a receiver under forged connections.

`python tools/bench_links.py`. CPU time of both ends with ZeroMQ's threads; of the receiving thread apart.
"""

from __future__ import annotations

import os
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import zmq
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent.parent))  # run as a script, `tools` is a folder of the tree

from app.ipc.links import Address, OrderedReceiver, OrderedSender, address, new_link_directory
from app.ipc.messages import Heartbeat, OperatorCommand

SIZES = {"heartbeat": 50, "snapshot": 2_000, "plan": 60_000, "preview 160 x 90": 43_200}
MESSAGES = 2_000
FLOOD_S = 5.0
TICKS_HZ = 500


def main() -> None:
    table = Table("message", "bytes", "without key, us", "with key, us")
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        at = address(new_link_directory(Path(folder)), "bench")
        for name, size in SIZES.items():
            table.add_row(
                name, str(size), f"{cost_us(at, size, keyed=False):.1f}", f"{cost_us(at, size, keyed=True):.1f}"
            )
        Console().print(table)
        receiver = OrderedReceiver(at, OperatorCommand)
        quiet_us, _ = tick_us(receiver, lambda: None)
        flooded_us, connections = tick_us(receiver, forger(at))
        receiver.close()
    say = Console().print
    say(
        f"receiving thread, CPU a tick: {quiet_us:.1f} us; "
        f"with {connections:.0f} forged connections/s: {flooded_us:.1f} us"
    )


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
        receiver = OrderedReceiver(at, Heartbeat)._socket
        return OrderedSender(at)._socket, receiver
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
    pull, push = context.socket(zmq.PULL), context.socket(zmq.PUSH)
    pull.bind(at.where)
    push.connect(at.where)
    return push, pull


def send_one(sender: zmq.Socket[bytes], receiver: zmq.Socket[bytes], payload: bytes) -> None:
    """Through the sockets and back into Python."""
    sender.send(payload)
    receiver.recv()


def tick_us(receiver: OrderedReceiver[OperatorCommand], disturb: Callable[[], object]) -> tuple[float, float]:
    """CPU time of a tick's receiving, mean, and how often a second it was disturbed meanwhile."""
    spent_ns = ticks = disturbances = 0
    until_s = time.monotonic() + FLOOD_S
    while (now_s := time.monotonic()) < until_s:
        while time.monotonic() < now_s + 1.0 / TICKS_HZ:
            disturbances += disturb() is not None
        began_ns = time.thread_time_ns()
        receiver.receive()
        receiver.foreign_peers()
        spent_ns += time.thread_time_ns() - began_ns
        ticks += 1
    return spent_ns / ticks / 1e3, disturbances / FLOOD_S


def forger(at: Address) -> Callable[[], object]:
    """Connects, sends what is no handshake, and leaves."""

    def connect() -> bool:
        with socket.socket(socket.AF_UNIX) as one:
            one.connect(at.where.removeprefix("ipc://"))
            one.sendall(b"x" * 100)
        return True

    return connect


if __name__ == "__main__":
    main()
