"""How late control's ticks begin while everything runs and the legs walk: real processes, N seconds; --json too.

Beside it, from begin to end, a bare loop of that rate at SCHED_FIFO: what the host does to any loop. And what ticks and
frames cost: CPU time of control a tick, of perception a frame, while the legs walk. With --console also the console's
memory, and the pauses of the session: `--console --seconds 3600` is an hour in use.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import TypeVar

import msgspec
import psutil
from rich.console import Console
from rich.progress import track
from rich.table import Table

from app.console.keys import GESTURE_KEYS
from app.demo.drives import busy_processes
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import ACTION_OF, Action
from app.ipc.streams import LinkDirectory
from app.session.shared import shared
from app.system.errors import AppError
from app.system.paths import Home
from logs.read import read, session_paths
from logs.records import Pause, Record
from testing.session import RealSession
from testing.watched_session import TIMEOUT_S, WatchedSession
from tools.bench_console import Terminal
from tools.bench_host import bare_loop
from tools.bench_memory import growth_per_sample
from tools.pty_program import configure

Result = TypeVar("Result")
BARE_RATIO = 1.3  # at most so many times the bare loop's
LEAST_FPS = 28.0
PAUSE_S = 0.1
ESCAPE = b"\x1b"
KEYS = {
    OperatorKind.CONFIRM_PATIENT: b"cy",
    OperatorKind.ACKNOWLEDGE: b"ky",
    OperatorKind.TORQUE_OFF: b"oy",
    OperatorKind.STOP: b" ",
}
ACTION_KEYS = {ACTION_OF[gesture]: b"t" + key.encode() for key, gesture in GESTURE_KEYS.items()}
BETWEEN_KEYS_S = 0.25  # as a person types; long enough for a dialog to open
# One a second: help and out, checks and out, the hand signs, clicks, moves and rests, the next theme.
IDLE_KEYS = (b"\x1bOP", ESCAPE, b"s", ESCAPE, b"5", b"\r", b"\x1b[C", b"\x1b[D", b"h", b"\x1bOQ")
IDLE_PERIOD_S = 1.0
MEMORY_PERIOD_S = 10.0


class ConsoleSession(WatchedSession):
    """Its operator commands are keys. A thread takes what the console draws, as fast as a terminal does."""

    def __init__(self, terminal: Terminal, links: LinkDirectory) -> None:
        super().__init__(links)
        self._terminal = terminal
        self._idle_keys = cycle(IDLE_KEYS)
        self._typed_s = time.monotonic()
        self._measured_s = time.monotonic()
        self._console = psutil.Process(terminal.child.pid)
        self.memory_mb: list[float] = []
        self.keys = 0
        self._start_drawing()

    def send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """Leave any open dialog, and type the command."""
        keys = KEYS[kind] if action is None else ACTION_KEYS[action]
        for key in (ESCAPE, *(bytes([key]) for key in keys)):
            self._type(key)
            self._ending.wait(BETWEEN_KEYS_S)

    def poll(self, wait_s: float = 0.02) -> None:
        """Take the newest of everything, and type on."""
        super().poll(wait_s)
        if time.monotonic() - self._measured_s >= MEMORY_PERIOD_S:
            self._measured_s += MEMORY_PERIOD_S
            self.memory_mb.append(self._console.memory_full_info().uss / 1e6)
        if time.monotonic() - self._typed_s >= IDLE_PERIOD_S:
            self._type(next(self._idle_keys))

    def end(self) -> None:
        """Look and draw no more."""
        self._stop_drawing()
        self.close_links()

    def growth_mb_per_h(self) -> float:
        """Of the console's own memory; nan for less than a minute."""
        return growth_per_sample(self.memory_mb) * 3600 / MEMORY_PERIOD_S if len(self.memory_mb) > 6 else float("nan")

    def _type(self, key: bytes) -> None:
        os.write(self._terminal.master, key)
        self._typed_s = time.monotonic()
        self.keys += 1

    def _start_drawing(self) -> None:
        self._ending = threading.Event()
        self._drawing = threading.Thread(target=self._draw, daemon=True)
        self._drawing.start()

    def _stop_drawing(self) -> None:
        self._ending.set()
        self._drawing.join()

    def _draw(self) -> None:
        while not self._ending.is_set():
            self._terminal.idle(0.1)


