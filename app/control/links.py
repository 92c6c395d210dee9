"""Control's ends of the session's links: received without waiting, the rare ones looked at less often."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from app.ipc import streams as processes
from app.ipc.links import LatestReceiver, OrderedReceiver, OrderedSender, Publisher, address
from app.ipc.messages import (
    AuditHealth,
    ControlSnapshot,
    GuardianHealth,
    Heartbeat,
    OperatorCommand,
    TriggerReport,
)
from app.motion.plan import Plan, PlanRequest, decode_table

_M = TypeVar("_M", bound=msgspec.Struct)

RARE_TICKS = 5  # streams of 20 Hz and plans are looked at a hundred times a second: 10 ms of their limits' margin
LAST_WORD_S = 0.1  # the guardian must learn that control has ended in good order
COMMANDS_A_TICK = 32  # a flood of words must not make a tick late


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamState:
    """What has arrived since the tick before."""

    report: TriggerReport | None
    commands: tuple[OperatorCommand, ...]
    plans: tuple[Plan, ...]
    audit: AuditHealth | None
    guardian: GuardianHealth | None
    rejected: int


class ControlLinks:
    """All sockets of the control process but the audit's."""

    def __init__(self, directory: Path) -> None:
        def at(stream: processes.Stream) -> str:
            return address(directory, stream.name)

        self._operator = OrderedReceiver(at(processes.OPERATOR), OperatorCommand)
        self._plans = OrderedReceiver(at(processes.PLAN_REPLY), Plan, dec_hook=decode_table)
        self._requests = OrderedSender(at(processes.PLAN_REQUEST))
        self._reports = LatestReceiver(at(processes.TRIGGER), TriggerReport)
        self._audit = LatestReceiver(at(processes.AUDIT_HEALTH), AuditHealth)
        self._guardian = LatestReceiver(at(processes.GUARDIAN), GuardianHealth)
        self._heartbeats = Publisher(at(processes.HEARTBEAT))
        self._snapshots = Publisher(at(processes.SNAPSHOT))
        self._rejected = 0

    def receive(self, tick: int, *, planning: bool) -> StreamState:
        """Everything new. planning: a plan is awaited and looked for in every tick."""
        rare = tick % RARE_TICKS == 0
        commands = tuple(_up_to(COMMANDS_A_TICK, self._operator))
        plans = self._take_plans() if planning or rare else ()
        return StreamState(
            report=self._reports.receive(),
            commands=commands,
            plans=plans,
            audit=self._audit.receive() if rare else None,
            guardian=self._guardian.receive() if rare else None,
            rejected=self._newly_rejected(),
        )

    def ask(self, requests: Iterable[PlanRequest]) -> None:
        """Send requests to the planner; one that a full queue refuses is noticed as a silent planner."""
        for request in requests:
            self._requests.send(request)

    def heartbeat(self, beat: Heartbeat) -> None:
        """To the guardian."""
        self._heartbeats.send(beat)

    def show(self, snapshot: ControlSnapshot) -> None:
        """To the console and the demo."""
        self._snapshots.send(snapshot)

    def close(self) -> None:
        """Release every socket."""
        for link in (
            self._operator,
            self._plans,
            self._requests,
            self._reports,
            self._audit,
            self._guardian,
            self._snapshots,
        ):
            link.close()
        self._heartbeats.close(linger_s=LAST_WORD_S)

    def _take_plans(self) -> tuple[Plan, ...]:
        return tuple(_up_to(4, self._plans))

    def _newly_rejected(self) -> int:
        links = (self._operator, self._plans, self._reports, self._audit, self._guardian)
        total = sum(link.rejected for link in links)
        new, self._rejected = total - self._rejected, total
        return new


def _up_to(number: int, link: OrderedReceiver[_M]) -> Iterable[_M]:
    for _ in range(number):
        message = link.receive()
        if message is None:
            return
        yield message
