"""Control's ends of the session's links: non-blocking; slow streams are polled less often."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import TypeVar

import msgspec

from app.ipc import streams
from app.ipc.links import (
    LAST_QUEUE,
    LAST_S,
    Address,
    LatestReceiver,
    OrderedReceiver,
    OrderedSender,
    Publisher,
    address,
)
from app.ipc.messages import AuditHealth, GuardianHealth, Heartbeat, LinkHealth, OperatorCommand, TriggerReport
from app.ipc.snapshot import ControlSnapshot
from app.motion.plan import Plan, PlanRequest, decode_table

_M = TypeVar("_M", bound=msgspec.Struct)

SLOW_STREAM_TICKS = 5  # slow streams and plans are polled at 100 Hz: 10 ms of their limits' margin
PLANS_A_TICK = 4
COMMANDS_A_TICK = 64  # 3 s of heartbeats: after a stall the newest counts; a flood must not make a tick late


class Received(msgspec.Struct, frozen=True, kw_only=True):
    """What has arrived since the tick before: fields of `Inputs`."""

    report: TriggerReport | None
    commands: tuple[OperatorCommand, ...]
    plans: tuple[Plan, ...]
    audit: AuditHealth | None
    guardian: GuardianHealth | None
    link: LinkHealth | None
    rejected_messages: int
    foreign_peers: int


class ControlLinks:
    """All sockets of the control process but the audit's."""

    def __init__(self, directory: streams.LinkDirectory, *, linked: bool = False) -> None:
        """linked: the console is on another computer."""

        def at(stream: streams.Stream) -> Address:
            return address(directory, stream.name)

        self._operator = OrderedReceiver(at(streams.OPERATOR), OperatorCommand)
        self._plans = OrderedReceiver(at(streams.PLAN_REPLY), Plan, dec_hook=decode_table)
        self._requests = OrderedSender(at(streams.PLAN_REQUEST))
        self._reports = LatestReceiver(at(streams.TRIGGER), TriggerReport)
        self._audit = LatestReceiver(at(streams.AUDIT_HEALTH), AuditHealth)
        self._guardian = LatestReceiver(at(streams.GUARDIAN), GuardianHealth)
        self._heartbeats = Publisher(at(streams.HEARTBEAT), queue=LAST_QUEUE)
        self._snapshots = Publisher(at(streams.SNAPSHOT), queue=LAST_QUEUE)
        self._link = LatestReceiver(at(streams.LINK), LinkHealth) if linked else None
        self._rejected = 0
        slow: tuple[LatestReceiver[LinkHealth], ...] = () if self._link is None else (self._link,)
        self._links = (
            *slow,
            self._operator,
            self._plans,
            self._requests,
            self._reports,
            self._audit,
            self._guardian,
            self._snapshots,
            self._heartbeats,
        )
        self._peers_of_others = {"audit": 0, "guardian": 0, "link": 0}
        self._awaited: GuardianHealth | None = None  # received before its tick

    def receive(self, *, slow: bool, planning: bool) -> Received:
        """Everything new. slow: the slow streams too; planning: a plan is awaited, plans are polled in every tick."""
        commands = tuple(_up_to(COMMANDS_A_TICK, self._operator))
        plans = tuple(_up_to(PLANS_A_TICK, self._plans)) if planning or slow else ()
        audit = self._audit.receive() if slow else None
        guardian = (self._guardian.receive() or self._awaited) if slow else None
        self._awaited = None if slow else self._awaited
        link = self._link.receive() if slow and self._link is not None else None
        return Received(
            report=self._reports.receive(),
            commands=commands,
            plans=plans,
            audit=audit,
            guardian=guardian,
            link=link,
            rejected_messages=self._newly_rejected(),
            foreign_peers=self._new_foreign_peers(audit, guardian, link) if slow else 0,
        )

    def await_guardian(self, since_ns: int, limit_s: float) -> bool:
        """Wait for what the guardian reports from then on; whether it did so in time."""
        until_s = time.monotonic() + limit_s
        while (left_s := until_s - time.monotonic()) > 0:
            self._awaited = self._guardian.receive(left_s) or self._awaited
            if self._awaited is not None and self._awaited.at_ns >= since_ns:
                return True
        return False

    def send_plan_requests(self, plan_requests: Iterable[PlanRequest]) -> None:
        """Send requests to the planner; one that a full queue refuses ends in PLANNER_TIMEOUT."""
        for plan_request in plan_requests:
            self._requests.send(plan_request)

    def send_heartbeat(self, heartbeat: Heartbeat) -> None:
        """To the guardian."""
        self._heartbeats.send(heartbeat)

    def send_snapshot(self, snapshot: ControlSnapshot) -> None:
        """To the console and the demo."""
        self._snapshots.send(snapshot)

    def close(self) -> None:
        """Release every socket."""
        for link in self._links[:-2]:
            link.close()
        self._snapshots.close(linger_s=LAST_S)
        self._heartbeats.close(linger_s=LAST_S)

    def _new_foreign_peers(
        self, audit: AuditHealth | None, guardian: GuardianHealth | None, other_host: LinkHealth | None
    ) -> int:
        peers = sum(link.foreign_peers() for link in self._links)
        for name, health in (("audit", audit), ("guardian", guardian), ("link", other_host)):
            if health is not None:
                peers += max(0, health.foreign_peers - self._peers_of_others[name])
                self._peers_of_others[name] = health.foreign_peers
        return peers

    def _newly_rejected(self) -> int:
        total = sum(link.rejected for link in self._links)
        new, self._rejected = total - self._rejected, total
        return new


def _up_to(number: int, link: OrderedReceiver[_M]) -> Iterable[_M]:
    for _ in range(number):
        message = link.receive()
        if message is None:
            return
        yield message
