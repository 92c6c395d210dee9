"""Two clocks on simulated time: apart, drifting, stepped; what is printed holds the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hypothesis import assume, given
from hypothesis import strategies as st

from app.link.clock import ClockEstimate, RoundTrip, update

HOUR_NS = 3_600_000_000_000
MS = 1_000_000
delays = st.integers(0, 200 * MS)


@dataclass
class Other:
    """The other host's clock: so far ahead, and by so much quicker."""

    ahead_ns: int = 0
    drift_ppm: int = 0

    def at(self, now_ns: int) -> int:
        return now_ns + self.ahead_ns + now_ns * self.drift_ppm // 1_000_000

    def offset_ns(self, now_ns: int) -> int:
        return self.at(now_ns) - now_ns


def trip(other: Other, sent_ns: int, out_ns: int, waits_ns: int, back_ns: int) -> RoundTrip:
    """A packet that is so long under way in each direction; moments are those of a third, perfect clock."""
    arrives_ns = sent_ns + out_ns
    leaves_ns = arrives_ns + waits_ns
    return RoundTrip(sent_ns, other.at(arrives_ns), other.at(leaves_ns), leaves_ns + back_ns)


@given(
    ahead_ns=st.integers(-HOUR_NS, HOUR_NS),
    drift_ppm=st.integers(-1000, 1000),
    trips=st.lists(st.tuples(delays, delays, delays, st.integers(20 * MS, 5_000 * MS)), min_size=1, max_size=40),
)
def test_the_truth_lies_within_the_printed_uncertainty(
    ahead_ns: int, drift_ppm: int, trips: list[tuple[int, int, int, int]]
) -> None:
    other, now_ns, estimate = Other(ahead_ns, drift_ppm), HOUR_NS, None
    for out_ns, waits_ns, back_ns, pause_ns in trips:
        made = trip(other, now_ns, out_ns, waits_ns, back_ns)
        new = update(estimate, made)
        assert not made.stood_still
        assert new.step_ns == 0, "a clock that only drifts was taken for a stepped one"
        estimate = new.estimate
        now_ns = made.returned_ns + pause_ns
        known = estimate.at(now_ns)
        assert abs(known.offset_ns - other.offset_ns(now_ns)) <= known.uncertainty_ns
        assert known.low_ns <= other.offset_ns(now_ns) <= known.high_ns


@given(out_ns=delays, back_ns=delays, ahead_ns=st.integers(-HOUR_NS, HOUR_NS), age_ns=st.integers(0, 1_000 * MS))
def test_a_moment_never_looks_younger_than_it_is(out_ns: int, back_ns: int, ahead_ns: int, age_ns: int) -> None:
    other = Other(ahead_ns)
    made = trip(other, HOUR_NS, out_ns, 0, back_ns)
    estimate = update(None, made).estimate
    moment_ns = made.returned_ns - age_ns
    assume(other.at(moment_ns))  # 0: a moment that has not come
    local_ns = estimate.local_ns(other.at(moment_ns))
    assert local_ns <= moment_ns
    assert moment_ns - local_ns <= 2 * estimate.uncertainty_ns


def test_one_quick_round_trip_makes_it_precise() -> None:
    other, now_ns, estimate = Other(HOUR_NS), 0, None
    for number in range(100):
        out_ns, back_ns = (1 * MS, 1 * MS) if number == 50 else (90 * MS, 5 * MS)
        estimate = update(estimate, trip(other, now_ns, out_ns, 3 * MS, back_ns)).estimate
        now_ns += 20 * MS
    assert estimate is not None
    assert estimate.uncertainty_ns < 3 * MS
    assert abs(estimate.offset_ns - HOUR_NS) <= estimate.uncertainty_ns


def test_a_step_beyond_the_uncertainty_is_told_once_and_followed() -> None:
    other, now_ns, estimate, steps = Other(5 * MS), 0, None, []
    for number in range(100):
        if number == 50:
            other.ahead_ns += 1_000 * MS
        new = update(estimate, trip(other, now_ns, 4 * MS, 0, 6 * MS))
        estimate, now_ns = new.estimate, now_ns + 20 * MS
        if new.step_ns:
            steps.append(new.step_ns)
    assert estimate is not None
    assert [round(step / 1e9, 1) for step in steps] == [1.0]
    assert abs(estimate.offset_ns - other.ahead_ns) <= estimate.uncertainty_ns


@given(out_ns=delays, waits_ns=delays, back_ns=delays, stood_ns=st.integers(0, 600 * MS))
def test_a_sleep_within_a_round_trip_is_told_or_short(out_ns: int, waits_ns: int, back_ns: int, stood_ns: int) -> None:
    """Bounds from what is not told are never inside out."""
    whole = trip(Other(HOUR_NS), HOUR_NS, out_ns, waits_ns + stood_ns, back_ns)
    slept = replace(whole, returned_ns=whole.returned_ns - stood_ns)
    assert not whole.stood_still
    assert slept.stood_still or update(None, slept).estimate.uncertainty_ns >= 0
    assert slept.stood_still is (stood_ns > out_ns + back_ns + 10 * MS)


def test_what_has_not_come_stays_so() -> None:
    assert ClockEstimate(0, 5, 9).local_ns(0) == 0


def test_knowledge_widens_with_time() -> None:
    old = ClockEstimate(0, -MS, MS)
    assert old.at(10_000 * MS).uncertainty_ns == MS + 10_000 * MS * 1_000 // 1_000_000
