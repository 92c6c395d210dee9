"""What lies between laptop and joints in benches: two network namespaces.

Each namespace has a TUN device; a thread carries packets from one to the other as the conditions say: late, lost,
reordered, cut, with real TCP on top. Needs root.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

_CLONE_NEWNET = 0x40000000
_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
MTU = 1500
LAPTOP, JOINTS = "10.77.0.1", "10.77.0.2"


@dataclass(slots=True)
class Air:
    """Conditions, the same in both directions; may be changed at any time."""

    delay_s: float = 0.001
    jitter_s: float = 0.0  # evenly more delay up to this: packets overtake each other
    loss: float = 0.0
    cut: bool = False


def enter_namespace(name: str) -> None:
    """Move the calling thread, and threads and processes that it starts, into a namespace. Raises OSError."""
    handle = os.open(Path("/run/netns") / name, os.O_RDONLY)
    try:
        if ctypes.CDLL(None, use_errno=True).setns(handle, _CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"setns {name}")
    finally:
        os.close(handle)


@contextmanager
def two_namespaces(seed: int = 1) -> Iterator[tuple[str, str, Air]]:
    """Names of the laptop's and the joints' namespace, and the air between them, while the body runs."""
    names = tuple(f"rleex-{side}-{os.getpid()}" for side in ("laptop", "joints"))
    air, ending = Air(), threading.Event()
    tunnels: list[int] = []
    try:
        for name, own, other in zip(names, (LAPTOP, JOINTS), (JOINTS, LAPTOP), strict=True):
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
            tunnels.append(_tunnel_in(name))
            _ip("-n", name, "address", "add", own, "peer", other, "dev", "air0")
            _ip("-n", name, "link", "set", "air0", "up", "mtu", str(MTU))
        thread = threading.Thread(target=_carry, args=(tunnels, air, ending, random.Random(seed)), daemon=True)
        thread.start()
        yield names[0], names[1], air
        ending.set()
        thread.join()
    finally:
        ending.set()
        for tunnel in tunnels:
            os.close(tunnel)
        for name in names:
            with suppress(subprocess.CalledProcessError):
                _ip("netns", "delete", name)


def _tunnel_in(name: str) -> int:
    opened: list[int] = []

    def run() -> None:
        enter_namespace(name)
        handle = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        fcntl.ioctl(handle, _TUNSETIFF, struct.pack("16sH", b"air0", _IFF_TUN | _IFF_NO_PI))
        opened.append(handle)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return opened[0]


def _carry(tunnels: list[int], air: Air, ending: threading.Event, chance: random.Random) -> None:
    due: list[tuple[float, int, int, bytes]] = []
    order = count()
    while not ending.is_set():
        wait_s = max(0.0, min(0.01, due[0][0] - time.monotonic())) if due else 0.01
        for source in select.select(tunnels, [], [], wait_s)[0]:
            target = tunnels[1 - tunnels.index(source)]
            for packet in _waiting(source):
                if not air.cut and chance.random() >= air.loss:
                    at_s = time.monotonic() + air.delay_s + chance.random() * air.jitter_s
                    heapq.heappush(due, (at_s, next(order), target, packet))
        while due and due[0][0] <= time.monotonic():
            _, _, target, packet = heapq.heappop(due)
            with suppress(OSError):
                os.write(target, packet)


def _waiting(source: int) -> Iterator[bytes]:
    for _ in range(256):
        try:
            yield os.read(source, MTU)
        except OSError:
            return


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)
