"""STOP through a real terminal while the event loop is stuck: the input thread must send it."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import time
from pathlib import Path

STUCK = """
import sys, time
from pathlib import Path
from app.system.config import Config
from app.console.app import ConsoleApp
from app.ipc.messages import OperatorKind
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost

report = Path(sys.argv[2])

class Reporting(FakeHost):
    def send(self, kind, action=None, note=""):
        if kind is OperatorKind.STOP:
            report.write_text("stopped while stuck")
        return super().send(kind, action, note)

beat = ConsoleApp._tick

def stick(self):
    beat(self)
    if self.live and self.live.state.snapshot:
        report.with_suffix(".stuck").touch()
        while not report.exists():
            time.sleep(0.01)
        self.exit()

ConsoleApp._tick = stick
ConsoleApp(Home(Path(sys.argv[1])), Config(), profile=DEMO_PATIENT, make_host=Reporting).run()
"""
LIMIT_S = 120.0


def test_stop_is_sent_while_the_event_loop_is_stuck(tmp_path: Path) -> None:
    report = tmp_path / "report"
    ours, theirs = pty.openpty()
    text = [sys.executable, "-c", STUCK, str(tmp_path / "home"), str(report)]
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"}
    child = subprocess.Popen(text, stdin=theirs, stdout=theirs, stderr=theirs, env=environment, close_fds=True)
    os.close(theirs)
    try:
        _until(ours, report.with_suffix(".stuck"))
        os.write(ours, b" ")
        _until(ours, report)
        assert report.read_text() == "stopped while stuck"
    finally:
        child.terminate()
        while child.poll() is None:
            _drain(ours)
        os.close(ours)


def _until(terminal: int, path: Path) -> None:
    limit = time.monotonic() + LIMIT_S
    while not path.exists():
        assert time.monotonic() < limit, f"{path.name} did not come"
        _drain(terminal)


def _drain(terminal: int) -> None:
    readable, _, _ = select.select([terminal], [], [], 0.05)
    if readable:
        try:
            os.read(terminal, 65536)
        except OSError:
            time.sleep(0)  # the other end has gone
