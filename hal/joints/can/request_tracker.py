"""What became of a drive's commands: each is answered in time, answered late, missed, or still under way.

Replies carry no number, so each belongs to the oldest command that waits. A lost one would then shift all that follow
by a tick for ever: where in a whole window more commands stay waiting than this drive ever left, the surplus is missed.
"""

from __future__ import annotations

from collections import deque

MISSED_AFTER_NS = 20_000_000
_OWED_LIMIT = 50  # a tenth of a second of commands
_WINDOW_COMMANDS = 8  # fewer in a window say nothing about what usually waits


class RequestTracker:
    """Sent, answered, late and missed add up: `sent == answered + late + missed + under_way`."""

    def __init__(self) -> None:
        self.sent = self.answered = self.late = self.overdue = 0
        self.round_trips_ns: deque[int] = deque(maxlen=65_536)
        self._waiting: deque[int] = deque()  # when they were sent
        self._owed = 0  # replies that may still come: more than that are somebody else's
        self._usual: int | None = None  # how many wait at the best moment of a window
        self._least = 0
        self._window_ns = self._window_sent = 0
        self._steady = False  # the window before was full of commands too: what waits now is usual

    @property
    def missed(self) -> int:
        """Commands that were never answered."""
        return self.overdue - self.late

    @property
    def under_way(self) -> int:
        """Commands whose time is not over yet."""
        return len(self._waiting)

    def send(self, now_ns: int) -> None:
        """A command leaves."""
        self.sent += 1
        self._window_sent += 1
        self._waiting.append(now_ns)
        self._owed = min(self._owed + 1, _OWED_LIMIT)

    def receive(self, measured_ns: int) -> bool:
        """A reply has come; False when it is one more than was asked for."""
        if self._waiting:
            self.round_trips_ns.append(measured_ns - self._waiting.popleft())
            self._least = min(self._least, len(self._waiting))
            self.answered += 1
        elif self._owed and self.missed:
            self.late += 1
        asked_for = self._owed > 0
        self._owed = max(self._owed - 1, 0)
        return asked_for

    def look(self, now_ns: int) -> None:
        """Give up what has waited for too long, and what a lost reply has left behind."""
        while self._waiting and now_ns - self._waiting[0] > MISSED_AFTER_NS:
            self._give_up()
        if now_ns - self._window_ns >= MISSED_AFTER_NS:
            self._close_window(now_ns)

    def _close_window(self, now_ns: int) -> None:
        full = self._window_sent >= _WINDOW_COMMANDS
        if full and self._steady:
            self._usual = self._least if self._usual is None else min(self._usual, self._least)
            for _ in range(min(self._least - self._usual, len(self._waiting))):
                self._give_up()
        self._least = len(self._waiting)
        self._window_ns, self._window_sent, self._steady = now_ns, 0, full

    def _give_up(self) -> None:
        self._waiting.popleft()
        self._least = min(self._least, len(self._waiting))
        self.overdue += 1
