"""The exoskeleton's computer's one port: frames (TCP, ZeroMQ, CURVE; paired keys only) and packets (UDP)."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from typing import NamedTuple

import zmq
from zmq.auth.thread import ThreadAuthenticator

from app.ipc.links import HandshakeMonitor
from app.link.keys import own_key, peers_of
from app.link.packets import MAX_BYTES
from app.link.wire import LinkFault
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.errors import CodedError

FRAMES_A_ROUND = 64
PACKETS_A_ROUND = 512
MAX_FRAME = 1 << 18
HANDSHAKE_S = 5.0  # over the air each of its round trips may be repeated
_IP_PKTINFO = 8  # Linux, ip(7); `socket` has no name for it before Python 3.14
# struct in_pktinfo: interface, our own address, the address in the packet's head
_PACKET_INFO = struct.Struct("=i4s4s")


class Where(NamedTuple):
    """Where a packet came from, and which of our addresses it was sent to."""

    peer: tuple[str, int]
    own: bytes


class _Paired:
    """ZeroMQ's question whether a key is admitted (ZAP, RFC 27): asked at each connection, from a thread of its own."""

    def __init__(self, home: Home) -> None:
        self._home = home

    def callback(self, _domain: str, key: bytes) -> bool:
        """Only paired ones; an unreadable list admits nobody."""
        try:
            return key.decode() in {peer.public for peer in peers_of(self._home)}
        except CodedError:
            return False


class JointsPort:
    """Receiving never blocks, sending never waits."""

    def __init__(self, home: Home, port: int) -> None:
        """Raises AppError when the port can't be had, or the keys can't be read."""
        key = own_key(home)
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._keeper = ThreadAuthenticator(self._context)
        self._keeper.start()
        self._keeper.configure_curve_callback("*", _Paired(home))
        self._frames = self._context.socket(zmq.ROUTER)
        self._packets = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._monitor = HandshakeMonitor(self._frames, bound=True, period_s=HANDSHAKE_S)
        self._malformed = 0
        self._beside: zmq.Socket[bytes] | None = None
        try:
            self._open(key.secret.encode(), port)
        except OSError as error:
            self.close()
            raise AppError(LinkFault.PORT_TAKEN, port=port, detail=error.strerror or str(error)) from error
        self._poller = zmq.Poller()
        self._poller.register(self._frames, zmq.POLLIN)
        self._poller.register(self._packets, zmq.POLLIN)

    def wait(self, limit_ms: int) -> None:
        """Until something comes."""
        self._poller.poll(limit_ms)

    def wait_as_well_for(self, beside: zmq.Socket[bytes] | None) -> None:
        """Another socket that ends the waiting, in place of an earlier one."""
        if self._beside is not None:
            self._poller.unregister(self._beside)
        if beside is not None:
            self._poller.register(beside, zmq.POLLIN)
        self._beside = beside

    def frames(self) -> Iterator[tuple[bytes, str, bytes]]:
        """What came: connection, key of its computer, content."""
        for _ in range(FRAMES_A_ROUND):
            try:
                parts = self._frames.recv_multipart(zmq.NOBLOCK, copy=False)
            except zmq.Again:
                return
            if len(parts) == 2:
                yield parts[0].bytes, str(parts[1].get("User-Id")), parts[1].bytes
            else:
                self._malformed += 1

    def packets(self) -> Iterator[tuple[bytes, Where]]:
        """What came, whatever it is."""
        for _ in range(PACKETS_A_ROUND):
            try:
                datagram, beside, _, peer = self._packets.recvmsg(MAX_BYTES + 1, socket.CMSG_SPACE(_PACKET_INFO.size))
            except (BlockingIOError, ConnectionError):
                return
            _, own, _ = _PACKET_INFO.unpack(beside[0][2])
            yield datagram, Where(peer, own)

    def send_frame(self, connection: bytes, content: bytes) -> None:
        """To one that has gone, or whose queue is full: nothing. It asks again."""
        try:
            self._frames.send_multipart([connection, content], zmq.NOBLOCK)
        except zmq.ZMQError:
            return

    def send_packet(self, datagram: bytes, where: Where) -> None:
        """From the address that was asked; without a way there it is lost, as on the air: the next is due in 20 ms."""
        # With two interfaces in one network the kernel would choose the other one's, which no asker listens to.
        beside = (socket.IPPROTO_IP, _IP_PKTINFO, _PACKET_INFO.pack(0, where.own, bytes(4)))
        try:
            self._packets.sendmsg([datagram], [beside], 0, where.peer)
        except OSError:
            return

    def foreign_peers(self) -> int:
        """Connections that did not complete the handshake and frames that are none, since the last time."""
        malformed, self._malformed = self._malformed, 0
        return malformed + self._monitor.count(time.monotonic())

    def close(self) -> None:
        """Release it."""
        self._monitor.close()
        self._frames.close(linger=200)
        self._packets.close()
        self._keeper.stop()
        self._context.term()

    def _open(self, secret: bytes, port: int) -> None:
        options = (
            (zmq.LINGER, 0),
            (zmq.CURVE_SERVER, 1),
            (zmq.CURVE_SECRETKEY, secret),
            (zmq.MAXMSGSIZE, MAX_FRAME),
            (zmq.SNDHWM, 32),
            (zmq.RCVHWM, 32),
            (zmq.HEARTBEAT_IVL, 2_000),
            (zmq.HEARTBEAT_TIMEOUT, 10_000),
        )
        for option, value in options:
            self._frames.setsockopt(option, value)
        self._packets.setblocking(False)
        self._packets.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)
        try:
            self._frames.bind(f"tcp://*:{port}")
        except zmq.ZMQError as error:
            raise OSError(error.errno, error.strerror) from error
        self._packets.bind(("0.0.0.0", port))
