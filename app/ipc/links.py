"""Links between processes: pyzmq over a private ipc directory, msgspec messages, validated on arrival.

Two kinds, no third: *latest only* (conflating PUB/SUB) and *ordered* (PUSH/PULL with a bounded queue, a full
queue is told to the sender, never a silent drop). Receiving never blocks unless a timeout is given.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from types import UnionType
from typing import Any, Generic, TypeVar

import msgspec
import zmq

_log = logging.getLogger("rleex.links")  # this room imports nothing of app: the engineers' log takes both kinds

M = TypeVar("M", bound=msgspec.Struct)

_POLLIN = int(zmq.POLLIN)
_ORDERED_QUEUE = 20_000  # messages; an audit burst of a second at ten thousand a second fits twice


def address(directory: Path, name: str) -> str:
    """The ipc address of a named link in a session's private directory."""
    return f"ipc://{directory / name}.sock"


class _Link:
    """A socket that closes without lingering."""

    def __init__(self, kind: int, where: str) -> None:
        self.where = where
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        self._socket = self._context.socket(kind)
        self._socket.setsockopt(zmq.LINGER, 0)
        self.rejected = 0  # messages that did not validate

    def close(self) -> None:
        """Release the socket; harmless when done twice."""
        self._socket.close()

    def _reject(self) -> None:
        self.rejected += 1
        _log.warning("message rejected", extra={"link": self.where, "rejected": self.rejected})

    def _has_come(self, timeout_s: float) -> bool:
        """Asked before receiving: on a link that is empty most of the time, the exception would cost more."""
        if timeout_s > 0:
            return bool(self._socket.poll(int(timeout_s * 1000)))
        return bool(int(self._socket.getsockopt(zmq.EVENTS)) & _POLLIN)


class Publisher(_Link):
    """Sends the newest of something to whoever listens; binds."""

    def __init__(self, where: str) -> None:
        super().__init__(zmq.PUB, where)
        self._socket.setsockopt(zmq.CONFLATE, 1)  # else a full queue would drop the newest and keep the old
        self._socket.bind(where)
        self._encode = msgspec.msgpack.Encoder().encode

    def send(self, message: msgspec.Struct) -> None:
        """Never blocks; a slow listener misses older messages."""
        self._socket.send(self._encode(message), zmq.NOBLOCK)

    def close(self, linger_s: float = 0.0) -> None:
        """Release the socket, giving the last message up to `linger_s` to leave."""
        self._socket.close(linger=int(linger_s * 1000))


class LatestReceiver(_Link, Generic[M]):
    """Keeps the newest message of one publisher."""

    def __init__(self, where: str, kind: type[M] | UnionType) -> None:
        super().__init__(zmq.SUB, where)
        self._socket.setsockopt(zmq.CONFLATE, 1)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        self._socket.setsockopt(zmq.RECONNECT_IVL, 20)
        self._socket.connect(where)
        self._decoder: msgspec.msgpack.Decoder[M] = msgspec.msgpack.Decoder(kind)

    def receive(self, timeout_s: float = 0.0) -> M | None:
        """The newest message not yet taken, or None. A malformed one is counted in `rejected`."""
        if not self._has_come(timeout_s):
            return None
        try:
            return self._decoder.decode(self._socket.recv(zmq.NOBLOCK))
        except zmq.Again:
            return None
        except msgspec.MsgspecError:
            self._reject()
            return None


class OrderedSender(_Link):
    """Sends everything, in order, to one receiver; connects, or binds when it is the fixed end."""

    def __init__(self, where: str, *, bind: bool = False, enc_hook: Callable[[Any], Any] | None = None) -> None:
        """enc_hook: msgspec's, for types that it does not know."""
        super().__init__(zmq.PUSH, where)
        self._socket.setsockopt(zmq.SNDHWM, _ORDERED_QUEUE)
        self._socket.setsockopt(zmq.RECONNECT_IVL, 20)
        if bind:
            self._socket.bind(where)
        else:
            self._socket.connect(where)
        self._encode = msgspec.msgpack.Encoder(enc_hook=enc_hook).encode

    def send(self, message: msgspec.Struct) -> bool:
        """Queue it; False when the queue is full, and then the caller must act on it."""
        try:
            self._socket.send(self._encode(message), zmq.NOBLOCK)
        except zmq.Again:
            return False
        return True

    def close(self, linger_s: float = 0.0) -> None:
        """Release the socket, giving queued messages up to `linger_s` to leave."""
        self._socket.close(linger=int(linger_s * 1000))


class OrderedReceiver(_Link, Generic[M]):
    """Receives everything, in order; binds, or connects when the sender is the fixed end."""

    def __init__(
        self,
        where: str,
        kind: type[M] | UnionType,
        *,
        bind: bool = True,
        dec_hook: Callable[[type, Any], Any] | None = None,
    ) -> None:
        """dec_hook: msgspec's, for types that it does not know."""
        super().__init__(zmq.PULL, where)
        self._socket.setsockopt(zmq.RCVHWM, _ORDERED_QUEUE)
        if bind:
            self._socket.bind(where)
        else:
            self._socket.connect(where)
        self._decoder: msgspec.msgpack.Decoder[M] = msgspec.msgpack.Decoder(kind, dec_hook=dec_hook)

    def receive(self, timeout_s: float = 0.0) -> M | None:
        """The next message, or None. A malformed one is counted in `rejected` and skipped."""
        while self._has_come(timeout_s):
            try:
                return self._decoder.decode(self._socket.recv(zmq.NOBLOCK))
            except zmq.Again:
                return None
            except msgspec.MsgspecError:
                self._reject()
                timeout_s = 0.0
        return None


def end_links(linger_s: float = 0.5) -> None:
    """Close what is left and let queued messages leave: a process that ends without it takes its last words along."""
    zmq.Context.instance().destroy(linger=int(linger_s * 1000))
