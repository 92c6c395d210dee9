"""The pool of processes that detect hands, over real ones."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any

import psutil
import pytest

from app.evaluate.detector_pool import detector_pool
from app.evaluate.harness import EvaluateFault, process_pool
from app.system.errors import AppError
from kgdfa.errors import KgdfaError, KgdfaFault

LIMIT_S = 60.0
PARENT = """
import os, pathlib, sys, time
from app.evaluate.detector_pool import detector_pool
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


def test_a_file_that_is_no_model_is_refused_before_any_process_begins(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "no.task"
    path.write_text("no model")
    with pytest.raises(KgdfaError) as refused, detector_pool(path, 1):
        pytest.fail("a pool without a model")
    assert refused.value.code is KgdfaFault.HAND_MODEL_INVALID
    assert not capfd.readouterr().err


@pytest.mark.parametrize("begin", [(os.getpid,), (os._exit, (1,))], ids=["at work", "at once"])
def test_a_process_that_ends_is_named_in_one_sentence(begin: Any) -> None:
    with pytest.raises(AppError) as refused, process_pool(1, *begin) as pool:
        pool.submit(os._exit, 1).result()
    assert refused.value.code is EvaluateFault.WORKER_ENDED
