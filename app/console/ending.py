"""The end of the console by a signal or with its terminal: within two seconds, whatever its threads wait for.

The session stays, held, for the console that takes it over (`app/session/supervise.py`).
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from app.system.scheduling import set_scheduling

ORDERLY_S = 0.5  # with 0.4 s for the terminal's restoring, and a busy machine's delays, below two seconds
ENDING_SIGNALS = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)  # Ctrl-C is a key: the terminal sends no signal for it


class Ending:
    """Ends the process in three steps: the heartbeat, the program's own end, and by force where that takes too long."""

    def __init__(
        self, lose_console: Callable[[], object], ask: Callable[[], object], restore: Callable[[], object]
    ) -> None:
        """lose_console: end the heartbeat; ask: end in order; restore: the terminal. None of them may block."""
        self._lose_console = lose_console
        self._ask = ask
        self._restore = restore
        self._begun = False

    def on_signals(self) -> None:
        """Begin on these signals. From the main thread; works while the event loop is stuck."""
        for number in ENDING_SIGNALS:
            signal.signal(number, lambda number, _: self.begin(128 + number))

    def begin(self, status: int = 128 + signal.SIGHUP) -> None:
        """Begin to end; status: the process's, where it does not end by itself. From any thread, or a handler."""
        if not self._begun:
            self._begun = True
            threading.Thread(target=self._run, args=(status,), name="ending", daemon=True).start()

    def _run(self, status: int) -> None:
        limit_s = time.monotonic() + ORDERLY_S
        set_scheduling("heartbeat")  # whatever else keeps the cores
        with suppress(Exception):  # whatever fails, the process ends
            self._lose_console()
        with suppress(RuntimeError):  # the event loop is closed
            self._ask()
        time.sleep(max(0.0, limit_s - time.monotonic()))
        with suppress(Exception):
            self._restore()
        os._exit(status)
