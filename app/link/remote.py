"""The laptop's sockets to the exoskeleton's computer: packets, and frames, whose connection is made anew if stalled."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import suppress
from threading import Thread

import msgspec
import zmq

from app.ipc.streams import NS_PER_MS
from app.link.keys import joints_at, own_key
from app.link.order import Flight
from app.link.packets import MAX_BYTES
from app.link.questions import check_version, connected, resolve
from app.link.wire import VERSION, FromJoints, Hello, LinkFault, Refused, SessionRequest, ToLaptop, Welcome, program
from app.system.authority import DEMONSTRATION
from app.system.config import SessionSetup
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.errors import UNDECODABLE
from logs.reason import reason_of

# Nothing acknowledged for so long: a new connection, since TCP itself would wait longer. Doubled with each attempt:
# over a poor link a handshake takes seconds.
RETRY_NS, RETRY_AT_MOST_NS = 1_000 * NS_PER_MS, 8_000 * NS_PER_MS
GREETING_TRIPS = 8  # TCP, CURVE and the greeting take six round trips; what is given up earlier never succeeds
CONNECTED_FRAMES = 20  # acknowledged, a connection is as good as before


class Remote:
    """The sockets to the other computer: frames, made anew when they stall, and packets."""

    def __init__(self, setup: SessionSetup) -> None:
        """Raises AppError: not paired, an address that is none, no way there."""
        home, host = Home(setup.home), setup.config.joints.host
        peer = joints_at(home, host)
        if peer is None:
            raise AppError(LinkFault.NOT_PAIRED, host=host)
        self.host = host
        self._key, self._their_key = own_key(home), peer.public
        self._where = resolve(host)
        self._lookup: Thread | None = None
        self.poller = zmq.Poller()
        self._open_packets(connected(host, self._where))
        self._operator = ""  # who took over at the laptop
        self._request = SessionRequest(
            session=setup.session,
            profile=setup.profile,
            operator=setup.operator,
            role=setup.role,
            signed_in=setup.role not in ("", DEMONSTRATION),
        )
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._frames: zmq.Socket[bytes] | None = None
        self.flight = Flight()
        self.commands_sent = 0
        self._welcome = False
        self._connected_ns = 0
        self._patience_ns = RETRY_NS
        self._decode = msgspec.msgpack.Decoder(FromJoints)
        self._encode = msgspec.msgpack.Encoder().encode

    @property
    def may_send(self) -> bool:
        """Whether a frame may leave now."""
        return self._welcome and self.flight.is_open

    def must_reconnect(self, now_ns: int, *, packets_lost: bool) -> bool:
        """Whether the connection is not there or has stalled; packets_lost: they came, and have not for too long."""
        if self._frames is None:
            return True
        if not self._welcome or packets_lost:
            return now_ns - self._connected_ns > self._patience_ns
        return self.flight.waits_ns(now_ns) > self._patience_ns

    def expect_soon(self, round_trip_ns: int) -> None:
        """The way is open again: a connection that stalled meanwhile would go on late."""
        self._patience_ns = min(max(RETRY_NS, GREETING_TRIPS * round_trip_ns), RETRY_AT_MOST_NS)

    def commanded_by(self, operator: str) -> None:
        """Another operator took over at the laptop: `rleex joints` that is started again is told the name."""
        self._operator = operator

    def connect(self, now_ns: int, *, silent: bool = False) -> None:
        """A new connection, which greets; what was under way on the old one is repeated or newer now.

        silent: no packets come: the name may mean another address by now, which the next connection takes.
        """
        if silent and self._connected_ns:
            self._look_up()
        self._close_frames()
        self._renew_packets()
        frames = self._frames = self._context.socket(zmq.DEALER)
        options = (
            (zmq.LINGER, 0),
            (zmq.SNDHWM, 8),
            (zmq.RCVHWM, 32),
            (zmq.CURVE_SERVERKEY, self._their_key.encode()),
            (zmq.CURVE_PUBLICKEY, self._key.public.encode()),
            (zmq.CURVE_SECRETKEY, self._key.secret.encode()),
        )
        for option, value in options:
            frames.setsockopt(option, value)
        frames.connect(f"tcp://{self._where[0]}:{self._where[1]}")
        self.poller.register(frames, zmq.POLLIN)
        self.flight, self.commands_sent = Flight(), 0
        if self._connected_ns:
            self._patience_ns = min(2 * self._patience_ns, RETRY_AT_MOST_NS)
        self._welcome, self._connected_ns = False, now_ns
        self.send(Hello(link=VERSION, program=program(), request=self._request, operator=self._operator))

    def frames(self, now_ns: int) -> Iterator[Welcome | Refused | ToLaptop]:
        """What came; a greeting of another version is a refusal."""
        while self._frames is not None:
            try:
                content = self._frames.recv(zmq.NOBLOCK)
            except zmq.Again:
                return
            with suppress(*UNDECODABLE):
                yield self._taken(self._decode.decode(content), now_ns)

    def packets(self) -> Iterator[bytes]:
        """What came, whatever it is."""
        while True:
            try:
                yield self._packets.recv(MAX_BYTES + 1)
            except OSError:  # nothing came, or somebody on the way said that the other computer can't be reached
                return

    def send(self, message: msgspec.Struct) -> None:
        """Queue a frame; a full queue drops it, and the connection is made anew when nothing is acknowledged."""
        if self._frames is not None:
            try:
                self._frames.send(self._encode(message), zmq.NOBLOCK)
            except zmq.Again:
                return

    def send_packet(self, datagram: bytes) -> None:
        """One packet; without a way there it is lost, as on the air."""
        try:
            self._packets.send(datagram)
        except OSError:
            return

    def close(self) -> None:
        """Release the sockets."""
        self._close_frames(linger_ms=200)
        self._packets.close()
        self._context.term()

    def _look_up(self) -> None:
        """In a thread: a look-up may take seconds, and STOP leaves by this one."""
        if self._lookup is None or not self._lookup.is_alive():
            self._lookup = Thread(target=self._resolve, daemon=True)
            self._lookup.start()

    def _resolve(self) -> None:
        with suppress(AppError):  # without an answer the old one may be good again
            self._where = resolve(self.host)

    def _renew_packets(self) -> None:
        """A socket keeps the address that this computer had when it was opened."""
        try:
            new = connected(self.host, self._where)
        except AppError:  # no way there now: the old one may have one again
            return
        self.poller.unregister(self._packets)
        self._packets.close()
        self._open_packets(new)

    def _open_packets(self, packets: socket.socket) -> None:
        packets.setblocking(False)
        self._packets = packets
        self.poller.register(packets, zmq.POLLIN)

    def _close_frames(self, linger_ms: int = 0) -> None:
        if self._frames is not None:
            self.poller.unregister(self._frames)
            self._frames.close(linger=linger_ms)
            self._frames = None

    def _taken(self, message: Welcome | Refused | ToLaptop, now_ns: int) -> Welcome | Refused | ToLaptop:
        if isinstance(message, Welcome):
            try:
                check_version(self.host, message.link, message.program)
            except AppError as error:
                return Refused(reason=reason_of(error))
            self._welcome = True
        elif isinstance(message, ToLaptop):
            self.flight.receive(message.number, message.acknowledged, now_ns)
            if self.flight.acknowledged > CONNECTED_FRAMES:
                self._patience_ns = RETRY_NS
        return message
