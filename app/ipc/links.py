"""Links between processes: pyzmq over a private ipc directory, msgspec messages, validated on arrival.

Two kinds, no third: *latest only* (conflating PUB/SUB) and *ordered* (PUSH/PULL with a bounded queue, a full
queue is told to the sender, never a silent drop). Receiving never blocks unless a timeout is given.

Every connection is CURVE (CurveZMQ, RFC 26): a peer without the session's key fails the handshake in ZeroMQ's own
thread, so its messages never reach a queue; a recorded message fits no other connection.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import UnionType
from typing import Any, Generic, TypeVar

import msgspec
import zmq

from app.ipc.streams import LinkDirectory
from logs.reading.errors import UNDECODABLE

_log = logging.getLogger("rleex.links")  # this room imports nothing of app: the engineers' log takes both kinds

M = TypeVar("M", bound=msgspec.Struct)

_POLLIN = int(zmq.POLLIN)
_ORDERED_QUEUE = 20_000  # messages; an audit burst of a second at ten thousand a second fits twice
_END_LINGER_MS = 500
PEERS_PERIOD_S = 0.5  # foreign peers are told at most so often: a flood is one number
_EVENTS_A_CALL = 64  # about 0.2 ms: a tick has 2
# For the last message of a process that ends: the guardian and consoles must learn how.
LAST_QUEUE = 64  # messages; more only wait for a process that stands still
LAST_S = 0.1
_monitors = count()


def new_link_directory(path: Path) -> LinkDirectory:
    """A directory with a new key to it."""
    public, secret = zmq.curve_keypair()
    return LinkDirectory(path=path, public=public, secret=secret)


class Address(msgspec.Struct, frozen=True):
    """A link's name on the host, and the directory whose key opens it."""

    where: str
    links: LinkDirectory


def address(links: LinkDirectory, name: str) -> Address:
    """The ipc address of a named link of a session."""
    return Address(f"ipc://{links.path / name}.sock", links)


class _Link:
    """A socket that closes without lingering."""

    def __init__(self, kind: int, at: Address) -> None:
        self.where = at.where
        self._at = at
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        self.socket = self._context.socket(kind)  # may be waited for beside others, in a poller
        self.socket.setsockopt(zmq.LINGER, 0)
        self._monitor: HandshakeMonitor | None = None
        self.rejected = 0  # messages that did not validate

    def foreign_peers(self) -> int:
        """How many peers without the session's key were turned away, told once in PEERS_PERIOD_S; 0 in between."""
        if self._monitor is None:
            self._monitor = HandshakeMonitor(self.socket, bound=self._bound)
        peers = self._monitor.count(time.monotonic())
        if peers:
            _log.warning("foreign peers", extra={"link": self.where, "peers": peers})
            if not self._bound:  # ZeroMQ gives up a server without the key for good: the true one may come back
                self.socket.disconnect(self.where)
                self.socket.connect(self.where)
        return peers

    def close(self, linger_s: float = 0.0) -> None:
        """Release the socket, giving queued messages up to `linger_s` to leave; harmless when done twice."""
        if self._monitor is not None:
            self._monitor.close()
            self._monitor = None
        self.socket.close(linger=int(linger_s * 1000))

    def _open(self, *, bind: bool) -> None:
        """Bind or connect, after the socket's other options."""
        self._bound = bind
        if bind:
            self.socket.setsockopt(zmq.CURVE_SERVER, 1)
            self.socket.setsockopt(zmq.CURVE_SECRETKEY, self._at.links.secret)
            self.socket.bind(self.where)
            return
        public, secret = zmq.curve_keypair()  # of this connection alone; the server's key decides
        self.socket.setsockopt(zmq.CURVE_SERVERKEY, self._at.links.public)
        self.socket.setsockopt(zmq.CURVE_PUBLICKEY, public)
        self.socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
        self.socket.setsockopt(zmq.RECONNECT_IVL, 20)
        self.socket.connect(self.where)

    def _reject(self) -> None:
        self.rejected += 1
        _log.warning("message rejected", extra={"link": self.where, "rejected": self.rejected})

    def _has_come(self, timeout_s: float) -> bool:
        """Asked before receiving: on a link that is empty most of the time, the exception would cost more."""
        if timeout_s > 0:
            return bool(self.socket.poll(int(timeout_s * 1000)))
        return bool(int(self.socket.getsockopt(zmq.EVENTS)) & _POLLIN)


