"""A session: its processes, their links, and what the console or the demo receives from them.

The host decides nothing about legs. It starts the processes in the order in which they are needed, sends the
operator's commands, gives the newest message of each stream, restarts a perception that died or froze, and ends all in
order: control first (hold, damp, disable), the audit trail last.
"""

from __future__ import annotations

import multiprocessing
import os
import secrets
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

import msgspec

from app.ipc import streams
from app.ipc.links import LatestReceiver, OrderedSender, address, new_link_directory
from app.ipc.messages import (
    AuditHealth,
    ControlSnapshot,
    HandCommand,
    OperatorCommand,
    OperatorKind,
    PerceptionCommand,
    Preview,
    TriggerReport,
)
from app.ipc.states import Action
from app.session.child import Supervisor, run_process
from app.system.config import Config, SessionSetup
from app.system.diagnostics_log import get_logger
from app.system.legs_lock import LegsLock, claim_legs
from app.system.paths import Home
from app.system.scheduling import set_scheduling
from profiles.schema import Profile

_log = get_logger("host")

M = TypeVar("M", bound=msgspec.Struct)

START_ORDER: tuple[str, ...] = ("audit", "perception", "guardian", "planner", "control")
# Control holds (0.15 s), damps and disables; then the others have nothing left to send.
END_PATIENCE_S = {"control": 6.0, "perception": 2.0, "planner": 2.0, "guardian": 2.0, "bus-log": 2.0, "audit": 5.0}
# The heartbeat says that STOP can be given. The terminal's input thread, which takes STOP, reports every 0.1 s.
INPUT_TIMEOUT_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStatus:
    """One process of the session as the host sees it."""

    name: str
    pid: int
    alive: bool
    restarts: int
    exit_code: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Latest:
    """The newest of each stream; None where nothing new came since the last poll."""

    snapshot: ControlSnapshot | None
    report: TriggerReport | None
    preview: Preview | None
    audit: AuditHealth | None
    processes: tuple[ProcessStatus, ...]


