"""Busy processes beside a session, as other programs on the machine are: ordinary priority, ended with their parent."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

# Ends by itself once its parent is gone, however that ended. The parent's own niceness is not inherited.
_BUSY = """
import os, sys
os.setpriority(os.PRIO_PROCESS, 0, 0)
while os.getppid() == int(sys.argv[1]):
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def busy_processes(count: int) -> Iterator[tuple[int, ...]]:
    """Keep that many processes busy while the body runs; their PIDs."""
    started = [subprocess.Popen([sys.executable, "-c", _BUSY, str(os.getpid())]) for _ in range(count)]
    try:
        yield tuple(process.pid for process in started)
    finally:
        for process in started:
            process.kill()
            process.wait()
