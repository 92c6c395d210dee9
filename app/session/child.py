"""How every process of a session begins: deaf to the terminal's Ctrl-C, its chatter in a file, its errors told.

Ctrl-C reaches the whole process group; only the console may act on it, so that the legs are brought to rest in
order. Libraries write to stderr as they please; on the console's terminal that would tear the screen.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from app.ipc.links import end_links
from app.system.config import SessionSetup
from app.system.paths import Home
from app.system.scheduling import set_oom_score_adj

# name → "module:function"; imported in the child, so that the console never loads mediapipe or mujoco
ENTRIES = {
    "audit": "app.audit.process:run_audit",
    "bus-log": "app.session.bus_log:run_bus_log",
    "guardian": "app.session.guardian:run_guardian",
    "planner": "app.motion.planner:run_planner",
    "control": "app.control.loop:run_control",
    "perception": "app.perception.process:run_perception",
}


def begin(name: str, setup: SessionSetup) -> None:
    """Run one process of the session to its end; exit status 1 with the traceback in its file on a defect."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_oom_score_adj(name)
    _chatter_to_file(Home(setup.home), f"{setup.session}-{name}")
    try:
        _entry(ENTRIES[name])(setup)
        end_links()
    except Exception:  # noqa: BLE001 - the last word of a process; its text goes to the diagnostics file
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)


def _entry(path: str) -> Callable[[SessionSetup], None]:
    module, function = path.split(":")
    entry: Callable[[SessionSetup], None] = getattr(import_module(module), function)
    return entry


def _chatter_to_file(home: Home, name: str) -> None:
    folder = home.root / "diagnostics"
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder / f"{name}.txt", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.close(handle)


# Loading the hand model takes up to three seconds on a cold disk; after its first report a second's silence
# is thirty missed frames.
FIRST_REPORT_S = 15.0
SILENCE_S = 2.0
BACK_OFF_S = (1.0, 2.0, 4.0, 8.0, 16.0)


@dataclass(slots=True)
class Supervisor:
    """Decides on restarts with a growing back-off; gives up after as many as the back-off has steps."""

    restarts: int = 0
    _last_report_s: float | None = None
    _started_s: float | None = None
    _failed_s: float | None = None

    def must_restart(self, now_s: float, *, alive: bool, reported: bool) -> bool:
        """Whether to start perception again now; counts it when so."""
        if self._started_s is None:
            self._started_s = now_s
        if reported:
            self._last_report_s = now_s
        if alive and not self._silent(now_s):
            self._failed_s = None
            return False
        if self._failed_s is None:
            self._failed_s = now_s
        if self.restarts >= len(BACK_OFF_S) or now_s - self._failed_s < BACK_OFF_S[self.restarts] - 1.0:
            return False
        self.restarts += 1
        self._started_s, self._last_report_s, self._failed_s = now_s, None, None
        return True

    def _silent(self, now_s: float) -> bool:
        if self._last_report_s is None:
            assert self._started_s is not None
            return now_s - self._started_s > FIRST_REPORT_S
        return now_s - self._last_report_s > SILENCE_S
