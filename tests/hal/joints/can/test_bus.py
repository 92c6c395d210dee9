"""One bus that refuses, breaks or talks nonsense: always a flag with a sentence, never an exception."""

from __future__ import annotations

import errno
import os
import random
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import can
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.errors import CanFault, DeviceFault
from hal.joints.can.bus import bus_load, frame_bits, open_bus, with_bus
from hal.joints.can.port import ERROR_FRAMES, BusPort, fault_of, meaning_of, message_of
from hal.joints.codecs.wire import Frame
from hal.joints.device import BusDevice, Exoskeleton, load_exoskeleton
from hal.joints.protocol import BusFault
from tests.support.breaking_bus import BreakingBus
from tests.support.errors import refused

FRAME = Frame(1, b"\x01")


@pytest.mark.parametrize(
    ("error", "flag"),
    [
        (can.CanOperationError("No buffer space available", errno.ENOBUFS), BusFault.SEND_FAILED),
        (can.CanOperationError("Transmit buffer full"), BusFault.SEND_FAILED),
        (can.CanTimeoutError(), BusFault.SEND_FAILED),
        (BlockingIOError(errno.EAGAIN, "busy"), BusFault.SEND_FAILED),
        (can.CanOperationError("Network is down", errno.ENETDOWN), BusFault.INTERFACE_GONE),
        (can.CanOperationError("No such device", errno.ENODEV), BusFault.INTERFACE_GONE),
        (OSError(errno.ENXIO, "No such device or address"), BusFault.INTERFACE_GONE),
    ],
)
def test_a_frame_that_does_not_leave_is_reported(error: Exception, flag: BusFault) -> None:
    with BreakingBus(sending=error) as bus:
        port = BusPort(bus, "can0")
        assert not port.send(FRAME)
        fault, detail = port.take_faults()
        assert fault is flag
        assert detail is not None
        assert (detail.code, detail.values["bus"]) == (CanFault.SEND_FAILED, "can0")
        assert port.take_faults() == (BusFault.NONE, None)


def _broken_datagram() -> can.CanOperationError:
    error = can.CanOperationError("could not unpack received message")
    error.__cause__ = ValueError("no msgpack")
    return error


@pytest.mark.parametrize(
    ("error", "flag"),
    [
        (can.CanOperationError("Failed to receive: Network is down", errno.ENETDOWN), BusFault.INTERFACE_GONE),
        (can.CanOperationError("Cannot operate on a closed bus"), BusFault.INTERFACE_GONE),
        (OSError(errno.EBADF, "closed"), BusFault.INTERFACE_GONE),
        (_broken_datagram(), BusFault.MALFORMED),
        (ValueError("select on a closed socket"), BusFault.MALFORMED),
        (IndexError("string index out of range"), BusFault.MALFORMED),  # slcan, of a line that was cut
        (struct.error("unpack requires a buffer of 4 bytes"), BusFault.MALFORMED),  # serial and seeedstudio, the same
    ],
)
def test_receiving_that_breaks_is_reported(error: Exception, flag: BusFault) -> None:
    with BreakingBus(receiving=error) as bus:
        port = BusPort(bus, "can0")
        assert list(port.drain(1)) == []
        assert port.take_faults()[0] is flag


@pytest.mark.parametrize("row", ERROR_FRAMES)
def test_each_error_frame_has_its_meaning(row: object) -> None:
    bit = row.bit  # type: ignore[attr-defined]
    assert meaning_of(can.Message(is_error_frame=True, arbitration_id=bit)) is row


def test_an_error_frame_of_no_known_kind_is_still_one() -> None:
    assert meaning_of(can.Message(is_error_frame=True, arbitration_id=0)).fault is BusFault.ERROR_FRAME


def test_bus_off_outweighs_what_comes_with_it() -> None:
    message = can.Message(is_error_frame=True, is_extended_id=True, arbitration_id=0x1FF)
    assert meaning_of(message).fault is BusFault.BUS_OFF


TWO = msgspec.structs.replace(load_exoskeleton(), buses=(BusDevice(channel="can0"), BusDevice(channel="can1")))


