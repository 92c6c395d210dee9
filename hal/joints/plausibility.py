"""Does a drive's velocity agree with its own positions? Catches a motor entry whose ranges are not the firmware's."""

from __future__ import annotations

from hal.joints.joints import DriveFault

# Wrong tables differ by about two (AK80-9: 50, 25.64, 22.5 rad/s), so a factor of 1.6 separates them from noise.
_RATIO_LOW, _RATIO_HIGH = 1 / 1.6, 1.6
_SPAN_NS = 40_000_000  # one comparison covers this much time: many quanta of position
_GAP_NS = 12_000_000  # over a longer silence the velocity may have swung: the integral says nothing
_LEAST_TRAVEL_RAD = 0.02  # of one comparison, at the motor
_ENOUGH_RAD = 0.3  # compared in all before a verdict


class RangeWatch:
    """Compares the travelled angle with the integral of the reported velocity, while the drive moves."""

    def __init__(self) -> None:
        self._begin: tuple[float, int] | None = None
        self._last = (0.0, 0)
        self._integral_rad = 0.0
        self._product = self._square = self._travel = 0.0
        self._verdict = DriveFault.NONE

    def judge(self, position_rad: float, velocity_rad_s: float, measured_ns: int) -> DriveFault:
        """Take in one reply; WRONG_RANGE, for good, once the evidence is enough."""
        last_velocity, last_ns = self._last
        elapsed_ns = measured_ns - last_ns
        if elapsed_ns <= 0:
            return self._verdict
        self._last = (velocity_rad_s, measured_ns)
        if self._begin is None or elapsed_ns > _GAP_NS:
            self._restart(position_rad, measured_ns)
            return self._verdict
        self._integral_rad += 0.5 * (velocity_rad_s + last_velocity) * elapsed_ns * 1e-9
        if measured_ns - self._begin[1] >= _SPAN_NS:
            self._compare(position_rad - self._begin[0])
            self._restart(position_rad, measured_ns)
        return self._verdict

    def _restart(self, position_rad: float, measured_ns: int) -> None:
        self._begin = (position_rad, measured_ns)
        self._integral_rad = 0.0

    def _compare(self, travel_rad: float) -> None:
        if abs(travel_rad) < _LEAST_TRAVEL_RAD:
            return
        self._product += travel_rad * self._integral_rad
        self._square += travel_rad * travel_rad
        self._travel += abs(travel_rad)
        if self._travel >= _ENOUGH_RAD:
            ratio = self._product / self._square
            if not _RATIO_LOW <= ratio <= _RATIO_HIGH:
                self._verdict = DriveFault.WRONG_RANGE
            self._product = self._square = self._travel = 0.0
