"""The pool of processes that detect hands, over real ones."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

import psutil

LIMIT_S = 60.0
PARENT = """
import os, pathlib, sys, time
from app.evaluate.digital import detector_pool
if __name__ == "__main__":
    with detector_pool(pathlib.Path(sys.argv[1]), 1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        time.sleep(600)
"""


def test_its_processes_end_when_their_parent_is_killed(hand_model: Path, tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    with Popen([sys.executable, str(script), str(hand_model)], stdout=PIPE, stderr=DEVNULL, text=True) as parent:
        assert parent.stdout is not None
        worker = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    deadline = time.monotonic() + LIMIT_S
    while worker.is_running() and worker.status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < deadline, "the worker outlives its parent"
        time.sleep(0.05)
