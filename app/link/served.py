"""A session that the exoskeleton's computer runs for a laptop: its processes, and both ends of what crosses the link.

What comes from the laptop goes into the session's own links with its moments by this host's clock; control, guardian
and audit are the same as on one host and know nothing of it.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from concurrent.futures import Executor

from msgspec.structs import replace

from app.audit.sink import AuditSink
from app.ipc import streams
from app.ipc.links import LatestReceiver, OrderedSender, Publisher, address
from app.ipc.messages import (
    STOP_KINDS,
    AuditHealth,
    ControlSnapshot,
    GuardianHealth,
    OperatorCommand,
    OperatorKind,
    ProcessStatus,
    TriggerReport,
)
from app.link.beats import LOST_NS
from app.link.clock import ClockEstimate, localized
from app.link.order import Inbox
from app.link.wire import LinkFault, LinkNotice, SessionRequest, StopMark, mark_of
from app.session.host import SessionHost, make_setup
from app.session.shared import held_session
from app.system.authority import Proof
from app.system.config import Config, SessionSetup
from app.system.configure import record_outside_change
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.errors import CodedError
from logs.reason import Reason, reason, reason_of
from logs.records import Body, Note

_NAME = re.compile(r"[0-9]{8}T[0-9]{6}Z-[0-9a-f]{4}")
STOPS_KEPT = 32
# Sent so long ago they are not carried out any more. A stop, and what takes away, always is.
NEVER_STALE = frozenset(
    {*STOP_KINDS, OperatorKind.DISARM, OperatorKind.SHUT_DOWN, OperatorKind.TAKE_OVER, OperatorKind.HEARTBEAT}
)
REFUSED_BY_AGE = frozenset({OperatorKind.ARM, OperatorKind.ACT})  # by control, which shows why


class ServedSession:
    """One session from the request to its end. The link goes on while its processes start and end."""

    def __init__(self, setup: SessionSetup, workers: Executor, *, held: bool) -> None:
        """workers: start and end its processes meanwhile. held: they run, of an earlier process of this command."""
        self._workers = workers
        host = self._host = SessionHost(setup, without=frozenset({"perception", "link"}))
        host.silence()  # the laptop's heartbeats count, not this process's
        links = host.setup.links
        self._operator = OrderedSender(address(links, streams.OPERATOR.name))
        self._reports = Publisher(address(links, streams.TRIGGER.name))
        self.health = Publisher(address(links, streams.LINK.name))  # the link's quality, to control
        self.snapshots = LatestReceiver(address(links, streams.SNAPSHOT.name), ControlSnapshot)
        self._guardian = LatestReceiver(address(links, streams.GUARDIAN.name), GuardianHealth)
        self._audit = LatestReceiver(address(links, streams.AUDIT_HEALTH.name), AuditHealth)
        self._sink = AuditSink(links, "link", host.setup.operator)
        self.inbox = Inbox(resumed=held)
        self.snapshot: ControlSnapshot | None = None
        self.guardian: GuardianHealth | None = None
        self.audit: AuditHealth | None = None
        self.processes: tuple[ProcessStatus, ...] = ()
        self.fault: Reason | None = None
        self.ended = False
        self.stops: tuple[StopMark, ...] = ()  # acknowledged by control, newest last
        self._handed: dict[int, StopMark] = {}  # own sequence → as the laptop knows it
        self._lease = 0 if held else 1  # as control knows it; 0: not known yet
        self._their_lease = 0 if held else 1  # the same console as the laptop numbers it; 0: not known yet
        self._their_operator = host.setup.operator
        # An earlier process of this command counted from less: what control says of its STOPs is none of ours.
        self._sequence = time.monotonic_ns() if held else 0
        self._heartbeat_ns = self._acknowledged_ns = 0  # by the laptop's clock
        self._must_take_over = held
        self._returned_ns = 0  # when the laptop came back last: what it was given before that is not carried out
        self._started = self._ending = False
        self._workers.submit(self._start)

    @classmethod
    def begun(cls, home: Home, config: Config, request: SessionRequest, workers: Executor) -> ServedSession:
        """A new one. Raises AppError when it can't be begun."""
        check_request(config, request)
        if not config.joints.emulated:  # only a PIN signs in for a session
            record_outside_change(home, request.operator, request.role, Proof.PIN)
        setup = make_setup(home, config, request.profile, None, permission=None)
        names = {"session": request.session, "operator": request.operator, "role": request.role}
        return cls(replace(setup, linked=True, **names), workers, held=False)

    @classmethod
    def resumed(cls, home: Home, workers: Executor) -> ServedSession | None:
        """The one that an earlier process of this command left, held; None without one."""
        held = held_session(home)
        return cls(held, workers, held=True) if held is not None and held.linked else None

    @property
    def name(self) -> str:
        """The session's."""
        return self._host.setup.session

    def commanded_by(self, operator: str) -> None:
        """Whose name the laptop's console has, of a session that is resumed."""
        self._their_operator = operator or self._their_operator

    def adopt_lease(self, lease: int) -> None:
        """Of the laptop's packets: an earlier process of this command may have acknowledged a takeover there."""
        self._their_lease = self._their_lease or lease

    def record(self, body: Body) -> None:
        """Into this host's trail."""
        self._sink.emit(body)

    def note(self, notice: LinkNotice, **values: object) -> None:
        """A note in this host's trail."""
        self.record(Note(text=reason(notice, **values)))

    def poll(self) -> None:
        """Take what the session's processes published."""
        self.snapshot = self.snapshots.receive() or self.snapshot
        self.guardian = self._guardian.receive() or self.guardian
        self.audit = self._audit.receive() or self.audit
        if self._started and not self.ended:
            self.processes = self._host.processes()
            if any(one.name == "control" and not one.alive for one in self.processes):
                self.end()
        if self.snapshot is not None:
            if not self._lease:
                self._lease = self.snapshot.lease
            self._acknowledge(self.snapshot)

    def hand_report(self, report: TriggerReport, clock: ClockEstimate) -> None:
        """Perception's newest."""
        self._reports.send(localized(report, clock))

    def hand_commands(self, commands: Iterable[OperatorCommand], clock: ClockEstimate, now_ns: int) -> None:
        """The console's, in order."""
        for command in commands:
            self._hand(command, clock, now_ns)

    def hand_stops(
        self, stops: Iterable[StopMark], clock: ClockEstimate, now_ns: int, acknowledged_ns: int = 0, lease: int = 0
    ) -> None:
        """STOPs that came by packet: each once, whether its frame came before or comes later.

        acknowledged_ns: when the console of that lease acknowledged last; a STOP may be another console's. That
        precedes the STOPs given after it, or the first of them would count as a second one, and damp.
        """
        for stop in stops:
            command = OperatorCommand(lease=stop.lease, sequence=stop.sequence, kind=stop.kind, sent_ns=stop.sent_ns)
            recent = now_ns - clock.local_ns(acknowledged_ns) <= LOST_NS
            if 0 < acknowledged_ns < stop.sent_ns and recent and stop not in self._handed.values():
                kind = OperatorKind.ACKNOWLEDGE
                self._hand(replace(command, kind=kind, lease=lease, sent_ns=acknowledged_ns), clock, now_ns)
            self._hand(command, clock, now_ns)

    def hand_heartbeat(self, heartbeat_ns: int, lease: int, clock: ClockEstimate) -> None:
        """STOP could be given at that moment; it has no sequence, so that it overtakes no command."""
        if heartbeat_ns > self._heartbeat_ns and lease == self._their_lease and self._lease:
            self._heartbeat_ns = heartbeat_ns
            sent_ns = clock.local_ns(heartbeat_ns)
            self._send(OperatorCommand(sequence=0, lease=self._lease, kind=OperatorKind.HEARTBEAT, sent_ns=sent_ns))

    def hand_return(self, silent_ns: int) -> None:
        """The link is back after it was lost: whoever comes back takes the legs over, held and disarmed."""
        self.note(LinkNotice.LINK_RETURNED, silent_s=silent_ns / 1e9)
        self._must_take_over = True

    def take_over_if_due(self, now_ns: int) -> None:
        """As another console does (`TAKE_OVER`)."""
        if self._must_take_over and self._lease:
            self._must_take_over = False
            self._returned_ns = now_ns
            self._take_over(now_ns, self._their_operator)

    def shown(self) -> ControlSnapshot | None:
        """Control's newest snapshot as the laptop's consoles number leases and STOPs."""
        snapshot = self.snapshot
        if snapshot is None:
            return None
        mark = self._handed.get(snapshot.stop_sequence) if snapshot.stop_sequence else None
        return replace(
            snapshot,
            lease=self._their_lease,
            stop_lease=mark.lease if mark else 0,
            stop_sequence=mark.sequence if mark else 0,
        )

    def end(self) -> None:
        """Bring the legs to rest and every process to its end."""
        if not self._ending:
            self._ending = True
            self._workers.submit(self._close)

    def close_links(self) -> None:
        """After the end."""
        for link in (self._operator, self._reports, self.health, self.snapshots, self._guardian, self._audit):
            link.close()
        self._sink.close(0.0)

    def leave(self) -> None:
        """This process ends and the session stays, held."""
        self.close_links()
        self._host.leave()

    def _hand(self, given: OperatorCommand, clock: ClockEstimate, now_ns: int) -> None:
        """given: by the laptop's clock, as a repeated STOP has it."""
        mark = mark_of(given) if given.kind in STOP_KINDS else None
        if given.kind is OperatorKind.HEARTBEAT or mark in self._handed.values():
            return
        if given.kind is OperatorKind.ACKNOWLEDGE and given.sent_ns == self._acknowledged_ns:
            return  # it came with a packet before its frame
        command = localized(given, clock)
        age_ns = now_ns - command.sent_ns
        if mark is not None and self._precedes_return(command):
            # An earlier process may have handed it on, by another estimate: it must not look like a later press.
            command = replace(command, sent_ns=command.sent_ns - 2 * clock.uncertainty_ns)
        if self._is_stale(command, age_ns):
            self.note(LinkNotice.COMMAND_STALE, command=command.kind.value, age_s=age_ns / 1e9)
            return
        # As adopted, too: a packet with the new lease may have overtaken the command.
        if command.kind is OperatorKind.TAKE_OVER and command.lease >= self._their_lease:
            self._their_lease, self._their_operator = command.lease, command.operator
            if self._lease:  # else the takeover of the resumed session is still due
                self._take_over(command.sent_ns, command.operator)
        elif command.lease == self._their_lease or command.kind in STOP_KINDS:
            if command.kind is OperatorKind.ACKNOWLEDGE:
                self._acknowledged_ns = given.sent_ns
            lease = self._lease if command.lease == self._their_lease else 0
            self._sequence += 1
            if mark is not None:
                self._handed[self._sequence] = mark
                self._handed = dict(list(self._handed.items())[-STOPS_KEPT:])
            self._send(replace(command, lease=lease, sequence=self._sequence))

    def _precedes_return(self, command: OperatorCommand) -> bool:
        """Whether it was given before the takeover of the laptop's return, or that is still due."""
        return self._must_take_over or command.sent_ns < self._returned_ns

    def _is_stale(self, command: OperatorCommand, age_ns: int) -> bool:
        if command.kind in NEVER_STALE:
            return False
        if age_ns > LOST_NS:
            return command.kind not in REFUSED_BY_AGE
        return self._precedes_return(command)

    def _take_over(self, sent_ns: int, operator: str) -> None:
        self._lease += 1
        self._sequence += 1
        self._send(
            OperatorCommand(
                lease=self._lease,
                sequence=self._sequence,
                kind=OperatorKind.TAKE_OVER,
                sent_ns=sent_ns,
                operator=operator,
            )
        )

    def _send(self, command: OperatorCommand) -> None:
        if not self._operator.send(command):
            self.note(LinkNotice.COMMANDS_LOST)

    def _acknowledge(self, snapshot: ControlSnapshot) -> None:
        done = [mark for own, mark in self._handed.items() if own <= snapshot.stop_sequence]
        self.stops = tuple(done[-8:])

    def _start(self) -> None:
        try:
            self._host.start()
            self._started = True
        except (CodedError, OSError) as error:
            self.fault = not_started(error)
            self.end()

    def _close(self) -> None:
        self._host.close()
        self.ended = True


def not_started(error: CodedError | OSError) -> Reason:
    """As the laptop is told it, where a file of this computer would be taken for one of its own."""
    if isinstance(error, CodedError):
        why = reason_of(error)
        return why if isinstance(error.code, LinkFault) else reason(LinkFault.NOT_STARTED, detail=why)
    return reason(LinkFault.NOT_STARTED, detail=str(error))


def check_request(config: Config, request: SessionRequest) -> None:
    """Raises AppError: a name that is none, or joints that move somebody without an operator who has signed in."""
    if _NAME.fullmatch(request.session) is None:
        raise AppError(LinkFault.NAME_INVALID)
    if not (config.joints.emulated or request.signed_in):
        raise AppError(LinkFault.SIGN_IN_NEEDED)
