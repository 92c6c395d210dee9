"""What every process of a session runs first, and when perception is started again.

Ctrl-C and the hang-up of the terminal reach the whole process group; only the console and control may act on them, so
that the legs are brought to rest in order. Native libraries write to stderr as they please, which would tear the
console's screen: it goes to a file.
"""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name

from app.ipc.links import end_links
from app.system.config import SessionSetup
from app.system.diagnostics_log import get_logger, start_log, stop_log
from app.system.paths import Home
from app.system.scheduling import set_oom_score_adj, start_autogroup

# name → "module:function"; imported in the child, so that the console never loads mediapipe or mujoco
ENTRY_POINTS = {
    "audit": "app.audit.process:run_audit",
    "bus-log": "app.session.bus_log:run_bus_log",
    "recording": "app.recording.process:run_recording",
    "guardian": "app.session.guardian:run_guardian",
    "planner": "app.motion.planner:run_planner",
    "control": "app.control.loop:run_control",
    "link": "app.link.client:run_link",
    "perception": "app.perception.process:run_perception",
}

OWN_GROUP = frozenset({"guardian", "control", "planner", "link", "audit"})  # needed in time, with little to do

_log = get_logger("process")


def run_process(name: str, setup: SessionSetup) -> None:
    """Run one process of the session to its end; exit status 1, with the traceback in its log, on a defect."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    set_oom_score_adj(name)
    if name in OWN_GROUP:
        start_autogroup(name)
    home = Home(setup.home)
    start_log(home, name, session=setup.session, patient=setup.profile.identifier)
    _redirect_output(output_of(setup, name))
    _log.info("process started")
    try:
        resolve_name(ENTRY_POINTS[name])(setup)
        end_links()
    except Exception:  # noqa: BLE001 - the last line of a process; its traceback goes to the log
        _log.exception("process ended by an exception")
        stop_log()
        os._exit(1)
    _log.info("process ended")
    stop_log()


def output_of(setup: SessionSetup, name: str) -> Path:
    """The file for what native libraries print in a process of the session, instead of to the terminal."""
    return setup.home / "diagnostics" / f"{setup.session}-{name}.txt"


def remove_empty_output(setup: SessionSetup, name: str) -> None:
    """After the process's end: most print nothing."""
    path = output_of(setup, name)
    with suppress(OSError):  # another place than a file, or a disk that can't be written
        if not path.stat().st_size:
            path.unlink()


def _redirect_output(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.close(handle)


# Imports take two seconds, sixteen beside another session on two cores, and the hand model is still to be loaded then:
# a restart would only begin anew. Afterwards control refuses gestures within a quarter of a second of silence; the
# restart is for a frozen process, not for one that other programs keep from running.
LOADING_S = 40.0
SILENCE_S = 5.0
BACK_OFF_S = (1.0, 2.0, 4.0, 8.0, 16.0)
STEADY_S = 60.0  # one that still reports after this is no repetition of the failure before
AWAY_S = 1.0  # between two questions, of twenty a second: no more counts as silence


@dataclass(slots=True)
class Supervisor:
    """Decides on restarts with a growing back-off; gives up after as many in a row as the back-off has steps."""

    restarts: int = 0  # of the whole session
    _ready: bool = False  # the hand model is loaded
    _in_a_row: int = 0
    _last_report_s: float | None = None
    _started_s: float | None = None
    _failed_s: float | None = None
    _asked_s: float | None = None

    def must_restart(self, now_s: float, *, alive: bool, reported: bool, ready: bool = True) -> bool:
        """Whether to start perception again now; counts it when so. ready: its report says that the model is loaded.

        Silence is counted while somebody asks: on a computer that stands still all processes do.
        """
        self._leave_out_pause(now_s)
        if self._started_s is None:
            self._started_s = now_s
        if reported:
            self._last_report_s, self._ready = now_s, ready
            if now_s - self._started_s >= STEADY_S:
                self._in_a_row = 0
        if alive and not self._silent(now_s):
            self._failed_s = None
            return False
        if self._failed_s is None:
            self._failed_s = now_s
        if self._in_a_row >= len(BACK_OFF_S) or now_s - self._failed_s < BACK_OFF_S[self._in_a_row] - 1.0:
            return False
        self.restarts += 1
        self._in_a_row += 1
        self._started_s, self._last_report_s, self._failed_s, self._ready = now_s, None, None, False
        return True

    def _leave_out_pause(self, now_s: float) -> None:
        paused_s = 0.0 if self._asked_s is None else max(0.0, now_s - self._asked_s - AWAY_S)
        self._asked_s = now_s
        if self._started_s is not None:
            self._started_s += paused_s
        if self._last_report_s is not None:
            self._last_report_s += paused_s

    def _silent(self, now_s: float) -> bool:
        newest_s = self._started_s if self._last_report_s is None else self._last_report_s
        assert newest_s is not None
        return now_s - newest_s > (SILENCE_S if self._ready else LOADING_S)
