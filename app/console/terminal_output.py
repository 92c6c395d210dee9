"""Output to a terminal that never blocks the event loop, whether or not the terminal reads.

Textual's own driver puts every frame into a queue of thirty and waits when that is full: a terminal that does not read
(its output is stopped, the SSH client suspended) would stop the event loop. Here frames that the terminal does not
take are dropped, and the screen is painted anew when it reads again.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from app.console.charset import Substitutes

FRAME_TIMEOUT_S = 0.5  # a frame that has waited so long shows the past
CLOSE_TIMEOUT_S = 0.3  # for the sequences that restore the terminal
POLL_MS = 50


@dataclass(frozen=True, slots=True)
class _Chunk:
    data: bytes
    queued_s: float
    droppable: bool


class TerminalOutput:
    """Writes to a terminal from a thread of its own. `write` never blocks."""

    def __init__(
        self,
        fileno: int,
        *,
        lost: Callable[[], object],
        repaint: Callable[[], object],
        substitutes: Substitutes | None = None,
    ) -> None:
        self._fileno, self._own = _reopen(fileno)
        self._substitutes = substitutes
        self._lost = lost
        self._repaint = repaint
        self._changed = threading.Condition()
        self._queue: deque[_Chunk] = deque()
        self._dirty = False  # a frame was dropped: differences to it would be wrong
        self._dead = False
        self._end_s: float | None = None
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="terminal-output", daemon=True)
        self._thread.start()

    def write(self, data: str, *, droppable: bool = True) -> None:
        """Queue it; a frame is dropped when frames before it have waited too long."""
        if self._substitutes is not None:
            data = data.translate(self._substitutes)
        now_s = time.monotonic()
        with self._changed:
            if self._dead:
                return
            if self._queue and now_s - self._queue[0].queued_s > FRAME_TIMEOUT_S:
                kept = [chunk for chunk in self._queue if not chunk.droppable]
                self.dropped += len(self._queue) - len(kept)
                self._dirty = self._dirty or len(kept) < len(self._queue)
                self._queue = deque(kept)
            if self._dirty and droppable:
                self.dropped += 1
                self._changed.notify()  # the thread may have been kept from running while frames were dropped
                return
            self._queue.append(_Chunk(data.encode("utf-8", "replace"), now_s, droppable))
            self._changed.notify()

    def close(self) -> None:
        """Write what is queued, for CLOSE_TIMEOUT_S at most."""
        with self._changed:
            self._end_s = time.monotonic() + CLOSE_TIMEOUT_S
            self._changed.notify()
        self._thread.join(CLOSE_TIMEOUT_S + 2 * POLL_MS / 1000)
        if self._own and not self._thread.is_alive():
            os.close(self._fileno)
            self._own = False

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._dirty or self._end_s is not None)
                if not self._queue:
                    if self._end_s is not None:
                        return
                    self._dirty = False
                    self._repaint()
                    continue
                chunk = self._queue.popleft()
            try:
                whole = self._put(chunk.data)
            except OSError:
                whole = False
            if not whole:
                break
        with self._changed:
            self._dead = True
            self._queue.clear()
            ended = self._end_s is not None
        if not ended:
            self._lost()

    def _put(self, data: bytes) -> bool:
        """Write all of it, however long that takes; False when the end came first. Raises OSError."""
        poller = select.poll()
        poller.register(self._fileno, select.POLLOUT)
        rest = memoryview(data)
        while rest:
            try:
                rest = rest[os.write(self._fileno, rest) :]
            except BlockingIOError:
                if self._end_s is not None and time.monotonic() > self._end_s:
                    return False
                poller.poll(POLL_MS)
        return True


def _reopen(fileno: int) -> tuple[int, bool]:
    """The same terminal, opened anew so that not blocking is ours alone; itself where that is not possible."""
    try:
        return os.open(os.ttyname(fileno), os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK), True
    except OSError:
        return fileno, False
