"""A session as its console or the demo holds it: started or taken over, commanded, watched, ended or left.

The processes belong to the session's own process (`app/session/supervise.py`), which outlives the console. Everything
goes over links, so that any console with the newest lease can command.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from enum import Enum, auto

import msgspec

from app.ipc import streams
from app.ipc.links import OrderedSender, address, start_links
from app.ipc.messages import (
    STOP_KINDS,
    HandCommand,
    LinkHealth,
    OperatorCommand,
    OperatorKind,
    PerceptionCommand,
    ProcessStatus,
)
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Action
from app.session.child import run_process
from app.session.latest import Latest, LatestStreams
from app.session.launch import launch
from app.session.shared import Peer, current_lease, take_lease
from app.system.config import SessionSetup
from app.system.errors import AppError
from app.system.scheduling import call_with_scheduling, set_scheduling

START_S = 30.0  # the session's process spawns the others, on a busy machine
END_S = 28.0  # each process's patience, and the trail's on a usual disk; on a slower one audit ends by itself
# The heartbeat says that STOP can be given. The terminal's input thread, which takes STOP, reports every 0.1 s.
INPUT_TIMEOUT_S = 0.5
UNREPORTED_S = 3.0 / streams.SESSION.rate_hz  # the session's process may be frozen or gone: its word is checked then


class SessionFault(Enum):
    """Why a session can't be had."""

    NOT_STARTED = auto()  # folder
    NOT_TAKEN_OVER = auto()


