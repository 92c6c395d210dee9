"""Sealed packets: each once, by its session's key; anything else is nothing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.ipc.messages import AuditHealth
from app.link.beats import BEAT_NS, LOST_NS, Beats, health_of
from app.link.packets import MAX_BYTES, PacketSeal, new_packet_key
from app.link.wire import LinkNotice, Packet, StopMark
from logs.records import TrailEnd

HOUR_NS, MS = 3_600_000_000_000, 1_000_000
KEY = new_packet_key()
TRAIL = TrailEnd(session="s", key="ab", first_hash="cd", sequence=1, hash="ef")
STOP = StopMark(1, 4, 17)


def ends(connection: int = 3) -> tuple[PacketSeal, PacketSeal]:
    """Laptop's and joints'."""
    return PacketSeal(connection, KEY, at_joints=False), PacketSeal(connection, KEY, at_joints=True)


def test_a_packet_arrives_as_it_was_sent() -> None:
    laptop, joints = ends()
    packet = Packet(number=1, sent_ns=5, stops=(STOP,), heartbeat_ns=4, lease=1)
    assert joints.open(laptop.seal(packet)) == packet


def test_a_repeated_or_overtaken_one_is_dropped_and_no_sign_of_an_enemy() -> None:
    laptop, joints = ends()
    first, second = (laptop.seal(Packet(number=number, sent_ns=number)) for number in (1, 2))
    assert joints.open(second) is not None
    for old in (second, first):
        assert joints.open(old) is None
        assert joints.is_late(old)


def test_a_packet_sent_back_is_none() -> None:
    laptop, _ = ends()
    assert laptop.open(laptop.seal(Packet(number=1, sent_ns=1))) is None


@pytest.mark.parametrize("other", [PacketSeal(3, new_packet_key(), at_joints=True), PacketSeal(4, KEY, at_joints=True)])
def test_another_session_is_none(other: PacketSeal) -> None:
    laptop, _ = ends()
    datagram = laptop.seal(Packet(number=1, sent_ns=1))
    assert other.open(datagram) is None
    assert other.newest == 0, "a forged number must not shut out the true ones"


@given(position=st.integers(0, 59), bit=st.integers(0, 7))
def test_one_changed_bit_makes_it_nothing(position: int, bit: int) -> None:
    laptop, joints = ends()
    datagram = bytearray(laptop.seal(Packet(number=1, sent_ns=1, stops=(STOP,), heartbeat_ns=9, lease=2, loss=0.5)))
    datagram[position % len(datagram)] ^= 1 << bit
    assert joints.open(bytes(datagram)) is None
    assert joints.newest == 0


@given(st.binary(max_size=MAX_BYTES + 10))
def test_noise_is_nothing(noise: bytes) -> None:
    _, joints = ends()
    assert joints.open(noise) is None


def exchange(
    one: Beats, other: Beats, now_ns: int, ahead_ns: int, delay_ns: int, *, waits_ns: int = 0, ppm: int = 0
) -> None:
    """A packet each way, the second one later; the other's clock is ahead, and quicker from now on."""

    def there(at_ns: int) -> int:
        return at_ns + ahead_ns + (at_ns - now_ns) * ppm // 1_000_000

    other.take(one.next(now_ns, now_ns), there(now_ns + delay_ns))
    later_ns = now_ns + delay_ns + waits_ns
    one.take(other.next(there(later_ns), later_ns), later_ns + delay_ns)


def test_both_ends_learn_the_offset() -> None:
    laptop, joints, ahead_ns = Beats(), Beats(), 3_600_000_000_000
    for number in range(1, 20):
        exchange(laptop, joints, number * BEAT_NS, ahead_ns, 1_000_000)
    assert laptop.clock is not None
    assert joints.clock is not None
    assert abs(laptop.clock.offset_ns - ahead_ns) <= laptop.clock.uncertainty_ns < 2_000_000
    assert abs(joints.clock.offset_ns + ahead_ns) <= joints.clock.uncertainty_ns < 2_000_000
    assert laptop.quality.round_trip_ns == 2_000_000


