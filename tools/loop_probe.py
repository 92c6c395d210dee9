"""Runs a `rleex` command and writes how long its event loop keeps others waiting: `loop_probe.py FILE run …`.

A thread asks the loop for an answer a hundred times a second, as a key does; how long each took is its lag. Each line
of FILE is the monotonic time in seconds and the lag in milliseconds.
"""

from __future__ import annotations

import asyncio
import sys
import threading
import time
from pathlib import Path
from typing import TextIO

from app.cli import main

PERIOD_S = 0.01


class Probe(asyncio.DefaultEventLoopPolicy):
    """Watches every loop that it makes; lags go to the file at once, so that the console's memory is its own."""

    def __init__(self, lags: TextIO) -> None:
        super().__init__()
        self._lags = lags

    def new_event_loop(self) -> asyncio.AbstractEventLoop:
        """The usual loop, watched."""
        loop = super().new_event_loop()
        threading.Thread(target=self._watch, args=(loop,), daemon=True).start()
        return loop

    def _watch(self, loop: asyncio.AbstractEventLoop) -> None:
        while not loop.is_closed():
            time.sleep(PERIOD_S)
            if not loop.is_running():
                continue
            answered, asked_s = threading.Event(), time.monotonic()
            try:
                loop.call_soon_threadsafe(answered.set)
                if answered.wait(10.0):
                    self._lags.write(f"{asked_s:.4f} {(time.monotonic() - asked_s) * 1000:.3f}\n")
            except (RuntimeError, ValueError):  # loop or file closed meanwhile
                return


if __name__ == "__main__":  # the session's processes load this file again when they are spawned
    file, sys.argv = Path(sys.argv[1]), ["rleex", *sys.argv[2:]]
    with file.open("w", encoding="ascii") as lags:
        asyncio.set_event_loop_policy(Probe(lags))
        main()