class SessionHost:
    """Starts one session, or takes over one that runs. `send` may be called from any thread."""

    def __init__(
        self,
        setup: SessionSetup,
        *,
        entry: Callable[[str, SessionSetup], None] = run_process,
        without: frozenset[str] = frozenset(),
    ) -> None:
        """setup: with a `host_pid` it is a running session's. without: processes that are not to be started.

        entry: what each process runs with its name and the setup; importable, for it is spawned.
        """
        self.setup = setup
        self._entry = f"{entry.__module__}:{entry.__qualname__}"
        self._without = without
        self._host: Peer | None = None
        self._processes: tuple[ProcessStatus, ...] = ()
        self._reported_s = 0.0  # when the session's process said so
        call_with_scheduling("heartbeat", start_links)  # STOP and heartbeat leave through them
        self._operator = OrderedSender(address(setup.links, streams.OPERATOR.name))
        self._perception = OrderedSender(address(setup.links, streams.TO_PERCEPTION.name))
        self._lock = threading.Lock()
        self._lease = 0 if setup.host_pid else 1  # 0: has not taken over yet, and can but stop
        # Consoles that have not taken over yet share a lease: the acknowledged STOP of one is none of another.
        self._sequence = time.monotonic_ns() if setup.host_pid else 0
        self._stops: dict[int, tuple[int, int]] = {}  # sequence → lease, when sent; control has not acknowledged it
        self._heartbeat_s = time.monotonic()
        self._silent = False
        self._closed = False
        self._ending = threading.Event()
        self._heartbeat_thread = threading.Thread(target=self._send_heartbeats, name="operator-heartbeat", daemon=True)
        self._streams = LatestStreams(setup)

    def start(self) -> None:
        """Start every process, or take the running ones over; the streams show when each is ready.

        Raises AppError while a process of another session may still command or damp the legs, or when this one is over.
        """
        if self.setup.host_pid:
            self._take_over()
        else:
            self._host = launch(self.setup, self._entry, self._without)
        self._heartbeat_thread.start()
        limit_s = time.monotonic() + START_S
        while not self.processes():
            if not self._host_lives() or time.monotonic() > limit_s:
                raise AppError(SessionFault.NOT_STARTED, folder=self.setup.home / "diagnostics")
            time.sleep(0.01)

    @property
    def commands(self) -> bool:
        """Whether the session is this one's to end: begun or taken over here, and by nobody since."""
        lease = current_lease(self.setup.links)
        return lease is None or lease.number == self._lease

    def close(self) -> None:
        """Bring the legs to rest and every process to its end; harmless when done twice.

        A session that another console has taken over is left to it.
        """
        if self._closed:
            return
        if self.commands:
            self.send(OperatorKind.SHUT_DOWN)
            if self._host is not None:
                self._host.end(END_S)
            shutil.rmtree(self.setup.links.path, ignore_errors=True)
        self.leave()

    def leave(self) -> None:
        """Leave the session to itself: held, until a console takes it over or its time is over."""
        if self._closed:
            return
        self._closed = True
        self._ending.set()
        with self._lock:
            for link in (self._operator, self._perception, self._streams):
                link.close()
            if self._host is not None:
                self._host.close()

    def send(self, kind: OperatorKind, action: Action | None = None, *, input_ns: int | None = None) -> int:
        """Send an operator command to control; returns its sequence, which control acknowledges.

        input_ns: when its key was pressed (monotonic): by that control finds it too old, or a STOP later. None: now.
        """
        with self._lock:
            self._sequence += 1
            sent_ns = time.monotonic_ns() if input_ns is None else input_ns
            if kind in STOP_KINDS:
                self._stops[self._sequence] = self._lease, sent_ns
            if not self._closed:
                self._operator.send(
                    OperatorCommand(
                        lease=self._lease,
                        sequence=self._sequence,
                        kind=kind,
                        sent_ns=sent_ns,
                        operator=self.setup.operator,
                        action=action,
                    )
                )
            return self._sequence

    def heartbeat(self) -> None:
        """STOP can be given: whoever takes it runs. Without it the heartbeat to control ends."""
        self._heartbeat_s = time.monotonic()

    def silence(self) -> None:
        """STOP can't be given any more: no further heartbeat."""
        self._silent = True

    def send_to_perception(self, command: HandCommand | PerceptionCommand) -> None:
        """Move the digital hand, where the camera is one; change the picture's size or rate, or recording."""
        with self._lock:
            self._perception.send(command)

    def poll(self) -> Latest:
        """The newest of each stream, without waiting."""
        latest = self._streams.receive(self.processes())
        return replace(latest, stop_sent_ns=self._unacknowledged(latest.snapshot, latest.link))

    def processes(self) -> tuple[ProcessStatus, ...]:
        """Each process, as the session's process last said, and whether it still lives: that one may be gone or frozen.

        May be called from another thread than the one that closes: it then stays as it was.
        """
        with self._lock:
            processes = None if self._closed else self._streams.processes()
            now_s = time.monotonic()
            if processes is not None:
                self._processes, self._reported_s = processes, now_s
            elif not self._closed and now_s - self._reported_s > UNREPORTED_S:
                self._processes = tuple(_with_liveness(one) for one in self._processes)
            return self._processes

    def _unacknowledged(self, *messages: ControlSnapshot | LinkHealth | None) -> int:
        """When the oldest STOP was sent of which control has not said yet that it acts on it; 0: it acts on all."""
        with self._lock:
            for one in messages:
                if one is not None:  # a STOP after the takeover comes behind those before it
                    self._stops = {
                        sent: (lease, at_ns)
                        for sent, (lease, at_ns) in self._stops.items()
                        if sent > one.stop_sequence or one.stop_lease not in {lease, self._lease}
                    }
            return min((at_ns for _, at_ns in self._stops.values()), default=0)

    def _take_over(self) -> None:
        """The next lease; control holds the legs from then on, and hears no earlier console."""
        self._host = Peer(self.setup.host_pid, self.setup.host_started)
        try:
            self._lease = take_lease(self.setup.links).number
        except OSError as error:
            raise AppError(SessionFault.NOT_TAKEN_OVER) from error
        self.send(OperatorKind.TAKE_OVER)

    def _host_lives(self) -> bool:
        return self._host is not None and self._host.alive

    def _send_heartbeats(self) -> None:
        set_scheduling("heartbeat")
        while not self._ending.wait(1.0 / streams.OPERATOR.rate_hz):
            if not self._silent and time.monotonic() - self._heartbeat_s < INPUT_TIMEOUT_S:
                self.send(OperatorKind.HEARTBEAT)


def _with_liveness(process: ProcessStatus) -> ProcessStatus:
    with closing(Peer(process.pid)) as peer:
        return msgspec.structs.replace(process, alive=process.alive and peer.alive)