@pytest.mark.parametrize("ppm", [600, 83_333, -83_333])
@pytest.mark.parametrize(("delay_ns", "waits_ns"), [(3 * MS, 0), (MS // 10, 18 * MS), (MS // 10, MS)])
def test_a_clock_that_is_slewed_is_followed_without_a_note(ppm: int, delay_ns: int, waits_ns: int) -> None:
    """600: what NTP may do to a clock; 83,333: chrony's quickest slew. A packet waits at one end or at the other."""
    laptop, joints = Beats(), Beats()
    for number in range(1, 500):
        ahead_ns = number * BEAT_NS * ppm // 1_000_000
        exchange(laptop, joints, number * BEAT_NS, ahead_ns, delay_ns, waits_ns=waits_ns, ppm=ppm)
        assert laptop.clock is not None
        assert abs(laptop.clock.offset_ns - ahead_ns) < 6 * MS
        assert joints.clock is not None or number == 1
    assert laptop.steps == joints.steps == 0
    assert min(laptop.quality.round_trip_ns, joints.quality.round_trip_ns) >= 0


def after_sleep(woken: Beats, other: Beats, now_ns: int, stood_ns: int) -> int:
    """They knew each other; one slept, and the other's first packet answers one from before. When it comes."""
    for number in range(20):
        exchange(woken, other, now_ns + number * BEAT_NS, HOUR_NS, MS)
    asleep_ns = now_ns + 20 * BEAT_NS
    woken.take(other.next(asleep_ns + stood_ns + HOUR_NS, 0), asleep_ns + MS)
    return asleep_ns + MS


def test_after_a_sleep_nothing_is_said_of_the_clocks_until_a_whole_round_trip_and_then_one_step() -> None:
    laptop, joints, stood_ns = Beats(), Beats(), 30_000 * MS
    health = AuditHealth(at_ns=1, written=1, waiting=0, newest=TRAIL)
    woke_ns = after_sleep(laptop, joints, HOUR_NS, stood_ns)
    assert laptop.other_trail(health, woke_ns) is None
    assert health_of(laptop, "exo", woke_ns, 0, None).uncertainty_ns is None
    assert laptop.quality.jitter_ns < MS, "the time of the sleep is no delay"
    for number in range(1, 10):
        exchange(laptop, joints, woke_ns + number * BEAT_NS, HOUR_NS + stood_ns, MS)
    assert laptop.clock is not None
    assert abs(laptop.clock.offset_ns - HOUR_NS - stood_ns) <= laptop.clock.uncertainty_ns < 2 * MS
    assert laptop.steps == 1
    assert round(dict(laptop.new_steps())[LinkNotice.CLOCK_STEPPED]) == 30
    record = laptop.other_trail(health, woke_ns + 10 * BEAT_NS)
    assert record is not None
    assert abs(record.offset_ns - HOUR_NS - stood_ns) <= record.uncertainty_ns


def test_stop_needs_no_round_trip_after_a_sleep_and_is_never_from_the_future() -> None:
    """Nothing may reach the laptop: then no round trip comes, and its packets come here all the same."""
    joints, laptop = Beats(), Beats()
    assert joints.stop_clock(HOUR_NS) is None, "not known before the first round trip"
    woke_ns = after_sleep(joints, laptop, HOUR_NS, 30_000 * MS)
    clock = joints.stop_clock(woke_ns + 3 * MS)
    assert joints.clock is None
    assert clock is not None
    left_ns = woke_ns - MS + 30_000 * MS + HOUR_NS  # by the laptop's clock
    assert clock.local_ns(left_ns) == woke_ns
    assert clock.local_ns(left_ns - 400 * MS) == woke_ns - 400 * MS


def test_a_link_that_was_lost_is_told_when_it_is_back() -> None:
    beats = Beats()
    assert beats.lost(0)
    assert not beats.take(Packet(number=1, sent_ns=1), 1_000)
    assert not beats.take(Packet(number=2, sent_ns=2), 1_000 + LOST_NS)
    assert beats.take(Packet(number=3, sent_ns=3), 1_001 + 2 * LOST_NS) == LOST_NS + 1


def test_a_set_wall_clock_of_the_other_host_is_told() -> None:
    beats = Beats()
    for number, wall_ns in enumerate((10, 11, 3_000_000_011, 3_000_000_012), 1):
        beats.take(Packet(number=number, sent_ns=number, wall_ns=wall_ns), number)
    assert beats.new_steps() == [(LinkNotice.OTHER_CLOCK_STEPPED, 3.0)]
    assert beats.new_steps() == [], "each once"
