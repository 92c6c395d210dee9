"""The therapist's laptop: a process of the session that stands in for control, whose computer is at the other end.

On the session's own links it receives the console's commands and perception's reports and publishes control's
snapshots, so that console and perception are the same as on one host.
"""

from __future__ import annotations

import os
import signal
import time
from contextlib import closing

import zmq
from msgspec.structs import replace

from app.audit.sink import AuditSink
from app.ipc import streams
from app.ipc.links import LatestReceiver, OrderedReceiver, Publisher, address
from app.ipc.messages import STOP_KINDS, AuditHealth, ControlSnapshot, OperatorCommand, OperatorKind, TriggerReport
from app.ipc.states import Event
from app.ipc.streams import NS_PER_MS
from app.link.beats import Beats, health_of, trail_health
from app.link.clock import localized
from app.link.order import Outbox, WaitingStops
from app.link.packets import PacketSeal
from app.link.questions import why_silent
from app.link.remote import Remote
from app.link.wire import LinkFault, LinkNotice, Refused, ToJoints, ToLaptop, Welcome, mark_of
from app.system.config import SessionSetup
from app.system.diagnostics_log import get_logger
from app.system.scheduling import gc_freeze, set_scheduling
from logs.reading.errors import CodedError
from logs.reason import Reason, key_of, reason, reason_of
from logs.records import EventRaised, Note, ProcessEnd, ProcessStart

_log = get_logger("link")

WAIT_MS = 5
SILENT_NS = 5_000 * NS_PER_MS  # then it is told that nobody answers; it goes on asking
FRAME_NS = 50 * NS_PER_MS  # without anything new
END_NS = 15_000 * NS_PER_MS  # the other computer holds, damps, disables and signs its trail
COMMANDS_A_ROUND = 64


def run_link(setup: SessionSetup) -> None:
    """Run until the session ends here or there."""
    set_scheduling("link")  # first: ZeroMQ's threads inherit it
    with closing(LinkClient(setup)) as link:
        signal.signal(signal.SIGTERM, lambda *_: link.end())
        gc_freeze()
        link.run()


