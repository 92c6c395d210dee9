"""Memory really runs out while the legs walk: in a control group of its own, alone in it.

The kernel ends processes by the order in `app/system/scheduling.py`; control and guardian stay, and the legs are held.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from app.ipc.states import Effect, GaitState
from testing.session import TIMEOUT_S, RealSession, real_session

pytestmark = pytest.mark.serial

ROOTS = (Path("/sys/fs/cgroup/memory"), Path("/sys/fs/cgroup"))  # versions 1 and 2 of the kernel's control groups
LIMITS = ("memory.limit_in_bytes", "memory.max")
COUNTS = ("memory.oom_control", "memory.events")  # with a line "oom_kill N"
# A small computer's. The kernel weighs what a process has, and its place in the order as a share of all there is: with
# less than this, control's locked 200 MB would weigh more than the planner that asks to go before it.
HOST_BYTES = 2**30
# Takes memory that belongs to no process, as a full temporary file system does, until the kernel has killed one: a
# killed process takes its time to end, and what is taken meanwhile would cost others their lives.
HOG = """
import os, pathlib
pathlib.Path({members!r}).write_text('0')
counts = pathlib.Path({counts!r})
held = os.memfd_create('held')
while 'oom_kill 0' in counts.read_text():
    os.write(held, bytes(2**20))
"""


@pytest.fixture
def group() -> Iterator[Path]:
    """A control group of little memory, whose members alone are ended when it is used up."""
    made = next((made for made in map(_made_under, ROOTS) if made is not None), None)
    if made is None:
        pytest.skip("no memory control group can be made here")
    yield made
    deadline = time.monotonic() + TIMEOUT_S
    while made.exists() and time.monotonic() < deadline:
        with suppress(OSError):  # while a member is still ending
            made.rmdir()
        time.sleep(0.05)


def _made_under(root: Path) -> Path | None:
    """The group under one root; None where this kernel or user has none there."""
    made = root / f"rleex-{os.getpid()}"
    try:
        made.mkdir()
        limit = next(made / name for name in LIMITS if (made / name).exists())
        limit.write_text(str(HOST_BYTES), encoding="ascii")
    except (OSError, StopIteration):
        with suppress(OSError):
            made.rmdir()
        return None
    return made


@pytest.fixture
def session(tmp_path: Path, group: Path) -> Iterator[RealSession]:
    with real_session(tmp_path, group=group) as one:
        yield one


@pytest.mark.skipif(psutil.swap_memory().total > 0, reason="pages would go to the swap instead")
def test_the_planner_goes_control_and_guardian_stay_and_the_legs_are_held(group: Path, session: RealSession) -> None:
    session.walk(steps=1)
    counts = next(group / name for name in COUNTS if (group / name).exists())
    hog = HOG.format(members=str(group / "cgroup.procs"), counts=str(counts))
    subprocess.run([sys.executable, "-c", hog], check=True, timeout=TIMEOUT_S)
    session.until_ended("planner")
    rest = session.until(lambda s: s.action is None and not s.allowed, "rest")
    assert rest.enabled, "held, not dropped"
    assert rest.effect >= Effect.HOLD or rest.state is GaitState.STANDING
    assert all(psutil.Process(session.pids[name]).is_running() for name in ("control", "guardian", "audit"))