def channels(device: Exoskeleton) -> list[str]:
    return [bus.channel for bus in device.buses]


@pytest.mark.parametrize("channel", ["can1", "can0,can0", "can0, can0,can1", "can1,"])
def test_two_buses_of_a_device_are_never_one(channel: str) -> None:
    """Each may have a drive with the same ID: the command to one leg would reach the other."""
    with refused(DeviceFault.CHANNEL_SHARED, device=TWO.name, count=2, bus=channel[:4]):
        with_bus(TWO, "", channel)


def test_two_buses_that_a_description_has_on_one_channel_are_refused() -> None:
    forgotten = msgspec.structs.replace(TWO, buses=(BusDevice(), BusDevice()))
    with refused(DeviceFault.CHANNEL_SHARED, count=2, bus="can0"):
        with_bus(forgotten, "", "")
    assert channels(with_bus(forgotten, "", "can0,can1")) == ["can0", "can1"]


def test_each_bus_is_put_on_its_own_channel() -> None:
    assert with_bus(TWO, "", "") == TWO
    assert channels(with_bus(TWO, "local", "43113, 43114")) == ["43113", "43114"]
    assert channels(with_bus(TWO, "", "can2,")) == ["can2", "can1"]


def test_adapters_that_their_options_tell_apart_may_name_their_channels_alike() -> None:
    adapters = tuple(BusDevice(interface="ixxat", channel="0", options={"unique_hardware_id": name}) for name in "ab")
    device = msgspec.structs.replace(TWO, buses=adapters)
    assert with_bus(device, "", "0") == device


@given(stamp_s=st.floats(0, 4e9), empty_ns=st.integers(0, 10**12), later_ns=st.integers(0, 10**10))
def test_an_arrival_lies_between_the_last_detection_and_now(stamp_s: float, empty_ns: int, later_ns: int) -> None:
    """Whatever the stamp and the wall clock say."""
    now_ns = empty_ns + later_ns
    with can.Bus(interface="virtual", channel="arrival", preserve_timestamps=True) as sender:
        port = BusPort(can.Bus(interface="virtual", channel="arrival"), "arrival", empty_ns, wall_ns=lambda: 2 * 10**18)
        sender.send(can.Message(arbitration_id=1, timestamp=stamp_s))
        arrivals = [arrival for _, arrival in port.drain(now_ns)]
        port.close()
    assert len(arrivals) == 1
    assert empty_ns <= arrivals[0] <= now_ns


def test_a_stamp_is_taken_over_by_its_age() -> None:
    wall_ns = 1_700_000_000 * 10**9
    with can.Bus(interface="virtual", channel="age", preserve_timestamps=True) as sender:
        bus = can.Bus(interface="virtual", channel="age")
        port = BusPort(bus, "age", 0, clock=lambda: 10_000_000, wall_ns=lambda: wall_ns)
        sender.send(can.Message(arbitration_id=1, timestamp=(wall_ns - 1_500_000) / 1e9))
        ((_, arrival),) = port.drain(10_000_000)
        port.close()
    assert arrival == pytest.approx(8_500_000, abs=1000)


def test_a_host_that_stood_still_since_the_tick_began_makes_no_news_older() -> None:
    began_ns, looked_ns, wall_ns = 10_000_000, 60_000_000, 1_700_000_000 * 10**9
    with can.Bus(interface="virtual", channel="stood", preserve_timestamps=True) as sender:
        bus = can.Bus(interface="virtual", channel="stood")
        port = BusPort(bus, "stood", 0, clock=lambda: looked_ns, wall_ns=lambda: wall_ns)
        sender.send(can.Message(arbitration_id=1, timestamp=(wall_ns - (looked_ns - began_ns) - 1_500_000) / 1e9))
        ((_, arrival),) = port.drain(began_ns)
        port.close()
    assert arrival == pytest.approx(8_500_000, abs=1000)


