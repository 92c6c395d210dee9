"""Loads the hand detector beside the running camera: the first picture shall not wait for two seconds of imports.

Not even beside them: two threads of one interpreter take turns, which would delay the first picture by half a second.
So it begins when it is told to, with the first frame.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Loading(Generic[T]):
    """Something built in a thread from `begin` on. Its error, if any, is raised to whoever asks."""

    def __init__(self, build: Callable[[], T]) -> None:
        self._build = build
        self._value: T | None = None
        self._error: Exception | None = None
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Start building; harmless when done again."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="detector-loader", daemon=True)
            self._thread.start()

    def ready(self) -> T | None:
        """The built thing, or None while it is being built. Raises what building raised."""
        if self._error is not None:
            raise self._error
        return self._value

    def _run(self) -> None:
        try:
            self._value = self._build()
        except Exception as error:  # noqa: BLE001 - handed to the thread that asks
            self._error = error
