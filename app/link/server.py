"""The exoskeleton's computer: one port, paired laptops only, one session at a time. `rleex joints` runs it.

A single thread waits for the frames (TCP), the packets (UDP) and control's snapshots. It decides nothing about legs
and holds no motion up: control has its own process.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor

import msgspec

from app.ipc.messages import LinkHealth
from app.ipc.streams import LINK, NS_PER_MS
from app.link.keys import peers_of
from app.link.laptop import Laptop
from app.link.packets import SEALED
from app.link.pairing import PairingDesk
from app.link.port import JointsPort, Where
from app.link.questions import Answer, Question, Who, as_read_there, check_version, encode, here, question_in
from app.link.served import ServedSession, not_started, own_config
from app.link.wire import VERSION, FromLaptop, Hello, LinkFault, LinkNotice, Refused, Welcome, program
from app.system.diagnostics_log import get_logger
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.errors import UNDECODABLE, CodedError
from logs.reason import reason_of

_log = get_logger("link")

WAIT_MS = 5
END_SENT_NS = 5_000 * NS_PER_MS  # a laptop is told so long that its session is over
LAST_SENT_NS = 1_000 * NS_PER_MS  # the same where this process ends, and the laptop does not confirm


class _Version(msgspec.Struct, tag="hello"):
    """What every version's greeting has."""

    link: int
    program: str


