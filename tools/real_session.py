"""A session of real processes whose console is a process of its own, so that it can be killed too.

Used by the process tests and by the benches. Perception is left out unless asked for: the therapist's keys drive.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
import psutil

from app.ipc.messages import OperatorKind
from app.ipc.states import Action
from app.motion.patient import patient_of
from app.motion.preflight import run_preflight
from app.session import host as hosting
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.paths import Home, find_home
from hal.joints.can.bus import open_bus
from hal.joints.device import BusDevice, load_exoskeleton
from profiles.schema import DEMO_PATIENT
from tools.watched_session import PATIENCE_S, WatchedSession

END = "end"


def run_console(setup: SessionSetup, words: Connection, perception: bool, group: Path | None) -> None:
    """The console's part: joins the control group, starts the processes, beats, passes words on."""
    if group is not None:
        (group / "cgroup.procs").write_text("0", encoding="ascii")  # its children are born there
    if not perception:
        hosting.START_ORDER = tuple(name for name in hosting.START_ORDER if name != "perception")
    setup = msgspec.structs.replace(setup, console_pid=os.getpid())
    host = hosting.SessionHost(setup)
    host.start()
    words.send({one.name: one.pid for one in host.processes()})
    while True:
        host.beat()
        if not words.poll(0.01):
            continue
        word = words.recv()
        if word == END:
            break
        host.send(*word)
    host.close()
    words.send(END)


class RealSession(WatchedSession):
    """Its console's words go through a pipe."""

    def __init__(
        self, home: Path, joints: JointsConfig | None = None, *, perception: bool = False, group: Path | None = None
    ) -> None:
        """group: the kernel's control group that all its processes are to be in."""
        model = str(find_home().models / "hand_landmarker.task") if perception else ""
        config = Config(joints=joints or JointsConfig(), model=model)
        if config.joints.kind == "can":
            device = load_exoskeleton()
            run_preflight(Home(home), patient_of(DEMO_PATIENT, device), device, (Action.INITIALISE,))
        self.setup = hosting.make_setup(Home(home), config, DEMO_PATIENT, "bench")
        context = multiprocessing.get_context("spawn")
        self._words, theirs = context.Pipe()
        self._console = context.Process(target=run_console, args=(self.setup, theirs, perception, group))
        self._console.start()
        assert self._words.poll(PATIENCE_S), "the console did not start"
        self.pids: dict[str, int] = {**self._words.recv(), "console": self._console.pid or 0}
        super().__init__(self.setup.links)

    def send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """The operator's word."""
        self._words.send((kind, action))

    def until_ended(self, *names: str) -> None:
        """Look until these processes are gone. Raises TimeoutError naming those that are not."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            self.look()
            if not [name for name in names if _lives(self.pids[name])]:
                self.look()  # the last words may have come after the look before
                return
        raise TimeoutError(f"still there: {[name for name in names if _lives(self.pids[name])]}")

    def kill(self, name: str, number: signal.Signals = signal.SIGKILL) -> int:
        """Send a signal to one process; when it was sent, monotonic nanoseconds."""
        now_ns = time.monotonic_ns()
        os.kill(self.pids[name], number)
        return now_ns

    def finish(self) -> None:
        """Let the console end the session in good order."""
        if self._console.is_alive():
            with suppress(OSError):
                self._words.send(END)
            self._console.join(25.0)

    def end(self) -> None:
        """Bring everything to its end, killed or not."""
        self.finish()
        for pid in self.pids.values():
            if _lives(pid):
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
                    os.kill(pid, signal.SIGKILL)
        self.close_links()
        self._words.close()
        shutil.rmtree(self.setup.links, ignore_errors=True)


@contextmanager
def real_session(
    home: Path, joints: JointsConfig | None = None, *, perception: bool = False, group: Path | None = None
) -> Iterator[RealSession]:
    """A session that is ended whatever happens."""
    session = RealSession(home, joints, perception=perception, group=group)
    try:
        yield session
    finally:
        session.end()


class Sniffer:
    """An independent witness on the drives' bus: every frame with its time of arrival."""

    def __init__(self, interface: str, channel: str) -> None:
        self.frames: list[tuple[int, int, bytes]] = []  # monotonic ns, identifier, data
        self._bus = open_bus(BusDevice(interface=interface, channel=channel))
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._ending.set()
        self._thread.join()
        self._bus.shutdown()

    def _listen(self) -> None:
        while not self._ending.is_set():
            message = self._bus.recv(0.05)
            if message is not None:
                # the kernel's time of arrival: this thread may be late on a busy machine
                age_ns = max(0, time.time_ns() - int(message.timestamp * 1e9))
                self.frames.append((time.monotonic_ns() - age_ns, message.arbitration_id, bytes(message.data)))


@contextmanager
def saturated_cores() -> Iterator[None]:
    """Every core kept busy by a process that does nothing else, at a user's ordinary priority."""
    burn = [sys.executable, "-c", "while True: pass"]
    burners = [subprocess.Popen(burn) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def _lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
