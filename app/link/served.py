"""A session that the exoskeleton's computer runs for a laptop: its processes, and both ends of what crosses the link.

What comes from the laptop goes into the session's own links with its moments by this host's clock; control, guardian
and audit are the same as on one host and know nothing of it.
"""

from __future__ import annotations

import re
from concurrent.futures import Executor

from msgspec.structs import replace

from app.audit.sink import AuditSink
from app.ipc import streams
from app.ipc.links import LatestReceiver, OrderedSender, Publisher, address
from app.ipc.messages import AuditHealth, GuardianHealth, ProcessStatus, TriggerReport
from app.ipc.snapshot import ControlSnapshot
from app.link.clock import ClockEstimate, localized
from app.link.commands import CommandRelay
from app.link.wire import LinkFault, LinkNotice, SessionRequest
from app.session.host import SessionHost
from app.session.setup import make_setup
from app.session.shared import held_session, unshare_dead
from app.system.authority import Proof
from app.system.config import Config, SessionSetup, load_config
from app.system.configure import record_outside_change
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.errors import CodedError
from logs.reason import Reason, reason, reason_of
from logs.records import Body, Note

_NAME = re.compile(r"[0-9]{8}T[0-9]{6}Z-[0-9a-f]{4}")


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
        self.commands = CommandRelay(self._operator, host.setup.operator, self.note, held=held)
        self.snapshot: ControlSnapshot | None = None
        self.guardian: GuardianHealth | None = None
        self.audit: AuditHealth | None = None
        self.processes: tuple[ProcessStatus, ...] = ()
        self.fault: Reason | None = None
        self.ended = False
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
            self.commands.acknowledge(self.snapshot)

    def shown(self) -> ControlSnapshot | None:
        """Control's newest snapshot as the laptop's consoles number leases and STOPs."""
        return None if self.snapshot is None else self.commands.shown(self.snapshot)

    def hand_report(self, report: TriggerReport, clock: ClockEstimate) -> None:
        """Perception's newest."""
        self._reports.send(localized(report, clock))

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

    def _start(self) -> None:
        try:
            self._host.start()
            self._started = True
        except (CodedError, OSError, RuntimeError) as error:  # RuntimeError: no thread can be started
            self.fault = not_started(error)
            self.end()

    def _close(self) -> None:
        self._host.close()
        unshare_dead(self._host.setup)
        self.ended = True


def not_started(error: CodedError | OSError | RuntimeError) -> Reason:
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


def own_config(home: Home) -> Config:
    """As the file is now: this command outlives changes of it. Raises AppError, also where the joints are elsewhere."""
    config = load_config(home.config)
    if config.joints.host:
        raise AppError(LinkFault.HOST_HAS_HOST, host=config.joints.host)
    return config