class JointsServer:
    """Owns the port and the session."""

    def __init__(self, home: Home, port: int, workers: Executor) -> None:
        """workers: start and end sessions, with the usual scheduling. Raises AppError when the port can't be had."""
        self._home, self._workers = home, workers
        self._port = JointsPort(home, port)
        self._desk = PairingDesk(home)
        self._decode = msgspec.msgpack.Decoder(FromLaptop)
        self._encode = msgspec.msgpack.Encoder().encode
        self._laptop: Laptop | None = None
        self._session = ServedSession.resumed(home, workers)
        self._resuming = self._session is not None  # its laptop may still send to the process before
        self._ended_ns = 0
        self._ended_frame = 0  # the first frame behind this one says so
        self._foreign = 0
        self._connections = 0
        self._must_end = False
        self._health_ns = 0
        self._wait_for_snapshots()

    def end(self) -> None:
        """Bring the legs to rest and end."""
        self._must_end = True

    def run(self, watch: Callable[[str], None] = lambda _: None) -> None:
        """Until asked to end."""
        watch("ready")
        while not self._done():
            self._port.wait(WAIT_MS)
            now_ns = time.monotonic_ns()
            for identity, user, content in self._port.frames():
                self._take_frame(identity, user, content)
            for datagram, where in self._port.packets():
                self._take_packet(datagram, where, time.monotonic_ns())
            self._foreign += self._port.foreign_peers()
            self._serve(now_ns)

    def close(self) -> None:
        """Release the port."""
        self._port.close()

    def _done(self) -> bool:
        if self._must_end and self._session is not None:
            self._session.end()
        return self._must_end and self._session is None  # the laptop has been told

    def _serve(self, now_ns: int) -> None:
        session, laptop = self._session, self._laptop
        if session is None:
            return
        session.poll()
        if session.ended:
            self._tell_end(now_ns, session)
            return
        if laptop is not None:
            session.commands.take_over_if_due(now_ns)
            self._send_frame(laptop, now_ns)
            self._send_packet(laptop, now_ns)
        if now_ns - self._health_ns >= LINK.period_ns:
            self._health_ns = now_ns
            session.health.send(self._link_health(now_ns))
        record = None if laptop is None else laptop.other_trail(now_ns)
        if record is not None:
            session.record(record)

    def _tell_end(self, now_ns: int, session: ServedSession) -> None:
        laptop = self._laptop
        if not self._ended_ns:
            self._ended_ns, self._ended_frame = now_ns, 0 if laptop is None else laptop.flight.sent
        if laptop is not None and now_ns - self._ended_ns < (LAST_SENT_NS if self._must_end else END_SENT_NS):
            self._send_frame(laptop, now_ns)
            if not self._must_end or laptop.flight.acknowledged <= self._ended_frame:
                return
        self._forget(session)

    def _forget(self, session: ServedSession) -> None:
        session.close_links()
        self._session = self._laptop = None
        self._resuming = False
        self._ended_ns = 0
        self._wait_for_snapshots()

    # --- frames ---------------------------------------------------------------------------------------------------

    def _take_frame(self, identity: bytes, user: str, content: bytes) -> None:
        try:
            message = self._decode.decode(content)
        except UNDECODABLE:
            self._refuse_other_version(identity, content)
            return
        if isinstance(message, Hello):
            self._greet(identity, user, message)
        elif self._laptop is not None and identity == self._laptop.identity:
            self._laptop.take_frame(message, time.monotonic_ns())
        elif not self._resuming and (self._laptop is None or user != self._laptop.user):
            self._foreign += 1  # the laptop's own key: ZeroMQ connected anew by itself, and no greeting was repeated

    def _refuse_other_version(self, identity: bytes, content: bytes) -> None:
        self._foreign += 1
        try:
            greeting = msgspec.msgpack.decode(content, type=_Version)
            check_version("laptop", greeting.link, greeting.program)
        except UNDECODABLE:
            return
        except AppError as error:
            self._send(identity, Refused(reason=as_read_there(reason_of(error))))

    def _greet(self, identity: bytes, user: str, hello: Hello) -> None:
        try:
            check_version("laptop", hello.link, hello.program)
            self._admit(identity, user, hello)
        except (CodedError, OSError) as error:
            why = not_started(error)
            _log.warning("laptop refused", why=str(error))
            if self._session is not None:
                self._session.note(LinkNotice.PEER_REFUSED, why=why)
            self._send(identity, Refused(reason=as_read_there(why)))
            return
        assert self._laptop is not None
        seal = self._laptop.seal
        self._send(identity, Welcome(link=VERSION, program=program(), connection=seal.connection, packet_key=seal.key))

    def _admit(self, identity: bytes, user: str, hello: Hello) -> None:
        session, laptop, request = self._session, self._laptop, hello.request
        if session is not None and session.name != request.session:
            knows_end = session.ended and laptop is not None and laptop.user == user  # it asks for its next one
            if self._must_end or not knows_end:
                raise AppError(LinkFault.SESSION_RUNS, session=session.name)
            self._forget(session)
            session = laptop = None
        if laptop is not None and laptop.user != user:
            raise AppError(LinkFault.ANOTHER_LAPTOP, session=request.session)
        if laptop is not None:
            laptop.reconnect(identity)
            return
        name = self._name_of(user)
        if session is None:
            if (self._home.logs / f"{request.session}.jsonl").exists():
                raise AppError(LinkFault.SESSION_OVER, session=request.session)
            session = self._session = ServedSession.begun(self._home, own_config(self._home), request, self._workers)
            self._foreign = 0  # control counts anew with each session
            self._wait_for_snapshots()
        session.commands.commanded_by(hello.operator)
        self._connections += 1
        self._laptop = Laptop(session, identity, user, name, self._connections)
        session.note(LinkNotice.LAPTOP_CAME, laptop=name)

    def _send_frame(self, laptop: Laptop, now_ns: int) -> None:
        frame = laptop.next_frame(now_ns)
        if frame is not None:
            self._send(laptop.identity, frame)

    def _send(self, identity: bytes, message: msgspec.Struct) -> None:
        self._port.send_frame(identity, self._encode(message))

    # --- packets --------------------------------------------------------------------------------------------------

    def _take_packet(self, datagram: bytes, where: Where, now_ns: int) -> None:
        laptop = self._laptop
        packet = laptop.seal.open(datagram) if laptop is not None else None
        if packet is not None and laptop is not None:
            self._resuming = False
            laptop.take_packet(packet, where, now_ns)
        elif (question := question_in(datagram)) is not None:
            self._answer(question, where, now_ns)
        elif not self._is_late(datagram):
            self._foreign += 1

    def _is_late(self, datagram: bytes) -> bool:
        """Whether a packet that was not taken may be the laptop's: overtaken, or sealed for the process before."""
        if self._resuming:
            return datagram[:1] == bytes([SEALED])
        return self._laptop is not None and self._laptop.seal.is_late(datagram)

    def _send_packet(self, laptop: Laptop, now_ns: int) -> None:
        datagram = laptop.next_packet(now_ns)
        if datagram is not None and laptop.where is not None:
            self._port.send_packet(datagram, laptop.where)

    def _answer(self, question: Question, where: Where, now_ns: int) -> None:
        if isinstance(question, Who):
            answer: Answer = here(question, now_ns, time.monotonic_ns())
        else:
            answer = self._desk.answer(question, time.time())
        self._port.send_packet(encode(answer), where)

    # --------------------------------------------------------------------------------------------------------------

    def _link_health(self, now_ns: int) -> LinkHealth:
        laptop = self._laptop
        if laptop is None:
            return LinkHealth(at_ns=now_ns, host="", connected=False, foreign_peers=self._foreign)
        return laptop.health(now_ns, self._foreign)

    def _name_of(self, user: str) -> str:
        return next((peer.name for peer in peers_of(self._home) if peer.public == user), "?")

    def _wait_for_snapshots(self) -> None:
        session = self._session
        self._port.wait_as_well_for(None if session is None else session.snapshots.socket)
