"""The bus between the programs of one machine: frames unchanged, no echo, garbage told apart."""

from __future__ import annotations

import random
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.errors import CanFault
from hal.joints.can.bus import open_bus
from hal.joints.can.local_bus import GROUP, LocalBus
from hal.joints.can.port import BusPort, frame_of
from hal.joints.codecs.wire import Frame
from hal.joints.device import BusDevice
from hal.joints.protocol import BusFault
from tests.support.errors import refused

WAIT_S = 10.0


def free_channel() -> str:
    return str(random.SystemRandom().randrange(20_000, 32_000))  # below the kernel's ephemeral ports


@contextmanager
def ends(count: int) -> Iterator[list[LocalBus]]:
    channel = free_channel()
    with ExitStack() as stack:
        yield [stack.enter_context(LocalBus(channel)) for _ in range(count)]


@st.composite
def frames(draw: st.DrawFn) -> can.Message:
    extended = draw(st.booleans())
    kind = draw(st.sampled_from(("data", "remote", "error")))
    length = draw(st.integers(0, 8))
    return can.Message(
        arbitration_id=draw(st.integers(0, 0x1FFF_FFFF if extended else 0x7FF)),
        is_extended_id=extended,
        is_remote_frame=kind == "remote",
        is_error_frame=kind == "error",
        dlc=length,
        data=None if kind == "remote" else draw(st.binary(min_size=length, max_size=length)),
    )


def test_every_classic_frame_arrives_as_it_was_sent() -> None:
    with ends(2) as (sender, receiver):

        @settings(deadline=None)
        @given(frames())
        def arrives(frame: can.Message) -> None:
            sender.send(frame)
            arrived = receiver.recv(WAIT_S)
            assert arrived is not None
            assert arrived.equals(frame, timestamp_delta=None, check_channel=False, check_direction=False)

        arrives()


def test_frames_sent_together_arrive_one_by_one_or_together() -> None:
    together = tuple(Frame(number, bytes((number,)) * (number % 9), extended=number % 2 == 1) for number in range(150))
    with ends(3) as (sender, one_by_one, at_once):
        sender.send_frames(together)
        received = [one_by_one.recv(WAIT_S) for _ in together]
        assert [frame_of(message) for message in received if message is not None] == list(together)
        port = BusPort(at_once, "local")
        taken: list[Frame] = []
        while len(taken) < len(together) and (frames := port.wait(WAIT_S)) is not None:
            taken += frames
    assert taken == list(together)


def test_what_is_no_data_frame_is_reported_and_hides_none_beside_it() -> None:
    with ends(2) as (sender, receiver):
        port = BusPort(receiver, "local")
        sender.send(can.Message(arbitration_id=1, is_remote_frame=True))
        sender.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
        sender.send_frames((Frame(5, b"data"),))
        assert [port.wait(WAIT_S) for _ in range(3)] == [[], [], [Frame(5, b"data")]]
        assert port.take_faults()[0] == BusFault.MALFORMED | BusFault.BUS_OFF


def test_everybody_else_receives_a_frame_and_the_sender_does_not() -> None:
    with ends(3) as (first, second, third):
        first.send(can.Message(arbitration_id=1, is_extended_id=False))
        second.send(can.Message(arbitration_id=2, is_extended_id=False))
        heard = [[bus.recv(WAIT_S if n < due else 0) for n in range(3)] for bus, due in ((first, 1), (third, 2))]
    identifiers = [[frame.arbitration_id for frame in row if frame is not None] for row in heard]
    assert identifiers == [[2], [1, 2]]


def test_frames_carry_the_kernels_time_of_arrival() -> None:
    with ends(2) as (sender, receiver):
        before_s = time.time()
        sender.send(can.Message(arbitration_id=1))
        arrived = receiver.recv(WAIT_S)
        assert arrived is not None
        assert before_s - 1e-3 <= arrived.timestamp <= time.time() + 1e-3


@pytest.mark.parametrize("datagram", [b"", b"garbage", bytes(15), bytes(17), b"\0\0\0\0\x09" + bytes(11), bytes(1040)])
def test_datagrams_that_are_no_frames_are_flags(datagram: bytes) -> None:
    channel = free_channel()
    port = BusPort(open_bus(BusDevice(interface="local", channel=channel)), "local")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thrower:
        thrower.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        thrower.sendto(datagram, (GROUP, int(channel)))
    flags, end_s = BusFault.NONE, time.monotonic() + WAIT_S
    while flags is BusFault.NONE and time.monotonic() < end_s:
        assert list(port.drain(1)) == []
        flags = port.take_faults()[0]
    port.close()
    assert flags is BusFault.MALFORMED


@pytest.mark.parametrize("channel", ["", "can0", "80", "70000", "-1"])
def test_a_channel_that_is_no_port_is_refused_with_a_sentence(channel: str) -> None:
    with refused(CanFault.NOT_OPENED):
        open_bus(BusDevice(interface="local", channel=channel))


def test_a_frame_of_can_fd_is_refused() -> None:
    with ends(1) as (bus,), pytest.raises(can.CanOperationError, match="classic"):
        bus.send(can.Message(arbitration_id=1, is_fd=True, data=bytes(12)))


def test_a_closed_bus_is_a_flag_not_an_exception() -> None:
    bus = LocalBus(free_channel())
    port = BusPort(bus, "local")
    bus.shutdown()
    assert not port.send(Frame(1, b""))
    assert port.wait(0) is None
    assert port.take_faults()[0] & BusFault.INTERFACE_GONE
