"""The newest of what a session's processes publish, for the console that commands it and for those that watch it."""

from __future__ import annotations

from dataclasses import dataclass

from app.ipc import streams
from app.ipc.links import LatestReceiver, address
from app.ipc.messages import (
    AuditHealth,
    GuardianHealth,
    LinkHealth,
    Preview,
    ProcessStatus,
    SessionStatus,
    TriggerReport,
)
from app.ipc.snapshot import ControlSnapshot
from app.system.config import SessionSetup


@dataclass(frozen=True, slots=True, kw_only=True)
class Latest:
    """The newest of each stream; None where nothing new came since the last poll."""

    snapshot: ControlSnapshot | None
    report: TriggerReport | None
    preview: Preview | None
    audit: AuditHealth | None
    processes: tuple[ProcessStatus, ...]
    guardian: GuardianHealth | None = None
    link: LinkHealth | None = None
    stop_sent_ns: int = 0  # of the oldest STOP of this console that control has not acknowledged; 0: none waits


class LatestStreams:
    """A receiver for each stream of a session."""

    def __init__(self, setup: SessionSetup) -> None:
        links = setup.links
        self._snapshots = LatestReceiver(address(links, streams.SNAPSHOT.name), ControlSnapshot)
        self._reports = LatestReceiver(address(links, streams.TRIGGER.name), TriggerReport)
        self._previews = LatestReceiver(address(links, streams.PREVIEW.name), Preview)
        self._audit = LatestReceiver(address(links, streams.AUDIT_HEALTH.name), AuditHealth)
        self._guardian = LatestReceiver(address(links, streams.GUARDIAN.name), GuardianHealth)
        self._statuses = LatestReceiver(address(links, streams.SESSION.name), SessionStatus)
        link = address(links, streams.LINK.name)
        self._link = LatestReceiver(link, LinkHealth) if setup.joints_elsewhere else None

    def processes(self) -> tuple[ProcessStatus, ...] | None:
        """As the session's process has just said; None: it has not."""
        status = self._statuses.receive()
        return None if status is None else status.processes

    def receive(self, processes: tuple[ProcessStatus, ...]) -> Latest:
        """The newest of each other stream, without waiting, beside these processes."""
        return Latest(
            snapshot=self._snapshots.receive(),
            report=self._reports.receive(),
            preview=self._previews.receive(),
            audit=self._audit.receive(),
            processes=processes,
            guardian=self._guardian.receive(),
            link=None if self._link is None else self._link.receive(),
        )

    def close(self) -> None:
        """Stop listening."""
        health = (self._audit, self._guardian, self._statuses, self._link)
        for link in (self._snapshots, self._reports, self._previews, *health):
            if link is not None:
                link.close()
