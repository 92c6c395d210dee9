"""The laptop's ends of its session's own links: where control is on one host, and the guardian's health."""

from __future__ import annotations

import time
from collections.abc import Iterator

from app.audit.sink import AuditSink
from app.ipc import streams
from app.ipc.links import LAST_QUEUE, LAST_S, LatestReceiver, OrderedReceiver, Publisher, address
from app.ipc.messages import AuditHealth, LinkHealth, OperatorCommand, TriggerReport
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Event
from app.link.beats import trail_health
from app.link.clock import ClockEstimate, localized
from app.link.wire import LinkNotice, ToLaptop
from app.system.config import SessionSetup
from logs.reason import reason
from logs.records import Body, EventRaised, Note

COMMANDS_A_ROUND = 64


class SessionLinks:
    """What console, perception and audit say, what they are told in control's and the guardian's place, the trail."""

    def __init__(self, setup: SessionSetup) -> None:
        links = setup.links
        self._sink = AuditSink(links, "link", setup.operator)
        self._operator = OrderedReceiver(address(links, streams.OPERATOR.name), OperatorCommand)
        self._reports = LatestReceiver(address(links, streams.TRIGGER.name), TriggerReport)
        self._audits = LatestReceiver(address(links, streams.AUDIT_HEALTH.name), AuditHealth)
        self._snapshots = Publisher(address(links, streams.SNAPSHOT.name), queue=LAST_QUEUE)
        self._guardian = Publisher(address(links, streams.GUARDIAN.name))
        self._health = Publisher(address(links, streams.LINK.name))
        self._all = (self._operator, self._reports, self._audits, self._snapshots, self._guardian, self._health)
        self.sockets = (self._operator.socket, self._reports.socket)  # whose messages are awaited
        self.report: TriggerReport | None = None  # perception's newest, not sent yet
        self._audit: AuditHealth | None = None
        self._audit_ns = time.monotonic_ns()
        self._newest: ControlSnapshot | None = None

    def commands(self) -> Iterator[OperatorCommand]:
        """The consoles', in order; the rest in the next round."""
        for _ in range(COMMANDS_A_ROUND):
            command = self._operator.receive()
            if command is None:
                return
            yield command

    def poll(self) -> None:
        """Take what perception and audit published, and record who was turned away."""
        self.report = self._reports.receive() or self.report
        audit = self._audits.receive()
        if audit is not None:
            self._audit, self._audit_ns = audit, time.monotonic_ns()
        peers = sum(link.foreign_peers() for link in self._all)
        if peers:
            text = reason(Event.FOREIGN_PEER, count=peers)
            self.record(EventRaised(event=Event.FOREIGN_PEER.value, effect="note", text=text))

    def audit(self, now_ns: int) -> AuditHealth | None:
        """The health of this host's trail, for the other computer."""
        return trail_health(self._audit, self._audit_ns, now_ns)

    def publish(self, frame: ToLaptop, clock: ClockEstimate) -> None:
        """What control and guardian there say, by this host's clock; a snapshot once, and none that was overtaken."""
        newest, self._newest = self._newest, frame.snapshot
        if frame.snapshot is not None and (newest is None or _is_newer(frame.snapshot, newest)):
            self._snapshots.send(localized(frame.snapshot, clock))
        if frame.guardian is not None:
            self._guardian.send(localized(frame.guardian, clock))

    def publish_health(self, health: LinkHealth) -> None:
        """The link's, to the consoles."""
        self._health.send(health)

    def record(self, body: Body) -> None:
        """Into this host's trail."""
        self._sink.emit(body)

    def note(self, notice: LinkNotice, **values: object) -> None:
        """A note of the link in this host's trail."""
        self.record(Note(text=reason(notice, **values)))

    def close(self) -> None:
        """Release everything."""
        self._sink.close()
        for link in (self._operator, self._reports, self._audits, self._guardian, self._health):
            link.close()
        self._snapshots.close(linger_s=LAST_S)


def _is_newer(one: ControlSnapshot, other: ControlSnapshot) -> bool:
    return (one.incarnation, one.sequence) > (other.incarnation, other.sequence)