@contextmanager
def console_session(home: Path) -> Iterator[ConsoleSession]:
    """A console with its session, both ended whatever happens."""
    configure(home)
    with tempfile.TemporaryDirectory(prefix="bench-") as sockets:
        terminal = Terminal(home, 80, 24, os.environ | {"TMPDIR": sockets})
        try:
            terminal.wait(b"STOP")
            session = ConsoleSession(terminal, links_of(Home(home), terminal))
            try:
                session.until(lambda _: True, "control's first message")
                yield session
            finally:
                session.end()
        finally:
            terminal.close()


def links_of(home: Home, terminal: Terminal) -> LinkDirectory:
    """The session's sockets and their key, as an observer finds them. Raises TimeoutError."""
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        terminal.idle(0.05)
        with contextlib.suppress(AppError):
            return shared(home).links
    raise TimeoutError("the console began no session")


def walk_for(session: WatchedSession, seconds: float) -> Counter[str]:
    """Keep the legs walking, again after whatever held them; what that was, and how often."""
    held: Counter[str] = Counter()
    session.walk()
    deadline = time.monotonic() + seconds
    for _ in track(range(int(seconds)), description="walking", disable=not os.isatty(1)):
        pause = min(time.monotonic() + 1.0, deadline)
        while time.monotonic() < pause:
            session.poll()
        now = session.snapshot
        if now is not None and now.action is not Action.WALK and time.monotonic() < deadline:
            held.update(event.event.value for event in now.events if not event.acknowledged)
            _walk_again(session, held)
    return held


def _walk_again(session: WatchedSession, held: Counter[str]) -> None:
    """If there is a way: legs that sank without power may be too low to be lifted by the drives."""
    try:
        session.walk()
    except TimeoutError:
        held["no way back to standing"] += 1


def main() -> None:
    """Measure and print."""
    asked = arguments()
    load = busy_processes(len(os.sched_getaffinity(0))) if asked.saturate else contextlib.nullcontext()
    session_mb: list[float] = []
    with tempfile.TemporaryDirectory() as folder, bare_loop() as bare, begun(asked, Path(folder)) as session:
        with load:
            held, costs_ms = measure_costs(session, lambda: walk_for(session, asked.seconds))
        session.send(OperatorKind.ACT, Action.WALK_END)
        snapshot = session.until(lambda s: s.action is None, "the end of the walk")
        fps = session.perception_fps()
        pauses = pauses_of(Home(Path(folder)))
        if isinstance(session, ConsoleSession):
            growth = session.growth_mb_per_h()
            Console().print(f"{session.keys} keys were typed; the console's memory grows by {growth:.2f} MB an hour.")
            costs_ms["console_growth_mb_per_h"] = growth
            session_mb = session.memory_mb
    show(snapshot, fps, held, costs_ms, bare)
    show_pauses(pauses)
    if asked.json:
        figures = figures_of(snapshot, fps) | costs_ms | {f"bare_{name}": value for name, value in bare.items()}
        figures["console_mb"] = session_mb  # a sample every MEMORY_PERIOD_S
        figures["pauses_by_cause"] = pauses
        asked.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def measure_costs(session: WatchedSession, work: Callable[[], Result]) -> tuple[Result, dict[str, float]]:
    """What the work gives, and the CPU time of control a tick and of perception a frame meanwhile; of known processes.

    Perception's holds the digital camera's own rendering.
    """
    session.stand()  # everything is loaded
    before = _spent(session)
    result = work()
    names = {"control": "cpu_ms_a_tick", "perception": "perception_cpu_ms_a_frame"}
    costs_ms = {}
    for name, (spent_s, count) in _spent(session).items():
        before_s, before_count = before[name]
        costs_ms[names[name]] = 1000 * (spent_s - before_s) / max(1, count - before_count)
    return result, costs_ms


