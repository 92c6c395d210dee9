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

from app.ipc import streams
from app.ipc.messages import STOP_KINDS, OperatorCommand, OperatorKind
from app.ipc.streams import NS_PER_MS
from app.link.beats import Beats, health_of
from app.link.clock import localized
from app.link.order import ConsoleCommands
from app.link.packets import PacketSeal
from app.link.questions import why_silent
from app.link.remote import Remote
from app.link.session_links import SessionLinks
from app.link.wire import LinkFault, LinkNotice, Refused, ToJoints, ToLaptop, Welcome
from app.system.config import SessionSetup
from app.system.diagnostics_log import get_logger
from app.system.scheduling import gc_freeze, set_scheduling
from logs.reading.errors import CodedError
from logs.reason import Reason, key_of, reason_of
from logs.records import Note, ProcessEnd, ProcessStart

_log = get_logger("link")

WAIT_MS = 5
SILENT_NS = 5_000 * NS_PER_MS  # then it is told that nobody answers; it goes on asking
FRAME_NS = 50 * NS_PER_MS  # without anything new
END_NS = 15_000 * NS_PER_MS  # the other computer holds, damps, disables and signs its trail


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
        self._setup = setup
        self._session = SessionLinks(setup)
        self._commands = ConsoleCommands()
        self._beats = Beats()
        self._seal: PacketSeal | None = None
        self._their: ToLaptop | None = None
        self._fault: Reason | None = None
        self._foreign = 0
        self._ending_ns = 0
        self._ended = False
        self._frame_ns = self._health_ns = 0
        self._began_ns = self._awaited_ns = time.monotonic_ns()  # awaited: a first answer, then the first frame
        self._remote = self._open_remote()

    def end(self) -> None:
        """Ask the other computer to end the session, and end with it."""
        self._ending_ns = self._ending_ns or time.monotonic_ns()

    def run(self) -> None:
        """Until the session has ended there, or it can't be reached to be ended."""
        self._session.record(ProcessStart(pid=os.getpid()))
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
        self._session.record(ProcessEnd(pid=os.getpid(), reason=self._fault))
        self._session.close()

    def _open_remote(self) -> Remote | None:
        try:
            remote = Remote(self._setup)
        except CodedError as error:
            self._fail(reason_of(error))
            _log.warning("link not opened", host=self._setup.config.joints.host, why=str(error))
            return None
        for socket in self._session.sockets:
            remote.poller.register(socket, zmq.POLLIN)
        return remote

    def _fail(self, why: Reason | None) -> None:
        if why is not None and why != self._fault:
            self._session.record(Note(text=why))
        self._fault = why

    def _done(self, now_ns: int) -> bool:
        if self._setup.orphaned:
            self.end()  # as control on one host
        # Without a console control there counts its own time, and then damps for longer: it is not asked to end.
        silent_ns = now_ns - max(self._commands.heartbeat_ns, self._began_ns)
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
        for command in self._session.commands():
            self._take_command(command)
        self._session.poll()

    def _take_command(self, command: OperatorCommand) -> None:
        if command.kind is OperatorKind.TAKE_OVER and self._remote is not None:
            self._remote.commanded_by(command.operator)
        queued = self._commands.add(command)
        if command.kind in STOP_KINDS and self._remote is not None:
            self._send_packet(self._remote, time.monotonic_ns())  # at once, not with the next one
        if not queued:
            self._session.note(LinkNotice.COMMANDS_LOST)

    def _publish(self, now_ns: int) -> None:
        if now_ns - self._health_ns < streams.LINK.period_ns:
            return
        self._health_ns = now_ns
        their = self._their
        if their is None and self._fault is None and now_ns - self._awaited_ns > SILENT_NS:
            self._fail(why_silent(self._setup.config.joints.host, SILENT_NS / 1e9))
        audit = None if their is None else their.audit
        health = health_of(self._beats, self._setup.config.joints.host, now_ns, self._foreign, audit)
        processes = () if their is None else their.processes
        stop = self._commands.stops.acknowledged
        self._session.publish_health(
            replace(health, fault=self._fault, processes=processes, stop_lease=stop.lease, stop_sequence=stop.sequence)
        )
        record = self._beats.other_trail(audit, now_ns)
        if record is not None:
            self._session.record(record)

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
        self._awaited_ns = time.monotonic_ns()
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
        self._commands.outbox.acknowledge(frame.commands)
        if frame.fault is not None:
            self._fail(frame.fault)
        if frame.ended:
            self._ended, self._health_ns = True, 0  # the console is told why at once
        if clock is None:
            return
        self._fail(frame.fault)  # the link is up: a fault from before it is over
        clock = clock.at(now_ns)
        audit = None if frame.audit is None else localized(frame.audit, clock)
        self._their = replace(frame, audit=audit)
        self._session.publish(frame, clock)

    def _take_packet(self, remote: Remote, datagram: bytes, now_ns: int) -> None:
        """A packet, or what is none."""
        packet = None if self._seal is None else self._seal.open(datagram)
        if packet is None:
            self._foreign += self._seal is None or not self._seal.is_late(datagram)
            return
        silent_ns = self._beats.take(packet, now_ns)
        if silent_ns:
            remote.expect_soon(self._beats.quality.round_trip_ns)
            self._session.note(LinkNotice.PACKETS_RETURNED, silent_s=silent_ns / 1e9)
        for notice, step_s in self._beats.new_steps():
            self._session.note(notice, step_s=step_s)
        if self._commands.stops.acknowledge(packet.stops):
            self._health_ns = 0  # the console is told at once

    def _send(self, remote: Remote, now_ns: int) -> None:
        silent = self._beats.lost(now_ns)
        if remote.must_reconnect(now_ns, packets_lost=self._beats.newest_ns > 0 and silent):
            remote.connect(now_ns, silent=silent)
        if self._seal is None:
            return
        if self._beats.due(now_ns):
            self._send_packet(remote, now_ns)
        outbox = self._commands.outbox
        due = self._session.report is not None or remote.commands_sent < outbox.first + len(outbox.next) - 1
        if remote.may_send and (due or now_ns - self._frame_ns >= FRAME_NS):
            self._send_frame(remote, now_ns)

    def _send_frame(self, remote: Remote, now_ns: int) -> None:
        self._frame_ns = now_ns
        outbox = self._commands.outbox
        waiting = outbox.next
        frame = ToJoints(
            number=remote.flight.send(now_ns),
            acknowledged=remote.flight.received,
            report=self._session.report,
            first_command=outbox.first,
            commands=waiting,
            audit=self._session.audit(now_ns),
            ends=bool(self._ending_ns),
        )
        self._session.report = None
        remote.commands_sent = outbox.first + len(waiting) - 1
        remote.send(frame)

    def _send_packet(self, remote: Remote, now_ns: int) -> None:
        if self._seal is None:
            return
        packet = self._commands.on(self._beats.next(now_ns, time.time_ns()))
        remote.send_packet(self._seal.seal(packet))