class LinkClient:
    """Both ends of the laptop's side."""

    def __init__(self, setup: SessionSetup) -> None:
        links = setup.links
        self._setup = setup
        self._sink = AuditSink(links, "link", setup.operator)
        self._operator = OrderedReceiver(address(links, streams.OPERATOR.name), OperatorCommand)
        self._reports = LatestReceiver(address(links, streams.TRIGGER.name), TriggerReport)
        self._audits = LatestReceiver(address(links, streams.AUDIT_HEALTH.name), AuditHealth)
        self._snapshots = Publisher(address(links, streams.SNAPSHOT.name))
        self._guardian = Publisher(address(links, streams.GUARDIAN.name))
        self._health = Publisher(address(links, streams.LINK.name))
        self._links = (self._operator, self._reports, self._audits, self._snapshots, self._guardian, self._health)
        self._outbox = Outbox()
        self._beats = Beats()
        self._seal: PacketSeal | None = None
        self._report: TriggerReport | None = None  # not sent yet
        self._audit: AuditHealth | None = None
        self._their: ToLaptop | None = None
        self._stops = WaitingStops()
        self._acknowledged_ns = 0
        self._lease = 0
        self._heartbeat_ns = 0
        self._fault: Reason | None = None
        self._foreign = 0
        self._ending_ns = 0
        self._ended = False
        self._frame_ns = self._health_ns = 0
        self._began_ns = self._audit_ns = time.monotonic_ns()
        self._remote = self._open_remote()

    def end(self) -> None:
        """Ask the other computer to end the session, and end with it."""
        self._ending_ns = self._ending_ns or time.monotonic_ns()

    def run(self) -> None:
        """Until the session has ended there, or it can't be reached to be ended."""
        self._sink.emit(ProcessStart(pid=os.getpid()))
        while not self._done(time.monotonic_ns()):
            self._wait()
            now_ns = time.monotonic_ns()
            self._take_local()
            if self._remote is not None:
                self._take_remote(self._remote, now_ns)
                self._send(self._remote, now_ns)
            self._publish(now_ns)

    def close(self) -> None:
        """Release everything."""
        if self._remote is not None:
            self._remote.close()
        self._sink.emit(ProcessEnd(pid=os.getpid(), reason=self._fault))
        self._sink.close()
        for link in self._links:
            link.close()

    def _open_remote(self) -> Remote | None:
        try:
            remote = Remote(self._setup)
        except CodedError as error:
            self._fail(reason_of(error))
            _log.warning("link not opened", host=self._setup.config.joints.host, why=str(error))
            return None
        for link in (self._operator, self._reports):
            remote.poller.register(link.socket, zmq.POLLIN)
        return remote

    def _fail(self, why: Reason | None) -> None:
        if why is not None and why != self._fault:
            self._sink.emit(Note(text=why))
        self._fault = why

    def _done(self, now_ns: int) -> bool:
        if self._setup.orphaned:
            self.end()  # as control on one host
        # Without a console control there counts its own time, and then damps for longer: it is not asked to end.
        silent_ns = now_ns - max(self._heartbeat_ns, self._began_ns)
        unattended = not self._ending_ns and silent_ns > self._setup.config.unattended_s * 1e9
        # A greeting on its way may begin a session there, which is ended like one whose clock is not known yet.
        nothing_there = self._remote is None or (self._seal is None and self._fault is not None)
        late = self._ending_ns and now_ns - self._ending_ns > END_NS
        return self._ended or unattended or bool(self._ending_ns and nothing_there) or bool(late)

    def _wait(self) -> None:
        if self._remote is None:
            time.sleep(WAIT_MS / 1000)
        else:
            self._remote.poller.poll(WAIT_MS)

    # --- the session's own links ----------------------------------------------------------------------------------

    def _take_local(self) -> None:
        for _ in range(COMMANDS_A_ROUND):
            command = self._operator.receive()
            if command is None:
                break
            self._take_command(command)
        self._report = self._reports.receive() or self._report
        audit = self._audits.receive()
        if audit is not None:
            self._audit, self._audit_ns = audit, time.monotonic_ns()
        peers = sum(link.foreign_peers() for link in self._links)
        if peers:
            text = reason(Event.FOREIGN_PEER, count=peers)
            self._sink.emit(EventRaised(event=Event.FOREIGN_PEER.value, effect="note", text=text))

    def _take_command(self, command: OperatorCommand) -> None:
        if command.kind is OperatorKind.TAKE_OVER:
            if command.lease > self._lease:
                self._lease, self._acknowledged_ns = command.lease, 0
            if self._remote is not None:
                self._remote.commanded_by(command.operator)
        if command.kind is OperatorKind.HEARTBEAT:
            self._lease = self._lease or command.lease
            if command.lease == self._lease:
                self._heartbeat_ns = command.sent_ns
            return
        if command.kind is OperatorKind.ACKNOWLEDGE and command.lease == self._lease:
            self._acknowledged_ns = command.sent_ns
        if command.kind in STOP_KINDS:
            self._stops.add(mark_of(command))
            if self._remote is not None:
                self._send_packet(self._remote, time.monotonic_ns())  # at once, not with the next one
        if not self._outbox.add(command):
            self._sink.emit(Note(text=reason(LinkNotice.COMMANDS_LOST)))

    def _publish(self, now_ns: int) -> None:
        if now_ns - self._health_ns < streams.LINK.period_ns:
            return
        self._health_ns = now_ns
        their = self._their
        if their is None and self._fault is None and now_ns - self._began_ns > SILENT_NS:
            self._fail(why_silent(self._setup.config.joints.host, SILENT_NS / 1e9))
        audit = None if their is None else their.audit
        health = health_of(self._beats, self._setup.config.joints.host, now_ns, self._foreign, audit)
        processes = () if their is None else their.processes
        stop = self._stops.acknowledged
        self._health.send(
            replace(health, fault=self._fault, processes=processes, stop_lease=stop.lease, stop_sequence=stop.sequence)
        )
        record = self._beats.other_trail(audit, now_ns)
        if record is not None:
            self._sink.emit(record)

    # --- the other computer ---------------------------------------------------------------------------------------

    def _take_remote(self, remote: Remote, now_ns: int) -> None:
        for message in remote.frames(now_ns):
            if isinstance(message, Welcome):
                self._welcomed(message)
            elif isinstance(message, Refused):
                self._refused(message.reason)
            else:
                self._take_frame(message, now_ns)
        for datagram in remote.packets():
            self._take_packet(remote, datagram, time.monotonic_ns())

    def _welcomed(self, welcome: Welcome) -> None:
        """The session is there; the packets' key is the session's, also after a new connection."""
        if self._seal is None or self._seal.key != welcome.packet_key:
            self._seal = PacketSeal(connection=welcome.connection, key=welcome.packet_key, at_joints=False)
            self._beats = Beats()
        self._fail(None)

    def _refused(self, why: Reason) -> None:
        """Another session runs: this one, if it was admitted before, is over, and the frame that says so was lost."""
        runs = self._seal is not None and why.code == key_of(LinkFault.SESSION_RUNS)
        if runs or why.code == key_of(LinkFault.SESSION_OVER):
            self._ended, self._health_ns = True, 0  # the console is told why at once
        self._fail(why)

    def _take_frame(self, frame: ToLaptop, now_ns: int) -> None:
        """What control and the others there say."""
        clock = self._beats.clock
        self._outbox.acknowledge(frame.commands)
        if frame.fault is not None:
            self._fail(frame.fault)
        if frame.ended:
            self._ended, self._health_ns = True, 0  # the console is told why at once
        if clock is None:
            return
        clock = clock.at(now_ns)
        audit = None if frame.audit is None else localized(frame.audit, clock)
        newest = None if self._their is None else self._their.snapshot
        self._their = replace(frame, audit=audit)
        if frame.snapshot is not None and (newest is None or _is_newer(frame.snapshot, newest)):
            self._snapshots.send(localized(frame.snapshot, clock))
        if frame.guardian is not None:
            self._guardian.send(localized(frame.guardian, clock))

    def _take_packet(self, remote: Remote, datagram: bytes, now_ns: int) -> None:
        """A packet, or what is none."""
        packet = None if self._seal is None else self._seal.open(datagram)
        if packet is None:
            self._foreign += self._seal is None or not self._seal.is_late(datagram)
            return
        silent_ns = self._beats.take(packet, now_ns)
        if silent_ns:
            remote.expect_soon()
            self._note(LinkNotice.LINK_RETURNED, silent_s=silent_ns / 1e9)
        for notice, step_s in self._beats.new_steps():
            self._note(notice, step_s=step_s)
        if self._stops.acknowledge(packet.stops):
            self._health_ns = 0  # the console is told at once

    def _note(self, notice: LinkNotice, **values: object) -> None:
        self._sink.emit(Note(text=reason(notice, **values)))

    def _send(self, remote: Remote, now_ns: int) -> None:
        silent = self._beats.lost(now_ns)
        if remote.must_reconnect(now_ns, packets_lost=self._beats.newest_ns > 0 and silent):
            remote.connect(now_ns, silent=silent)
        if self._seal is None:
            return
        if self._beats.due(now_ns):
            self._send_packet(remote, now_ns)
        due = self._report is not None or remote.commands_sent < self._outbox.first + len(self._outbox.next) - 1
        if remote.may_send and (due or now_ns - self._frame_ns >= FRAME_NS):
            self._send_frame(remote, now_ns)

    def _send_frame(self, remote: Remote, now_ns: int) -> None:
        self._frame_ns = now_ns
        waiting = self._outbox.next
        frame = ToJoints(
            number=remote.flight.send(now_ns),
            acknowledged=remote.flight.received,
            report=self._report,
            first_command=self._outbox.first,
            commands=waiting,
            audit=trail_health(self._audit, self._audit_ns, now_ns),
            ends=bool(self._ending_ns),
        )
        self._report = None
        remote.commands_sent = self._outbox.first + len(waiting) - 1
        remote.send(frame)

    def _send_packet(self, remote: Remote, now_ns: int) -> None:
        if self._seal is None:
            return
        packet = replace(
            self._beats.next(now_ns, time.time_ns()),
            stops=self._stops.next,
            acknowledged_ns=self._acknowledged_ns,
            heartbeat_ns=self._heartbeat_ns,
            lease=self._lease,
        )
        remote.send_packet(self._seal.seal(packet))


def _is_newer(one: ControlSnapshot, other: ControlSnapshot) -> bool:
    return (one.incarnation, one.sequence) > (other.incarnation, other.sequence)
