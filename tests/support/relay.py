"""A relay between laptop and joints on one host: TCP and UDP on one port, a cut and a delay.

A cut keeps what TCP carries and drops packets, as the air does under TCP's repetitions; `frames_wait` keeps only what
TCP carries.
"""

from __future__ import annotations

import heapq
import selectors
import socket
import struct
import threading
import time
from contextlib import suppress
from itertools import count

CHUNK = 65536


class Relay:
    """Forwards from its own port to another of loopback while the body runs."""

    def __init__(self, to_port: int) -> None:
        self.cut = self.frames_wait = self._must_reset = False
        self.delay_s = 0.0
        self.connections = 0  # of the laptop, so far
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

    def reset(self) -> None:
        """Every TCP connection ends by a reset, as from a router that was switched off and on."""
        self._must_reset = True

    def _run(self) -> None:
        while not self._ending.is_set():
            if self._must_reset:
                self._must_reset = False
                for one in (*self._pairs,):
                    one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    self._selector.unregister(one)
                    one.close()
                self._pairs.clear()
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
        self.connections += 1
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
