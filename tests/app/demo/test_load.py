from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from app.demo.drives import DemoFault, busy_processes
from app.system.errors import AppError

LIMIT_S = 30.0
ORPHANING = """
import time
from app.demo.drives import busy_processes
with busy_processes(2) as pids:
    print(*pids, flush=True)
    time.sleep(1000)
"""
ROOT = Path(__file__).parents[3]
NICED = """
import ctypes, os, psutil
from app.demo.drives import busy_processes
ctypes.CDLL(None).prctl(24, 23, 0, 0, 0)  # PR_CAPBSET_DROP, CAP_SYS_NICE: root's processes lose it, others never had it
os.nice(5)
with busy_processes(1) as (pid,):
    process = psutil.Process(pid)
    while process.cpu_times().user < 0.3:  # becomes busy
        assert process.status() != psutil.STATUS_ZOMBIE
    print(process.nice())
"""


def test_the_processes_are_busy_at_ordinary_priority_and_end_with_the_body() -> None:
    with busy_processes(2) as pids:
        found = [psutil.Process(pid) for pid in pids]
        assert len(found) == 2
        for process in found:
            while process.cpu_times().user < 0.05:  # becomes busy; a hang is pytest's own limit
                assert process.is_running()
            assert process.nice() in {0, os.nice(0)}  # the latter where it may not be raised
    assert not any(psutil.pid_exists(pid) for pid in pids)


@pytest.mark.skipif(sys.platform != "linux", reason="orphans are told by their parent's PID")
def test_they_end_although_their_parent_is_killed() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", ORPHANING],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as parent:
        assert parent.stdout is not None
        orphans = [psutil.Process(int(pid)) for pid in parent.stdout.readline().split()]
        parent.send_signal(signal.SIGKILL)
    _, alive = psutil.wait_procs(orphans, timeout=LIMIT_S)
    assert alive == []


@pytest.mark.skipif(sys.platform != "linux", reason="capabilities are Linux's")
def test_whose_priority_may_not_be_raised_they_are_busy_all_the_same() -> None:
    done = subprocess.run(
        [sys.executable, "-c", NICED],
        check=False,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        timeout=LIMIT_S,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 5


def test_load_that_ended_early_is_no_load() -> None:
    def end_one() -> None:
        with busy_processes(2) as pids:
            ended = psutil.Process(pids[1])
            ended.kill()
            while ended.status() != psutil.STATUS_ZOMBIE:  # a hang is pytest's own limit
                pass

    with pytest.raises(AppError) as caught:
        end_one()
    assert caught.value.code is DemoFault.LOAD_ENDED