class HandshakeMonitor:
    """Counts a socket's peers that did not complete the handshake.

    A bound end counts who connected and did not succeed within a period, whatever it sent or did not send; the other
    end counts servers that could not show the key.
    """

    def __init__(self, socket: zmq.Socket[bytes], *, bound: bool, period_s: float = 0.0) -> None:
        """period_s: how long a handshake may take, and twice that at most; 0: as on one host, `PEERS_PERIOD_S`."""
        self._socket = socket
        self._period_s = period_s or PEERS_PERIOD_S
        self._change = {zmq.EVENT_ACCEPTED: 1, zmq.EVENT_HANDSHAKE_SUCCEEDED: -1}
        if not bound:
            self._change = {zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL: 1, zmq.EVENT_HANDSHAKE_FAILED_AUTH: 1}
        self._events: zmq.Socket[bytes] | None = None
        self._until_s = 0.0
        self._older = self._newer = 0  # peers in their handshake since before this period, and since then

    def count(self, now_s: float) -> int:
        """The peers turned away, at the end of each period."""
        if now_s < self._until_s:  # looking at a socket is a call of the kernel: not in every tick
            return 0
        self._until_s = now_s + self._period_s
        self._take()
        turned_away, self._older, self._newer = self._older, self._newer, 0
        if self._events is None:
            self._listen()
        return turned_away

    def close(self) -> None:
        """Stop listening: the socket first, for it would wait for its listener."""
        if self._events is not None:
            self._socket.disable_monitor()
            self._events.close(linger=0)
            self._events = None

    def _listen(self) -> None:
        where = f"inproc://handshakes-{next(_monitors)}"
        mask = 0
        for event in self._change:
            mask |= event
        self._socket.monitor(where, mask)
        self._events = self._socket.context.socket(zmq.PAIR)
        self._events.setsockopt(zmq.RCVHWM, 0)  # else a full queue would stop the socket itself
        self._events.connect(where)

    def _take(self) -> None:
        if self._events is None:
            return
        for _ in range(_EVENTS_A_CALL):
            if not int(self._events.getsockopt(zmq.EVENTS)) & _POLLIN:
                return
            event = zmq.Event(int.from_bytes(self._events.recv_multipart()[0][:2], sys.byteorder))
            change = self._change.get(event, 0)
            if change < 0 and self._older:
                self._older -= 1
            else:
                self._newer = max(0, self._newer + change)
        self.close()  # a flood: enough until the period ends


class Publisher(_Link):
    """Sends the newest of something to whoever listens; binds."""

    def __init__(self, at: Address, *, queue: int = 0) -> None:
        """queue: so many messages may wait, and the last one arrives though the socket is closed behind it.

        Without a queue a newer message replaces an older one, and the close may replace the last: ZeroMQ marks the
        end of a connection by a message of its own, and a conflating queue has one place.
        """
        super().__init__(zmq.PUB, at)
        if queue:
            self.socket.setsockopt(zmq.SNDHWM, queue)
        else:
            self.socket.setsockopt(zmq.CONFLATE, 1)  # else a full queue would drop the newest and keep the old
        self._open(bind=True)
        self._encode = msgspec.msgpack.Encoder().encode

    def send(self, message: msgspec.Struct) -> None:
        """Never blocks; a slow listener misses older messages."""
        self.socket.send(self._encode(message), zmq.NOBLOCK)


class LatestReceiver(_Link, Generic[M]):
    """Keeps the newest message of one publisher."""

    def __init__(self, at: Address, kind: type[M] | UnionType) -> None:
        super().__init__(zmq.SUB, at)
        self.socket.setsockopt(zmq.CONFLATE, 1)
        self.socket.setsockopt(zmq.SUBSCRIBE, b"")
        self._open(bind=False)
        self._decoder: msgspec.msgpack.Decoder[M] = msgspec.msgpack.Decoder(kind)

    def receive(self, timeout_s: float = 0.0) -> M | None:
        """The newest message not yet taken, or None. A malformed one is counted in `rejected`."""
        if not self._has_come(timeout_s):
            return None
        try:
            return self._decoder.decode(self.socket.recv(zmq.NOBLOCK))
        except zmq.Again:
            return None
        except UNDECODABLE:
            self._reject()
            return None


class OrderedSender(_Link):
    """Sends everything, in order, to one receiver; connects."""

    def __init__(
        self, at: Address, *, enc_hook: Callable[[Any], Any] | None = None, queue: int = _ORDERED_QUEUE
    ) -> None:
        """enc_hook: msgspec's, for types that it does not know. queue: so many messages may wait."""
        super().__init__(zmq.PUSH, at)
        self.socket.setsockopt(zmq.SNDHWM, queue)
        self._open(bind=False)
        self._encode = msgspec.msgpack.Encoder(enc_hook=enc_hook).encode

    def send(self, message: msgspec.Struct) -> bool:
        """Queue it; False when the queue is full, and then the caller must act on it."""
        try:
            self.socket.send(self._encode(message), zmq.NOBLOCK)
        except zmq.Again:
            return False
        return True


class OrderedReceiver(_Link, Generic[M]):
    """Receives everything, in order; binds."""

    def __init__(
        self,
        at: Address,
        kind: type[M] | UnionType,
        *,
        dec_hook: Callable[[type, Any], Any] | None = None,
        queue: int = _ORDERED_QUEUE,
    ) -> None:
        """dec_hook: msgspec's, for types that it does not know. queue: so many messages may wait."""
        super().__init__(zmq.PULL, at)
        self.socket.setsockopt(zmq.RCVHWM, queue)
        self._open(bind=True)
        self._decoder: msgspec.msgpack.Decoder[M] = msgspec.msgpack.Decoder(kind, dec_hook=dec_hook)

    def receive(self, timeout_s: float = 0.0) -> M | None:
        """The next message, or None. A malformed one is counted in `rejected` and skipped."""
        while self._has_come(timeout_s):
            try:
                return self._decoder.decode(self.socket.recv(zmq.NOBLOCK))
            except zmq.Again:
                return None
            except UNDECODABLE:
                self._reject()
                timeout_s = 0.0
        return None


def start_links() -> None:
    """Start ZeroMQ's own threads, which carry every message; they inherit the scheduling of the first call."""
    zmq.Context.instance().socket(zmq.PAIR).close()


def end_links() -> None:
    """Close what is left and let queued messages leave: a process that ends without it takes its last words along."""
    zmq.Context.instance().destroy(linger=_END_LINGER_MS)
