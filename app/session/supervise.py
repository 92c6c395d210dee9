"""The session's own process: starts the others, restarts a perception that died or froze, ends all in order.

It belongs to no terminal and outlives its console: control, guardian, audit and perception stay, and another console
takes the session over. It decides nothing about legs. It ends when it is asked to (SIGTERM), and by itself when
neither a control nor a console is left: control first (hold, damp, disable), the audit trail last.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import time
from enum import Enum, auto
from multiprocessing.process import BaseProcess
from pkgutil import resolve_name
from types import FrameType

from msgspec.structs import replace

from app.audit.sink import AuditSink
from app.ipc import streams
from app.ipc.links import LatestReceiver, Publisher, address, end_links
from app.ipc.messages import ProcessStatus, SessionStatus, TriggerReport
from app.session.child import Supervisor, remove_empty_output
from app.session.launch import MOVERS, Launch
from app.session.shared import Lease, Peer, current_lease, decode, share, start_of, unshare
from app.system.diagnostics_log import get_logger, start_log, stop_log
from app.system.legs_lock import claim_legs
from app.system.paths import Home
from app.system.scheduling import set_autogroup_nice, set_oom_score_adj, set_scheduling
from logs.reason import reason
from logs.records import ProcessEnd

_log = get_logger("session")

# Control holds (0.15 s), damps (3 s if nobody is there) and disables, again where a drive does not confirm that.
# Audit gives up by itself (`app.audit.process.GIVE_UP_S`); killed on a slow disk it would tear the trail.
END_PATIENCE_S = {
    "audit": 60.0,
    "control": 7.0,
    "link": 20.0,  # the other computer ends control, and its own trail
    "perception": 2.0,
    "planner": 2.0,
    "guardian": 5.0,
    "bus-log": 2.0,
    "recording": 5.0,
}


class SessionNotice(Enum):
    """What the session's process records."""

    CONSOLE_GONE = auto()


class ProcessFault(Enum):
    """Why a process of the session has ended, which can't record it itself."""

    EXITED = auto()  # exit_code: negative is a signal's number