def make_setup(home: Home, config: Config, profile: Profile, operator: str, role: str = "therapist") -> SessionSetup:
    """Name a session and give it its private directory of sockets."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    return SessionSetup(
        session=f"{stamp}-{secrets.token_hex(2)}",
        home=home.root,
        links=new_link_directory(Path(tempfile.mkdtemp(prefix="rleex-"))),  # 0700; short enough for a socket's name
        config=config,
        profile=profile,
        operator=operator,
        role=role,
        console_pid=os.getpid(),
    )


def _start_order(config: Config) -> tuple[str, ...]:
    """Joints on CAN have their buses recorded from the first frame on."""
    return (*START_ORDER[:1], "bus-log", *START_ORDER[1:]) if config.joints.kind == "can" else START_ORDER


class SessionHost:
    """Starts, supervises and ends one session. `send` may be called from any thread."""

    def __init__(self, setup: SessionSetup, *, entry: Callable[[str, SessionSetup], None] = run_process) -> None:
        """entry: what each process runs with its name and the setup; importable, for it is spawned."""
        self.setup = setup
        self._entry = entry
        self._children: dict[str, multiprocessing.process.BaseProcess] = {}
        self._supervisor = Supervisor()
        self._legs: LegsLock | None = None
        self._operator = OrderedSender(address(setup.links, streams.OPERATOR.name))
        self._perception = OrderedSender(address(setup.links, streams.TO_PERCEPTION.name))
        self._lock = threading.Lock()
        self._sequence = 0
        self._heartbeat_s = time.monotonic()
        self._silent = False
        self._ending = threading.Event()
        self._heartbeat_thread = threading.Thread(target=self._send_heartbeats, name="operator-heartbeat", daemon=True)
        self._snapshots = self._subscribe(streams.SNAPSHOT.name, ControlSnapshot)
        self._reports = self._subscribe(streams.TRIGGER.name, TriggerReport)
        self._previews = self._subscribe(streams.PREVIEW.name, Preview)
        self._audit = self._subscribe(streams.AUDIT_HEALTH.name, AuditHealth)

    def start(self) -> None:
        """Start every process; returns at once, the streams show when each is ready.

        Raises AppError while a process of an earlier session may still command or damp the legs.
        """
        self._legs = claim_legs(self.setup)
        for name in _start_order(self.setup.config):
            self._spawn(name)
        self._heartbeat_thread.start()

    def close(self) -> None:
        """Bring the legs to rest and every process to its end; harmless when done twice."""
        if self._ending.is_set():
            return
        self.send(OperatorKind.SHUT_DOWN)
        self._end("control")
        self._ending.set()
        for name in ("perception", "planner", "guardian", "bus-log"):
            self._end(name)
        shutil.rmtree(self.setup.links, ignore_errors=True)  # all that audit receives is connected
        self._end("audit")
        for link in (
            self._operator,
            self._perception,
            self._snapshots,
            self._reports,
            self._previews,
            self._audit,
        ):
            link.close()
        if self._legs is not None:
            self._legs.close()

    def send(self, kind: OperatorKind, action: Action | None = None, note: str = "") -> int:
        """Send an operator command to control; returns its sequence, which control acknowledges."""
        with self._lock:
            self._sequence += 1
            self._operator.send(
                OperatorCommand(
                    sequence=self._sequence,
                    kind=kind,
                    sent_ns=time.monotonic_ns(),
                    operator=self.setup.operator,
                    action=action,
                    note=note,
                )
            )
            return self._sequence

    def heartbeat(self) -> None:
        """STOP can be given: whoever takes it runs. Without it the heartbeat to control ends."""
        self._heartbeat_s = time.monotonic()

    def silence(self) -> None:
        """STOP can't be given any more: no further heartbeat."""
        self._silent = True

    def move_hand(self, command: HandCommand) -> None:
        """Move the digital hand, where the camera is one."""
        with self._lock:
            self._perception.send(command)

    def send_to_perception(self, command: PerceptionCommand) -> None:
        """Change the picture's size or rate, or recording."""
        with self._lock:
            self._perception.send(command)

    def poll(self) -> Latest:
        """The newest of each stream, without waiting."""
        report = self._reports.receive()
        self._supervise_perception(reported=report is not None)
        return Latest(
            snapshot=self._snapshots.receive(),
            report=report,
            preview=self._previews.receive(),
            audit=self._audit.receive(),
            processes=self.processes(),
        )

    def processes(self) -> tuple[ProcessStatus, ...]:
        """Each process and whether it lives."""
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
            target=self._entry, args=(name, self.setup), daemon=True, name=f"rleex-{name}"
        )
        child.start()  # daemon: a console that dies by an exception still asks it to end (SIGTERM)
        _log.info("process spawned", child=name, child_pid=child.pid)
        self._children = {**self._children, name: child}  # anew: another thread may be going through the old one

    def _supervise_perception(self, *, reported: bool) -> None:
        child = self._children.get("perception")
        if child is None or self._ending.is_set():
            return
        if self._supervisor.must_restart(time.monotonic(), alive=child.is_alive(), reported=reported):
            _log.warning("perception restarts", restarts=self._supervisor.restarts, exit_code=child.exitcode)
            child.kill()  # a driver frozen in the kernel handles no SIGTERM
            child.join(1.0)
            self._spawn("perception")

    def _end(self, name: str) -> None:
        child = self._children.get(name)
        if child is None:
            return
        if name != "control":  # control was asked by SHUT_DOWN, and needs its time
            child.terminate()
        child.join(END_PATIENCE_S[name])
        if child.is_alive():
            _log.warning("process killed", child=name, patience_s=END_PATIENCE_S[name])
            child.kill()
            child.join(1.0)

    def _send_heartbeats(self) -> None:
        set_scheduling("heartbeat")
        while not self._ending.wait(1.0 / streams.OPERATOR.rate_hz):
            if not self._silent and time.monotonic() - self._heartbeat_s < INPUT_TIMEOUT_S:
                self.send(OperatorKind.HEARTBEAT)

    def _subscribe(self, name: str, kind: type[M]) -> LatestReceiver[M]:
        return LatestReceiver(address(self.setup.links, name), kind)
