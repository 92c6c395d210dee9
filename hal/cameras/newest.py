"""The newest frame of a device that is read in a thread, so that a driver which freezes freezes nothing else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from hal.cameras.camera import EndOfRecording
from hal.errors import HardwareError

T = TypeVar("T")

SILENCE_S = 2.0  # without a frame for so long a device counts as lost
JOIN_S = 1.0


class Newest(Generic[T]):
    """Calls `grab` again and again in a thread; `take` gives what came last, once."""

    def __init__(self, grab: Callable[[], T | None], *, lost: str, silence_s: float = SILENCE_S) -> None:
        """grab: blocks for the next frame, None when none came, HardwareError when the device is gone.

        lost: the sentence to raise when nothing came for silence_s.
        """
        self._grab = grab
        self._lost = lost
        self._silence_s = silence_s
        self._changed = threading.Condition()
        self._value: T | None = None
        self._error: HardwareError | EndOfRecording | None = None
        self._stopped = False
        self._heard_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="camera-reader", daemon=True)
        self._thread.start()

    def take(self, timeout_s: float) -> T | None:
        """The newest value not yet taken, or None in time. Raises HardwareError when the device is lost."""
        with self._changed:
            self._changed.wait_for(lambda: self._value is not None or self._error is not None, timeout_s)
            if self._value is not None:
                value, self._value = self._value, None
                return value
            if self._error is not None:
                raise self._error
            if time.monotonic() - self._heard_s > self._silence_s:
                raise HardwareError(self._lost)
            return None

    def stop(self) -> bool:
        """End the thread; False when the driver hangs and had to be left behind."""
        self._stopped = True
        self._thread.join(JOIN_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stopped:
            try:
                value = self._grab()
            except (HardwareError, EndOfRecording) as error:
                with self._changed:
                    self._error = error
                    self._changed.notify_all()
                return
            if value is None:
                continue
            with self._changed:
                self._value = value
                self._heard_s = time.monotonic()
                self._changed.notify_all()
