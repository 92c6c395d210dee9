"""Does a drive's velocity agree with its positions?

A velocity that disagrees means a motor entry whose ranges are not the firmware's. Stretches of motion vote, each with
the ratio of the velocity's integral to the travelled angle. After a silence the first replies may be old ones with a
fresh time (an emulated drive, a host that stood still). Such stretches don't vote; a wrong vote is outvoted.
"""

from __future__ import annotations

from collections import deque
from statistics import median

from hal.joints.protocol import DriveFault

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
