"""Sealed packets: each once, by its session's key; anything else is nothing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.link.beats import BEAT_NS, LOST_NS, Beats
from app.link.packets import MAX_BYTES, PacketSeal, new_packet_key
from app.link.wire import Packet, StopMark

KEY = new_packet_key()
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


def exchange(one: Beats, other: Beats, now_ns: int, ahead_ns: int, delay_ns: int) -> None:
    """A packet each way; the other's clock is ahead."""
    other.take(one.next(now_ns, now_ns), now_ns + delay_ns + ahead_ns)
    later_ns = now_ns + delay_ns
    one.take(other.next(later_ns + ahead_ns, later_ns), later_ns + delay_ns)


def test_both_ends_learn_the_offset() -> None:
    laptop, joints, ahead_ns = Beats(), Beats(), 3_600_000_000_000
    for number in range(1, 20):
        exchange(laptop, joints, number * BEAT_NS, ahead_ns, 1_000_000)
    assert laptop.clock is not None
    assert joints.clock is not None
    assert abs(laptop.clock.offset_ns - ahead_ns) <= laptop.clock.uncertainty_ns < 2_000_000
    assert abs(joints.clock.offset_ns + ahead_ns) <= joints.clock.uncertainty_ns < 2_000_000
    assert laptop.quality.round_trip_ns == 2_000_000


def test_a_link_that_was_lost_is_told_when_it_is_back() -> None:
    beats = Beats()
    assert beats.lost(0)
    assert not beats.take(Packet(number=1, sent_ns=1), 1_000)
    assert not beats.take(Packet(number=2, sent_ns=2), 1_000 + LOST_NS)
    assert beats.take(Packet(number=3, sent_ns=3), 1_001 + 2 * LOST_NS)


def test_a_set_wall_clock_of_the_other_host_is_told() -> None:
    beats = Beats()
    for number, wall_ns in enumerate((10, 11, 3_000_000_011, 3_000_000_012), 1):
        beats.take(Packet(number=number, sent_ns=number, wall_ns=wall_ns), number)
    assert beats.wall_step_ns == 3_000_000_000
