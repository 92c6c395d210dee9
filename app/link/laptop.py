"""The laptop that commands, at the exoskeleton's computer: its frames and packets, into the session and back."""

from __future__ import annotations

import time

from msgspec.structs import replace

from app.ipc.messages import AuditHealth, LinkHealth
from app.ipc.streams import SNAPSHOT
from app.link.beats import Beats, health_of
from app.link.clock import localized
from app.link.order import Flight
from app.link.packets import PacketSeal, new_packet_key
from app.link.port import Where
from app.link.served import ServedSession
from app.link.wire import Packet, ToJoints, ToLaptop
from logs.records import OtherTrail


class Laptop:
    """The connection that commands a session: its key, its frames, its packets."""

    def __init__(self, session: ServedSession, identity: bytes, user: str, name: str, connection: int) -> None:
        self._session = session
        self.identity = identity
        self.user = user
        self.name = name  # as it is paired
        self.flight = Flight()
        self.seal = PacketSeal(connection=connection, key=new_packet_key(), at_joints=True)
        self.where: Where | None = None  # its packets come from there
        self._beats = Beats()
        self._frame_ns = 0  # when the newest one was sent
        self._audit: AuditHealth | None = None  # of its trail

    def reconnect(self, identity: bytes) -> None:
        """Frames are counted anew, packets go on."""
        self.identity, self.flight = identity, Flight()

    def take_frame(self, frame: ToJoints, now_ns: int) -> None:
        """Into the session, by this host's clock."""
        session, clock = self._session, self._beats.clock
        self.flight.receive(frame.number, frame.acknowledged, now_ns)
        if frame.ends:
            session.end()
        if clock is None:  # no moment of it could be told yet: its sender repeats what must arrive
            return
        if frame.audit is not None:
            self._audit = localized(frame.audit, clock.at(now_ns))
        if frame.report is not None:
            session.hand_report(frame.report, clock.at(now_ns))
        new = session.commands.inbox.take(frame.first_command, frame.commands)
        session.commands.take_over_if_due(now_ns)
        session.commands.hand(new, clock.at(now_ns), now_ns)

    def next_frame(self, now_ns: int) -> ToLaptop | None:
        """What is to be sent to it, when that is due and the connection is not full of older ones."""
        session = self._session
        if not self.flight.is_open or now_ns - self._frame_ns < SNAPSHOT.period_ns:
            return None
        self._frame_ns = now_ns
        return ToLaptop(
            number=self.flight.send(now_ns),
            acknowledged=self.flight.received,
            commands=session.commands.inbox.count,
            snapshot=session.shown(),
            guardian=session.guardian,
            audit=session.audit,
            processes=session.processes,
            ended=session.ended,
            fault=session.fault,
        )

    def take_packet(self, packet: Packet, where: Where, now_ns: int) -> None:
        """Into the session; the next one goes where this one came from."""
        beats, session, self.where = self._beats, self._session, where
        silent_ns = beats.take(packet, now_ns)
        session.commands.adopt_lease(packet.lease)
        for notice, step_s in beats.new_steps():
            session.note(notice, step_s=step_s)
        if silent_ns:
            session.commands.hand_return(silent_ns)
        clock = beats.stop_clock(now_ns)
        if clock is not None:
            session.commands.take_over_if_due(now_ns)
            session.commands.hand_stops(packet.stops, clock, now_ns, packet.acknowledged_ns, packet.lease)
        if beats.clock is not None:
            session.commands.hand_heartbeat(packet.heartbeat_ns, packet.lease, beats.clock.at(now_ns))

    def next_packet(self, now_ns: int) -> bytes | None:
        """Sealed, when it is due; None as well before its first one has told where to."""
        if self.where is None or not self._beats.due(now_ns):
            return None
        packet = self._beats.next(now_ns, time.time_ns())
        return self.seal.seal(replace(packet, stops=self._session.commands.stops))

    def health(self, now_ns: int, foreign: int) -> LinkHealth:
        """Of the link to it. foreign: peers turned away so far."""
        return health_of(self._beats, self.name, now_ns, foreign, self._audit)

    def other_trail(self, now_ns: int) -> OtherTrail | None:
        """The record of its trail, when that is due."""
        return self._beats.other_trail(self._audit, now_ns)
