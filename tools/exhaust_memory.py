"""Memory that really runs out while the legs walk: who is killed, and what the legs do.

    python tools/exhaust_memory.py

The session lives in a control group of its own, alone in it, and the kernel ends its processes by the order in
`app/system/scheduling.py`. Needs the right to make a memory control group, and no swap. Exit status 1 where the legs
were dropped or moved on.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import typer

from app.ipc.states import Effect, GaitState
from testing.session import RealSession
from testing.watched_session import TIMEOUT_S

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


def main() -> None:
    """Print which processes live afterwards, and what the legs do."""
    if psutil.swap_memory().total:
        sys.exit("pages would go to the swap: switch it off first (swapoff -a).")
    with tempfile.TemporaryDirectory(prefix="memory-") as folder, memory_group() as group:
        with RealSession(Path(folder), group=group) as session:
            held = exhaust(session, group)
            for name, pid in session.pids.items():
                print(f"{name:<11}{'lives' if psutil.pid_exists(pid) and running(pid) else 'was killed'}")
        sys.exit(0 if held else 1)


def exhaust(session: RealSession, group: Path) -> bool:
    """Walk, use the memory up; whether the legs were kept."""
    session.walk(steps=1)
    counts = next(group / name for name in COUNTS if (group / name).exists())
    hog = HOG.format(members=str(group / "cgroup.procs"), counts=str(counts))
    subprocess.run([sys.executable, "-c", hog], check=True, timeout=TIMEOUT_S)
    # Where another than the planner was killed, the walk ends with its step.
    rest = session.until(lambda now: now.action is None and not now.allowed, "rest")
    print(f"legs: {rest.effect.name}, {rest.state.value}, {'powered' if rest.enabled else 'without power'}")
    return rest.enabled and (rest.effect >= Effect.HOLD or rest.state is GaitState.STANDING)


def running(pid: int) -> bool:
    """Whether a process has not ended."""
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


@contextmanager
def memory_group() -> Iterator[Path]:
    """A control group of little memory, whose members alone are ended when it is used up."""
    made = next((made for made in map(made_under, ROOTS) if made is not None), None)
    if made is None:
        sys.exit("no memory control group can be made here: run it as root on a machine that has the controller.")
    yield made
    deadline = time.monotonic() + TIMEOUT_S
    while made.exists() and time.monotonic() < deadline:
        with suppress(OSError):  # while a member is still ending
            made.rmdir()
        time.sleep(0.05)


def made_under(root: Path) -> Path | None:
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


if __name__ == "__main__":
    typer.run(main)