class SessionProcesses:
    """The processes of one session, and the console that commands it."""

    def __init__(self, launch: Launch) -> None:
        self._setup = launch.setup
        self._order = launch.order
        self._entry = resolve_name(launch.entry)
        self._children: dict[str, BaseProcess] = {}
        self._supervisor = Supervisor()
        self._ending = False
        self._lease: Lease | None = None
        self._console: Peer | None = None
        self._console_ended = False  # recorded
        self._ended: set[int] = set()  # recorded, by process id
        links = self._setup.links
        self._reports = LatestReceiver(address(links, streams.TRIGGER.name), TriggerReport)
        self._statuses = Publisher(address(links, streams.SESSION.name))
        self._sink = AuditSink(links, "session", self._setup.operator)

    def start(self) -> None:
        """Start every process in the order in which they are needed."""
        for name in self._order:
            self._spawn(name)

    def ask(self, _number: int, _frame: FrameType | None) -> None:
        """Asked to end; the signal's handler."""
        self._ending = True

    def run(self) -> None:
        """Until it is time to end."""
        while not self._must_end():
            self._supervise_perception(self._reports.receive())
            for name, child in self._children.items():
                self._record_ended(name, child)
            self._statuses.send(SessionStatus(at_ns=time.monotonic_ns(), processes=self._status()))
            time.sleep(1.0 / streams.SESSION.rate_hz)

    def close(self) -> None:
        """Bring the legs to rest and every process to its end."""
        for name in ("link", "control", "perception", "planner", "guardian", "bus-log", "recording"):
            end_child(name, self._children.get(name))
        self._sink.close()
        shutil.rmtree(self._setup.links.path, ignore_errors=True)  # all that audit receives is connected
        end_child("audit", self._children.get("audit"))
        for name in self._children:
            remove_empty_output(self._setup, name)
        self._reports.close()
        self._statuses.close()

    def _must_end(self) -> bool:
        """Asked to, or nobody is left who moves or commands; a console takes leave when it has ended control."""
        console = self._console_lives()
        return self._ending or not (
            console or any(self._children[name].is_alive() for name in MOVERS & self._children.keys())
        )

    def _console_lives(self) -> bool:
        if self._console is not None and not self._console.alive and not self._console_ended:
            self._console_ended = True
            cause = reason(SessionNotice.CONSOLE_GONE)
            self._sink.emit(ProcessEnd(pid=self._console.pid, ended="console", reason=cause))
            _log.warning("console gone", console_pid=self._console.pid)
        lease = current_lease(self._setup.links)
        if lease is not None and lease != self._lease:
            if self._console is not None:
                self._console.close()
            self._lease, self._console, self._console_ended = lease, Peer(lease.pid), False
        return self._console is None or self._console.alive  # none yet: it starts us, its lease comes at once

    def _status(self) -> tuple[ProcessStatus, ...]:
        return tuple(
            ProcessStatus(
                name=name,
                pid=child.pid or 0,
                alive=child.is_alive(),
                restarts=self._supervisor.restarts if name == "perception" else 0,
                exit_code=child.exitcode,
            )
            for name, child in self._children.items()
        )

    def _spawn(self, name: str) -> None:
        child = multiprocessing.get_context("spawn").Process(
            target=self._entry, args=(name, self._setup), daemon=True, name=f"rleex-{name}"
        )
        child.start()  # daemon: if this process fails by an exception, it still asks it to end (SIGTERM)
        _log.info("process spawned", child=name, child_pid=child.pid)
        self._children[name] = child

    def _record_ended(self, name: str, child: BaseProcess) -> None:
        """One that failed; the others record their end themselves."""
        if child.exitcode and child.pid is not None and child.pid not in self._ended:
            self._ended.add(child.pid)
            cause = reason(ProcessFault.EXITED, exit_code=child.exitcode)
            self._sink.emit(ProcessEnd(pid=child.pid, ended=name, reason=cause))
            _log.error("process failed", child=name, child_pid=child.pid, exit_code=child.exitcode)

    def _supervise_perception(self, report: TriggerReport | None) -> None:
        child = self._children.get("perception")
        if child is None:
            return
        reported, ready = report is not None, report is not None and report.detector_ready
        if self._supervisor.must_restart(time.monotonic(), alive=child.is_alive(), reported=reported, ready=ready):
            _log.warning("perception restarts", restarts=self._supervisor.restarts, exit_code=child.exitcode)
            child.kill()  # a driver frozen in the kernel handles no SIGTERM
            child.join(1.0)
            self._record_ended("perception", child)
            try:
                self._spawn("perception")
            except OSError as error:  # no memory or no process to be had: tried again, as one that died at once
                _log.warning("perception not started", why=str(error))


def end_child(name: str, child: BaseProcess | None) -> None:
    """Ask it to end, if it was started, and kill it when it takes too long."""
    if child is None:
        return
    child.terminate()
    patience_s = END_PATIENCE_S[name]
    child.join(patience_s)
    if child.is_alive():
        _log.warning("process killed", child=name, patience_s=patience_s)
        child.kill()
        child.join(1.0)


def supervise(launch: Launch) -> None:
    """Run a session to its end. Raises AppError while its legs are held."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    set_oom_score_adj("session")
    set_scheduling("session")
    set_autogroup_nice("session")
    setup = replace(launch.setup, host_pid=os.getpid(), host_started=start_of(os.getpid()))
    legs = claim_legs(setup)
    start_log(Home(setup.home), "session", session=setup.session, patient=setup.profile.identifier)
    processes = SessionProcesses(replace(launch, setup=setup))
    signal.signal(signal.SIGTERM, processes.ask)
    try:
        processes.start()
        share(setup)
        processes.run()
    finally:
        try:
            unshare(setup)
        except OSError as error:  # who finds the file finds no process any more
            _log.warning("session file stays", why=str(error))
        processes.close()
        end_links()
        legs.close()
        stop_log()


if __name__ == "__main__":
    begun = decode(sys.stdin.buffer.read(), Launch)
    supervise(begun)
    remove_empty_output(begun.setup, "session")  # not after an exception, whose traceback comes last
