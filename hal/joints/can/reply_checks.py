"""Checks on a drive's replies: is each command answered, and does the velocity agree with the positions.

Replies carry no number, so each belongs to the oldest command that waits. A lost one would then shift all that follow
by a tick for ever: where in a whole window more commands stay waiting than this drive ever left, the surplus is missed.

A velocity that disagrees means a motor entry whose ranges are not the firmware's. Stretches of motion vote, each with
the ratio of the velocity's integral to the travelled angle. After a silence the first replies may be old ones with a
fresh time (an emulated drive, a host that stood still). Such stretches don't vote; a wrong vote is outvoted.
"""

from __future__ import annotations

from collections import deque
from statistics import median

from hal.joints.protocol import DriveFault

MISSED_AFTER_NS = 20_000_000
_OWED_LIMIT = 500  # a second of commands: an adapter, or a busy host, may hold replies up for tenths of one
_WINDOW_COMMANDS = 8  # with fewer in a window, what usually waits is unknown


class RequestTracker:
    """Sent, answered, late and missed add up: `sent == answered + late + missed + under_way`."""

    def __init__(self) -> None:
        self.sent = self.answered = self.late = self.overdue = 0
        self.round_trips_ns: deque[int] = deque(maxlen=65_536)
        self._pending: deque[int] = deque()  # when they were sent
        self._owed = 0  # replies that may still come: more than that come from another drive
        self._usual: int | None = None  # how many wait at the best moment of a window
        self._least = 0
        self._window_ns = self._window_sent = 0
        self._steady = False  # the window before was full of commands too: what waits now is usual

    @property
    def missed(self) -> int:
        """Commands that were never answered."""
        return self.overdue - self.late

    @property
    def in_flight(self) -> int:
        """Commands whose time is not over yet."""
        return len(self._pending)

    def send(self, now_ns: int) -> None:
        """A command leaves."""
        self.sent += 1
        self._window_sent += 1
        self._pending.append(now_ns)
        self._owed = min(self._owed + 1, _OWED_LIMIT)

    def receive(self, measured_ns: int) -> bool:
        """A reply has come; False when it is one more than was requested."""
        if self._pending:
            self.round_trips_ns.append(measured_ns - self._pending.popleft())
            self._least = min(self._least, len(self._pending))
            self.answered += 1
        elif self._owed and self.missed:
            self.late += 1
        asked_for = self._owed > 0
        self._owed = max(self._owed - 1, 0)
        return asked_for

    def poll(self, now_ns: int) -> None:
        """Give up what has waited for too long, and what a lost reply has left behind."""
        while self._pending and now_ns - self._pending[0] > MISSED_AFTER_NS:
            self._give_up()
        if now_ns - self._window_ns >= MISSED_AFTER_NS:
            self._close_window(now_ns)

    def _close_window(self, now_ns: int) -> None:
        full = self._window_sent >= _WINDOW_COMMANDS
        if full and self._steady:
            self._usual = self._least if self._usual is None else min(self._usual, self._least)
            for _ in range(min(self._least - self._usual, len(self._pending))):
                self._give_up()
        self._least = len(self._pending)
        self._window_ns, self._window_sent, self._steady = now_ns, 0, full

    def _give_up(self) -> None:
        self._pending.popleft()
        self._least = min(self._least, len(self._pending))
        self.overdue += 1


# Wrong tables differ by about two (AK80-9: 50, 25.64, 22.5 rad/s), replies late by milliseconds by less.
_RATIO_HIGH = 1.3
_STRETCH_NS = 40_000_000  # one comparison covers this much time: many quanta of position
_GAP_NS = 12_000_000  # over a longer silence the velocity may have swung: the integral is unknown
_SETTLE_NS = 20_000_000  # for so long after it, replies that were held up may still come
_LEAST_TRAVEL_RAD = 0.02  # of a stretch that votes, at the motor
_VOTES = 9  # more than half of the newest must be wrong: at least 0.4 s of motion


class RangeCheck:
    """Compares the travelled angle with the integral of the reported velocity, while the drive moves."""

    def __init__(self) -> None:
        self._begin: tuple[float, int] | None = None
        self._last = (0.0, 0)
        self._settled_ns = 0
        self._integral_rad = 0.0
        self._ratios: deque[float] = deque(maxlen=_VOTES)
        self._verdict = DriveFault.NONE

    def check(self, position_rad: float, velocity_rad_s: float, measured_ns: int) -> DriveFault:
        """Take in one reply; WRONG_RANGE, from then on, once the evidence is enough."""
        last_velocity, last_ns = self._last
        elapsed_ns = measured_ns - last_ns
        if elapsed_ns <= 0:
            return self._verdict
        self._last = (velocity_rad_s, measured_ns)
        if elapsed_ns > _GAP_NS:
            self._begin, self._settled_ns = None, measured_ns + _SETTLE_NS
        elif self._begin is None:
            if measured_ns >= self._settled_ns:
                self._restart(position_rad, measured_ns)
        else:
            self._integral_rad += 0.5 * (velocity_rad_s + last_velocity) * elapsed_ns * 1e-9
            if measured_ns - self._begin[1] >= _STRETCH_NS:
                self._vote(position_rad - self._begin[0])
                self._restart(position_rad, measured_ns)
        return self._verdict

    def _restart(self, position_rad: float, measured_ns: int) -> None:
        self._begin = (position_rad, measured_ns)
        self._integral_rad = 0.0

    def _vote(self, travel_rad: float) -> None:
        if abs(travel_rad) < _LEAST_TRAVEL_RAD:
            return
        self._ratios.append(self._integral_rad / travel_rad)
        if len(self._ratios) == _VOTES and not 1 / _RATIO_HIGH <= median(self._ratios) <= _RATIO_HIGH:
            self._verdict = DriveFault.WRONG_RANGE