def pauses_of(home: Home) -> dict[str, list[float]]:
    """How long each recorded pause of the session's trail took, in seconds, by cause; the longest first."""
    found: dict[str, list[float]] = {}
    for path in session_paths(home.logs):
        for record in read(path):
            if isinstance(record, Record) and isinstance(record.body, Pause):
                found.setdefault(record.body.cause, []).append(record.body.duration_s)
    return {cause: sorted(durations, reverse=True) for cause, durations in found.items()}


def _spent(session: WatchedSession) -> dict[str, tuple[float, int]]:
    """Of control and perception: CPU seconds, and ticks or frames so far."""
    counts = {"control": session.snapshot.lateness.ticks if session.snapshot else 0}
    counts |= {"perception": session.report.sequence} if session.report else {}
    pids = session.pids if isinstance(session, RealSession) else {}
    times = {name: psutil.Process(pids[name]).cpu_times() for name in counts if name in pids}
    return {name: (spent.user + spent.system, counts[name]) for name, spent in times.items()}


def begun(asked: argparse.Namespace, home: Path) -> contextlib.AbstractContextManager[WatchedSession]:
    """The session to be measured."""
    if asked.console:
        return console_session(home)
    return RealSession(home, perception=not asked.no_perception)


def arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="600 for the bound's ten minutes")
    parser.add_argument("--saturate", action="store_true", help="a process that never rests on every core meanwhile")
    under = parser.add_mutually_exclusive_group()
    under.add_argument("--console", action="store_true", help="under `rleex run` in a terminal, in use all the time")
    under.add_argument("--no-perception", action="store_true")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def show(
    snapshot: ControlSnapshot, fps: float, held: Counter[str], costs_ms: dict[str, float], bare: dict[str, float]
) -> None:
    """The figures beside their bounds."""
    real_time = snapshot.real_time
    table = Table("lateness", "value", "bound")
    for name, value in msgspec.structs.asdict(snapshot.lateness).items():
        table.add_row(name, f"{value:.4g}", _beside(value, bare[name]) if name in bare else "")
    got = f"{real_time.fifo} / {real_time.memory_locked} / {real_time.core} / {real_time.cores_awake}"
    table.add_row("SCHED_FIFO / locked / core / cores awake", got, "")
    table.add_row("steps walked", str(snapshot.steps), "")
    table.add_row("what ended a walk", ", ".join(f"{name} {times}" for name, times in held.items()) or "nothing", "")
    table.add_row("pauses", f"{snapshot.pauses.count}, together {snapshot.pauses.total_s:.3f} s", "")
    for name, cost_ms in costs_ms.items():
        table.add_row(name, f"{cost_ms:.3f}", "")
    if fps:
        table.add_row("perception fps", f"{fps:.1f}", f"≥ {LEAST_FPS:g} {'yes' if fps >= LEAST_FPS else 'NO'}")
    Console().print(table)


def show_pauses(pauses: dict[str, list[float]]) -> None:
    """Each cause's longest beside its bound."""
    table = Table("pauses by cause", "count", "longest s", f"≤ {PAUSE_S:g} s")
    for cause, durations_s in pauses.items():
        longest_s = durations_s[0]
        table.add_row(cause, str(len(durations_s)), f"{longest_s:.3f}", "yes" if longest_s <= PAUSE_S else "NO")
    Console().print(table)


def _beside(value: float, bare: float) -> str:
    return f"{value / bare:.2f} × bare loop's {bare:.4g}: {'yes' if value <= BARE_RATIO * bare else 'NO'}"


def figures_of(snapshot: ControlSnapshot, fps: float) -> dict[str, object]:
    """As --json writes them."""
    real_time = snapshot.real_time
    return {
        **msgspec.structs.asdict(snapshot.lateness),
        "fifo": real_time.fifo,
        "memory_locked": real_time.memory_locked,
        "cores_awake": real_time.cores_awake,
        "steps": snapshot.steps,
        "pauses": snapshot.pauses.count,
        "paused_s": snapshot.pauses.total_s,
        "perception_fps": fps,
    }


if __name__ == "__main__":
    main()