def test_who_waits_for_answers_dates_them_by_their_arrival() -> None:
    """Not by when the host came to read them: an old answer with a fresh time passes for a jump of the joint."""
    wall_ns = 1_700_000_000 * 10**9
    with can.Bus(interface="virtual", channel="answers", preserve_timestamps=True) as sender:
        bus = can.Bus(interface="virtual", channel="answers")
        port = BusPort(bus, "answers", 0, clock=lambda: 60_000_000, wall_ns=lambda: wall_ns)
        sender.send(can.Message(arbitration_id=1, timestamp=(wall_ns - 50_000_000) / 1e9))
        assert [at_ns for _, at_ns in port.wait_for_arrivals(0.0) or ()] == [pytest.approx(10_000_000, abs=1000)]
        assert port.wait_for_arrivals(0.0) is None
        port.close()


def test_a_flood_costs_one_tick_no_more_than_its_share() -> None:
    with can.Bus(interface="virtual", channel="flood") as sender:
        port = BusPort(can.Bus(interface="virtual", channel="flood"), "flood")
        for _ in range(1000):
            sender.send(message_of(FRAME))
        assert len(list(port.drain(1))) == 64
        port.close()


@pytest.fixture
def udp() -> Iterator[tuple[BusPort, tuple[str, int]]]:
    """A port on a private udp_multicast channel, and where to throw datagrams."""
    where = "239.74.163.2", random.SystemRandom().randrange(20_000, 60_000)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        if probe.connect_ex(where):
            pytest.skip("this host has no route for multicast")
    port = BusPort(open_bus(BusDevice(interface="udp_multicast", channel="{}:{}".format(*where))), "udp")
    yield port, where
    port.close()


@pytest.mark.parametrize("datagram", [b"", b"garbage", b"\x81\xa1x\x01", bytes(range(256)), b"\xc1" * 3000])
def test_datagrams_that_are_no_frames_are_flags(udp: tuple[BusPort, tuple[str, int]], datagram: bytes) -> None:
    port, where = udp
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thrower:
        thrower.sendto(datagram, where)
    flags, end_s = BusFault.NONE, time.monotonic() + 10
    while flags is BusFault.NONE and time.monotonic() < end_s:
        assert list(port.drain(1)) == []
        flags = port.take_faults()[0]
    assert flags is BusFault.MALFORMED


def test_the_length_of_frames_is_the_standards() -> None:
    """Worst case of classic frames with 8 bytes: 135 bits standard, 160 extended, interframe space included."""
    assert frame_bits(8, extended=False) == 135
    assert frame_bits(8, extended=True) == 160
    assert bus_load([135] * 8, bitrate=1_000_000) == pytest.approx(0.54)


def test_an_error_without_a_number_is_a_failed_send() -> None:
    assert fault_of(RuntimeError("?")) is BusFault.SEND_FAILED


def test_an_interface_that_is_there_but_down_is_only_brought_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """To add it again fails, and what follows would not be run."""
    (tmp_path / "vcan7").mkdir()
    (tmp_path / "vcan7" / "flags").write_text("0x80\n")
    monkeypatch.setattr("hal.joints.can.bus.Path", lambda _, *parts: tmp_path.joinpath(*parts))
    with refused(CanFault.INTERFACE_DOWN, bus="vcan7", command="sudo ip link set vcan7 up"):
        open_bus(BusDevice(channel="vcan7"))


def test_an_interface_that_goes_while_it_is_looked_at_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel's file is there, and can't be read any more."""

    def read_text(_: Path) -> str:
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    monkeypatch.setattr(Path, "read_text", read_text)
    with refused(CanFault.NO_INTERFACE, bus="lo"):
        open_bus(BusDevice(channel="lo"))


@pytest.mark.parametrize(
    "error",
    [
        KeyError("can0"),  # pcan, of a channel that is no name of its own
        NameError("name 'canGetNumberOfChannels' is not defined"),  # kvaser, without its driver
        AttributeError("'str' object has no attribute 'device_capability'"),  # gs_usb
    ],
)
def test_an_interface_that_lets_its_own_errors_out_is_not_opened(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def opening(**_options: object) -> can.BusABC:
        raise error

    monkeypatch.setattr(can, "Bus", opening)
    with refused(CanFault.NOT_OPENED, bus="can0", interface="pcan", detail=str(error)):
        open_bus(BusDevice(interface="pcan"))
