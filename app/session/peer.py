"""Another process of the session, child or not: whether it lives, asked without a race for its number."""

from __future__ import annotations

import os
import select
import signal
from contextlib import suppress


class Peer:
    """A process, by a descriptor that stays its own when the kernel gives its number to another."""

    def __init__(self, pid: int) -> None:
        """One that has ended already is simply not alive."""
        self.pid = pid
        self._handle: int | None = None
        with suppress(OSError, ValueError):
            self._handle = os.pidfd_open(pid)

    @property
    def alive(self) -> bool:
        """Whether it has not ended yet; a zombie has."""
        return not self.wait(0.0)

    def wait(self, limit_s: float) -> bool:
        """Wait for its end; False when it did not come within the limit."""
        if self._handle is None:
            return True
        poller = select.poll()
        poller.register(self._handle, select.POLLIN)
        return bool(poller.poll(limit_s * 1000))

    def signal(self, number: signal.Signals) -> None:
        """Send a signal; harmless when it has ended."""
        with suppress(OSError):
            if self._handle is not None:
                signal.pidfd_send_signal(self._handle, number)

    def end(self, limit_s: float) -> None:
        """Ask it to end, and kill it when it has not within the limit; take its exit status if it is a child."""
        self.signal(signal.SIGTERM)
        if not self.wait(limit_s):
            self.signal(signal.SIGKILL)
            self.wait(1.0)
        with suppress(ChildProcessError):
            os.waitpid(self.pid, os.WNOHANG)

    def close(self) -> None:
        """Release the descriptor; harmless when done twice."""
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)
