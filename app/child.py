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
from importlib import import_module

from app.links import end_links
from app.out_of_memory import stand_in_line
from app.paths import Home
from app.setup import SessionSetup

# name → "module:function"; imported in the child, so that the console never loads mediapipe or mujoco
ENTRIES = {
    "audit": "app.audit_process:run_audit",
    "bus-log": "app.bus_log:run_bus_log",
    "guardian": "app.guardian:run_guardian",
    "planner": "app.control.planner:run_planner",
    "control": "app.control.loop:run_control",
    "perception": "app.perception.process:run_perception",
}


def begin(name: str, setup: SessionSetup) -> None:
    """Run one process of the session to its end; exit status 1 with the traceback in its file on a defect."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stand_in_line(name)
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
