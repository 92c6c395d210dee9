from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from app.demo.drives import busy_processes

LIMIT_S = 30.0
ORPHANING = """
import time
from app.demo.drives import busy_processes
with busy_processes(2) as pids:
    print(*pids, flush=True)
    time.sleep(1000)
"""


def test_the_processes_are_busy_at_ordinary_priority_and_end_with_the_body() -> None:
    with busy_processes(2) as pids:
        found = [psutil.Process(pid) for pid in pids]
        assert len(found) == 2
        for process in found:
            while process.cpu_times().user < 0.05:  # becomes busy; a hang is pytest's own limit
                assert process.is_running()
            assert process.nice() == 0
    assert not any(psutil.pid_exists(pid) for pid in pids)


@pytest.mark.skipif(sys.platform != "linux", reason="orphans are told by their parent's PID")
def test_they_end_although_their_parent_is_killed() -> None:
    root = Path(__file__).parents[3]
    with subprocess.Popen(
        [sys.executable, "-c", ORPHANING],
        stdout=subprocess.PIPE,
        text=True,
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
    ) as parent:
        assert parent.stdout is not None
        orphans = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
        parent.send_signal(signal.SIGKILL)
    _, alive = psutil.wait_procs(orphans, timeout=LIMIT_S)
    assert alive == []
