"""The process that records the buses beside the audit trail, for sessions with drives on CAN."""

from __future__ import annotations

import os
import signal
from enum import Enum
from pathlib import Path

from app.audit.sink import AuditSink
from app.system.config import SessionSetup, load_device
from app.system.paths import Home
from app.system.scheduling import set_scheduling
from hal.errors import HardwareError
from hal.joints.can.bus import with_bus
from hal.joints.can.candump import BusRecorder
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
    """Record until asked to end or orphaned. A bus that can't be opened is noted in the audit trail."""
    sink = AuditSink(setup.links, "bus log", setup.operator)
    ending = _Ending(setup.host_pid)
    signal.signal(signal.SIGTERM, ending.ask)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    set_scheduling("bus log")
    sink.emit(ProcessStart(pid=os.getpid()))
    try:
        _record(setup, ending)
    except HardwareError as error:
        sink.emit(Note(text=reason(BusLogNotice.NOT_RECORDED, cause=reason_of(error))))
    sink.emit(
        ProcessEnd(
            pid=os.getpid(), reason=reason(BusLogNotice.ASKED_TO_END if ending.asked else BusLogNotice.CONSOLE_GONE)
        )
    )
    sink.close()


def _record(setup: SessionSetup, ending: _Ending) -> None:
    chosen, home = setup.config.joints, Home(setup.home)
    device = load_device(chosen)
    home.logs.mkdir(parents=True, exist_ok=True, mode=0o700)
    recorder = BusRecorder(with_bus(device, chosen.interface, chosen.channel), log_path(home, setup.session))
    try:
        recorder.run(ending)
    finally:
        recorder.close()


class _Ending:
    """Whether to end: asked to, or orphaned."""

    def __init__(self, host_pid: int) -> None:
        self._host_pid = host_pid
        self.asked = False

    def ask(self, _number: int, _frame: object) -> None:
        """The signal's handler."""
        self.asked = True

    def __call__(self) -> bool:
        return self.asked or os.getppid() != self._host_pid
