"""Loss, jitter and round trips from counters; a trail that is told of no more."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.ipc.messages import AuditHealth
from app.ipc.states import Event
from app.ipc.streams import AUDIT_HEALTH
from app.link.beats import BEAT_NS, LinkQuality, trail_health
from logs.reason import key_of

MS = 1_000_000


def received(numbers: list[int]) -> tuple[LinkQuality, int]:
    """So numbered packets, each at its time; and the newest's time."""
    quality = LinkQuality()
    for number in numbers:
        quality.add(number, number * BEAT_NS)
    return quality, numbers[-1] * BEAT_NS


def test_nothing_came_is_everything_lost() -> None:
    assert LinkQuality().loss(0) == 1.0


def test_every_packet_came() -> None:
    quality, now_ns = received(list(range(1, 400)))
    assert quality.loss(now_ns) == 0.0
    assert quality.loss(now_ns + BEAT_NS) == 0.0, "the next one is not overdue yet"


def test_every_fifth_is_missing() -> None:
    quality, now_ns = received([number for number in range(1, 1000) if number % 5])
    assert quality.loss(now_ns) == pytest.approx(0.2, abs=0.01)


def test_a_cut_counts_as_loss_before_the_next_packet_comes() -> None:
    quality, now_ns = received(list(range(1, 400)))
    assert quality.loss(now_ns + 1_000 * MS) == pytest.approx(0.2, abs=0.01)
    assert quality.loss(now_ns + 60_000 * MS) == 1.0


@given(numbers=st.sets(st.integers(1, 600), min_size=1), later_ns=st.integers(0, 20_000 * MS))
def test_loss_is_a_share(numbers: set[int], later_ns: int) -> None:
    quality, now_ns = received(sorted(numbers))
    assert 0.0 <= quality.loss(now_ns + later_ns) <= 1.0


def test_the_median_forgives_one_slow_round_trip() -> None:
    quality = LinkQuality()
    for delay_ms in (8, 9, 10, 900, 11):
        quality.add_delay(delay_ms * MS)
    assert quality.round_trip_ns == 10 * MS


def test_jitter_is_the_mean_change() -> None:
    quality = LinkQuality()
    for number in range(400):
        quality.add_delay((10 + 6 * (number % 2)) * MS)
    assert quality.jitter_ns == pytest.approx(6 * MS, rel=0.01)


def test_a_trail_of_which_nothing_is_told_any_more_has_a_fault() -> None:
    health = AuditHealth(at_ns=5, written=7, waiting=1)
    limit_ns = int(AUDIT_HEALTH.stale_ms * MS)
    assert trail_health(None, 5, 5 + limit_ns) is None
    assert trail_health(health, 5, 5 + limit_ns) == health
    for known, written in ((health, 7), (None, 0)):
        late = trail_health(known, 5, 6 + limit_ns)
        assert late is not None
        assert late.fault is not None
        assert (late.fault.code, late.written) == (key_of(Event.AUDIT_TIMEOUT), written)
