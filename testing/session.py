"""Real sessions for tests and benches: their processes, and a witness on the drives' bus.

The console is a process of its own, so that it can be killed as well. Perception is left out unless asked for: operator
commands drive the legs.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import threading
import time
from contextlib import suppress
from enum import Enum
from multiprocessing.connection import Connection
from pathlib import Path

import psutil

from app.demo.session import record_pictures
from app.ipc.messages import OperatorKind
from app.ipc.states import Action
from app.motion.plan import patient_of
from app.motion.preflight import run_preflight
from app.session import host as hosting
from app.session.setup import make_setup
from app.session.shared import held_session, shared
from app.system.authority import demonstration
from app.system.config import Config, JointsConfig, RecordingConfig, SessionSetup
from app.system.paths import Home, find_home
from hal.inputs.device import InputDevice
from hal.joints.can.bus import open_bus
from hal.joints.device import BusDevice, load_exoskeleton
from profiles.schema import DEMO_PATIENT, Profile
from testing.watched_session import TIMEOUT_S, WatchedSession


def control_core_of_worker() -> int | None:
    """A core for control that the other workers of pytest-xdist leave alone; two controls on one starve it."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    cores = sorted(os.sched_getaffinity(0), reverse=True)
    return cores[int(worker.removeprefix("gw")) % len(cores)] if worker else None


END = "end"


class Consent(Enum):
    """To pictures; what a pipe to the console carries."""

    GIVEN = "given"
    WITHDRAWN = "withdrawn"


def run_console(setup: SessionSetup, commands: Connection, perception: bool, group: Path | None) -> None:
    """The console process: joins the control group, starts the processes, sends heartbeats, forwards commands."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a whole terminal: whoever measures ends the session in order
    if group is not None:
        (group / "cgroup.procs").write_text("0", encoding="ascii")  # its children are born there
    host = hosting.SessionHost(setup, without=frozenset() if perception else frozenset({"perception"}))
    host.start()
    commands.send({"session": shared(Home(setup.home)).host_pid} | {one.name: one.pid for one in host.processes()})
    while True:
        host.heartbeat()
        if not commands.poll(0.01):
            continue
        command = commands.recv()
        if command == END:
            break
        if isinstance(command, Consent):
            record_pictures(host, consent=command is Consent.GIVEN)
        else:
            host.send(*command)
    host.close()
    commands.send(END)


class RealSession(WatchedSession):
    """Its operator commands go through a pipe. As a context it is ended whatever happens."""

    def __init__(
        self,
        home: Path,
        joints: JointsConfig | None = None,
        *,
        perception: bool = False,
        group: Path | None = None,
        unattended_s: float = 120.0,
        recording: bool = False,
        encrypt: bool = False,
        patient: Profile = DEMO_PATIENT,
        inputs: tuple[InputDevice, ...] = (),
    ) -> None:
        """group: the kernel's control group that all its processes are to be in. unattended_s: without a console."""
        self._taken: hosting.SessionHost | None = None  # by another console, which is this process
        model = str(find_home().models / "hand_landmarker.task") if perception else ""
        config = Config(
            joints=joints or JointsConfig(),
            model=model,
            control_core=control_core_of_worker(),
            unattended_s=unattended_s,
            recording=RecordingConfig(on=recording, encrypt=encrypt),
            inputs=inputs,
        )
        if config.joints.kind == "can":
            device = load_exoskeleton()
            run_preflight(Home(home), patient_of(patient, device), device, (Action.INITIALISE,))
        self.setup = make_setup(Home(home), config, patient, demonstration(Home(home), config.joints, "bench"))
        context = multiprocessing.get_context("spawn")
        self._commands, theirs = context.Pipe()
        self._console = context.Process(target=run_console, args=(self.setup, theirs, perception, group))
        self._console.start()
        assert self._commands.poll(TIMEOUT_S), "the console did not start"
        self.pids: dict[str, int] = {**self._commands.recv(), "console": self._console.pid or 0}
        super().__init__(self.setup.links)

    def __enter__(self) -> RealSession:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """Send an operator command."""
        if self._taken is not None:
            self._taken.send(kind, action)
        else:
            self._commands.send((kind, action))

    def record_pictures(self, *, consent: bool) -> None:
        """The patient agrees to the camera's pictures, or withdraws it."""
        self._commands.send(Consent.GIVEN if consent else Consent.WITHDRAWN)

    def poll(self, wait_s: float = 0.02) -> None:
        """As the base, and say that STOP can be given."""
        if self._taken is not None:
            self._taken.heartbeat()
        super().poll(wait_s)

    def take_over(self) -> None:
        """Command from this process, after the console has gone. Raises AppError when the session is over."""
        held = held_session(Home(self.setup.home))
        assert held is not None, "no session is held"
        self._taken = hosting.SessionHost(held)
        self._taken.start()

    def leave(self) -> None:
        """Lose the console that took over, without a word."""
        assert self._taken is not None
        self._taken.leave()

    def until_ended(self, *names: str) -> None:
        """Poll until these processes are gone. Raises TimeoutError naming those that are not."""
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            self.poll()
            if not [name for name in names if _lives(self.pids[name])]:
                self.poll()  # the last messages may have come after the previous poll
                return
        raise TimeoutError(f"still there: {[name for name in names if _lives(self.pids[name])]}")

    def kill(self, name: str, number: signal.Signals = signal.SIGKILL) -> int:
        """Send a signal to one process; when it was sent, monotonic nanoseconds."""
        now_ns = time.monotonic_ns()
        os.kill(self.pids[name], number)
        return now_ns

    def finish(self) -> None:
        """Let the console end the session in good order."""
        if self._taken is not None:
            self._taken.close()
        if self._console.is_alive():
            with suppress(OSError):
                self._commands.send(END)
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
        self._commands.close()
        shutil.rmtree(self.setup.links, ignore_errors=True)


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


def _lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
