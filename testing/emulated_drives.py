"""A drive emulator beside the test or tool that uses it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from hal.joints.emulator.emulator import DriveEmulator


@contextmanager
def emulating(emulator: DriveEmulator) -> Iterator[DriveEmulator]:
    """Run the emulator in a thread of its own while the body runs."""
    stop = threading.Event()
    thread = threading.Thread(target=emulator.run, args=(stop.is_set,), daemon=True)
    emulator.open()
    thread.start()
    try:
        yield emulator
    finally:
        stop.set()
        thread.join(5.0)
        emulator.close()
