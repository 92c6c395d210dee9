"""How good the link is, from counters and round trips; pure. Figures for people, and the limits for arming."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from app.ipc.streams import NS_PER_MS

BEAT_NS = 20 * NS_PER_MS  # a packet of the link's own socket in each direction; STOP travels on every one
WINDOW_BEATS = 250  # five seconds: loss is told to 0.4 %
_ROUND_TRIPS = 100  # two seconds


@dataclass(slots=True)
class LinkQuality:
    """What arrives of packets that are numbered one by one and sent every BEAT_NS."""

    jitter_ns: float = 0.0  # RFC 3550, §6.4.1: the mean change of the delay from packet to packet
    received: int = 0
    _delays_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_ROUND_TRIPS))
    _arrived: deque[int] = field(default_factory=lambda: deque(maxlen=WINDOW_BEATS))
    _newest_ns: int = 0

    def add(self, number: int, now_ns: int) -> None:
        """One packet came; older ones than the newest do not."""
        self._arrived.append(number)
        self._newest_ns = now_ns
        self.received += 1

    def add_delay(self, delay_ns: int) -> None:
        """One round trip, without the wait at the other end."""
        if self._delays_ns:
            self.jitter_ns += (abs(delay_ns - self._delays_ns[-1]) - self.jitter_ns) / 16
        self._delays_ns.append(delay_ns)

    @property
    def round_trip_ns(self) -> int:
        """The median of the last two seconds; 0 before the first."""
        return sorted(self._delays_ns)[len(self._delays_ns) // 2] if self._delays_ns else 0

    def loss(self, now_ns: int) -> float:
        """The share of the last five seconds' packets that did not come, those that are overdue among them; 0 to 1."""
        if not self._arrived:
            return 1.0
        newest = self._arrived[-1]
        overdue = max(0, (now_ns - self._newest_ns) // BEAT_NS - 1)
        first = max(self._arrived[0], newest + overdue - WINDOW_BEATS + 1)
        sent = newest + overdue - first + 1
        came = sum(number >= first for number in self._arrived)
        return max(0.0, 1.0 - came / max(1, sent))

    def silent_ns(self, now_ns: int) -> int:
        """Since the newest packet."""
        return now_ns - self._newest_ns
