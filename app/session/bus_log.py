"""The process that records the buses beside the audit trail, for sessions with drives on CAN."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import closing
from enum import Enum
from pathlib import Path

from app.audit.sink import AuditSink
from app.system.config import SessionSetup, load_device
from app.system.paths import Home
from app.system.scheduling import set_scheduling
from hal.errors import HardwareError
from hal.joints.can.bus import with_bus
from hal.joints.can.recorder import BusRecorder
from logs.disk import FLOOR_BYTES
from logs.reason import reason, reason_of
from logs.records import Note, ProcessEnd, ProcessStart


class BusLogNotice(Enum):
    """What the process notes in the trail."""

    NOT_RECORDED = "not recorded"
    ASKED_TO_END = "asked to end"
    CONSOLE_GONE = "console gone"


def log_path(home: Home, session: str) -> Path:
    """Where a session's bus log lies: beside its audit trail."""
    return home.logs / f"{session}.can.log"


def run_bus_log(setup: SessionSetup) -> None:
    """Record until asked to end or orphaned. What can't be written, and each gap, is noted in the audit trail."""
    sink = AuditSink(setup.links, "bus log", setup.operator)
    asked: list[int] = []  # signals to end that came
    signal.signal(signal.SIGTERM, lambda number, _: asked.append(number))
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    set_scheduling("bus log")
    linger_s = 1.0
    sink.emit(ProcessStart(pid=os.getpid()))
    try:
        _record(setup, asked, lambda gap: sink.emit(Note(text=reason_of(gap))))
        cause = reason(BusLogNotice.ASKED_TO_END if asked else BusLogNotice.CONSOLE_GONE)
    except HardwareError as error:
        cause = reason(BusLogNotice.NOT_RECORDED, cause=reason_of(error))
        sink.emit(Note(text=cause))
        linger_s = 10.0  # on a busy computer it may end before it is connected, and nobody waits for it
    sink.emit(ProcessEnd(pid=os.getpid(), reason=cause))
    sink.close(linger_s)


def _record(setup: SessionSetup, asked: list[int], report: Callable[[HardwareError], object]) -> None:
    chosen, home = setup.config.joints, Home(setup.home)
    device = load_device(chosen)
    home.logs.mkdir(parents=True, exist_ok=True, mode=0o700)
    buses = with_bus(device, chosen.interface, chosen.channel)
    path = log_path(home, setup.session)
    with closing(BusRecorder(buses, path, floor_bytes=FLOOR_BYTES, waits=True, report=report)) as recorder:
        recorder.run(lambda: bool(asked) or setup.orphaned)
