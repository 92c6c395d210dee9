"""What lies between laptop and joints in tests and benches: a relay on one host, or two network namespaces.

The relay has TCP and UDP on one port, a cut and a delay. A cut keeps what TCP carries and drops packets, as the air
does under TCP's repetitions; `frames_wait` keeps only what TCP carries.

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
import selectors
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

CHUNK = 65536


class Relay:
    """Forwards from its own port to another of loopback while the body runs."""

    def __init__(self, to_port: int) -> None:
        self.cut = self.frames_wait = False
        self.delay_s = 0.0
        self.packets: list[bytes] = []  # from the laptop, newest last
        self._to = ("127.0.0.1", to_port)
        self._selector = selectors.DefaultSelector()
        self._due: list[tuple[float, int, socket.socket, bytes, tuple[str, int] | None]] = []
        self._order = count()
        self._pairs: dict[socket.socket, socket.socket] = {}
        self._laptop: tuple[str, int] | None = None
        self._tcp = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._tcp.getsockname()[1])
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", self.port))
        self._joints = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._joints.connect(self._to)
        for one in (self._tcp, self._udp, self._joints):
            one.setblocking(False)
            self._selector.register(one, selectors.EVENT_READ)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Relay:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        for one in (self._tcp, self._udp, self._joints, *self._pairs):
            one.close()
        self._selector.close()

    def _run(self) -> None:
        while not self._ending.is_set():
            for key, _ in self._selector.select(0.002):
                assert isinstance(key.fileobj, socket.socket)
                with suppress(OSError):
                    self._read(key.fileobj)
            self._deliver()

    def _read(self, source: socket.socket) -> None:
        if source is self._tcp:
            self._connect()
        elif source is self._udp:
            data, self._laptop = source.recvfrom(CHUNK)
            self.packets = [*self.packets[-99:], data]
            self._forward(self._joints, data, lossy=True)
        elif source is self._joints:
            if self._laptop is not None:
                self._forward(self._udp, source.recv(CHUNK), lossy=True, where=self._laptop)
        elif not (self.cut or self.frames_wait):  # else it waits where it is
            data = self._received(source)
            if data:
                self._forward(self._pairs[source], data)
            else:
                self._disconnect(source)

    def _received(self, source: socket.socket) -> bytes:
        """Empty when the connection has ended, however it did."""
        try:
            return source.recv(CHUNK)
        except ConnectionError:
            return b""

    def _connect(self) -> None:
        near, _ = self._tcp.accept()
        try:
            far = socket.create_connection(self._to)
        except OSError:  # nobody there: neither for whoever connected here
            near.close()
            return
        for one, other in ((near, far), (far, near)):
            one.setblocking(False)
            self._pairs[one] = other
            self._selector.register(one, selectors.EVENT_READ)

    def _disconnect(self, source: socket.socket) -> None:
        for one in (source, self._pairs[source]):
            self._selector.unregister(one)
            del self._pairs[one]
            one.close()

    def _forward(
        self, target: socket.socket, data: bytes, *, lossy: bool = False, where: tuple[str, int] | None = None
    ) -> None:
        if not (lossy and self.cut):
            heapq.heappush(self._due, (time.monotonic() + self.delay_s, next(self._order), target, data, where))

    def _deliver(self) -> None:
        while self._due and self._due[0][0] <= time.monotonic():
            _, _, target, data, where = heapq.heappop(self._due)
            with suppress(OSError):
                if where is None:
                    target.sendall(data) if target.type == socket.SOCK_STREAM else target.send(data)
                else:
                    target.sendto(data, where)


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
