"""The bus log against a disk that refuses, and with the controller's error frames in it."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable
from pathlib import Path

import can
import msgspec
import pytest

from hal.errors import CanFault, HardwareError
from hal.joints.can.bus import open_bus
from hal.joints.can.candump import FrameKind, LogDecoder, LogSummary, messages_of
from hal.joints.can.port import CAN_ERR_BUSOFF, BusPort, message_of
from hal.joints.can.recorder import BusRecorder
from hal.joints.codecs.mit import special_frame
from hal.joints.codecs.wire import Order
from hal.joints.device import BusDevice
from tests.support.bad_input import in_time
from tests.support.breaking_bus import BreakingBus
from tests.support.can_rig import each_joint, until, with_motor
from tests.support.errors import refused


def test_a_full_disk_is_reported_and_closing_raises_nothing() -> None:
    device = with_motor("AK80-64/V2")
    recorder = BusRecorder(device, Path("/dev/full"))
    with open_bus(device.buses[0]) as bus:
        bus.send(message_of(special_frame(1, Order.DISABLE)))
        with in_time(), refused(CanFault.LOG_UNWRITABLE, path=Path("/dev/full"), detail="No space left on device"):
            recorder.run(lambda: False)
    recorder.close()


def test_what_a_full_disk_did_not_take_at_the_end_is_reported() -> None:
    """Also when it is interrupted."""
    device = with_motor("AK80-64/V2")
    recorder = BusRecorder(device, Path("/dev/full"))
    recorder._flushed_s = float("inf")

    def interrupt() -> bool:
        if recorder.frames:
            raise KeyboardInterrupt
        return False

    with open_bus(device.buses[0]) as bus:
        bus.send(message_of(special_frame(1, Order.DISABLE)))
        with in_time(), refused(CanFault.LOG_UNWRITABLE, path=Path("/dev/full")):
            recorder.run(interrupt)
    recorder.close()


def test_the_end_of_the_disk_is_left_to_others(tmp_path: Path) -> None:
    path = tmp_path / "bus.can.log"
    recorder = BusRecorder(with_motor("AK80-64/V2"), path, floor_bytes=1 << 62)
    with in_time(), refused(CanFault.LOG_DISK_LOW, path=path):
        recorder.run(lambda: False)
    recorder.close()


@pytest.fixture
def reported(monkeypatch: pytest.MonkeyPatch) -> list[HardwareError]:
    """What a recorder reports, which looks for its buses at each turn."""
    monkeypatch.setattr("hal.joints.can.recorder.FLUSH_S", 0.0)
    return []


def gone(bus: BusDevice) -> can.BusABC:
    raise HardwareError(CanFault.NO_INTERFACE, bus=bus.channel, command="")


def unplugged(_: BusDevice) -> can.BusABC:
    return BreakingBus(receiving=can.CanOperationError(os.strerror(errno.ENODEV), errno.ENODEV))


@pytest.mark.parametrize("before", [gone, unplugged])
def test_an_adapter_that_is_plugged_in_is_recorded_and_the_gap_is_reported(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    reported: list[HardwareError],
    before: Callable[[BusDevice], can.BusABC],
) -> None:
    device = with_motor("AK80-64/V2")
    openings = [before, gone, open_bus]

    def opened(bus: BusDevice) -> can.BusABC:
        return openings.pop(0)(bus)

    monkeypatch.setattr("hal.joints.can.recorder.open_bus", opened)
    recorder = BusRecorder(device, tmp_path / "bus.can.log", waits=True, report=reported.append)

    with open_bus(device.buses[0]) as bus, in_time():

        def recorded() -> bool:
            if len(reported) == 2:
                bus.send(message_of(special_frame(1, Order.DISABLE)))
            return recorder.frames > 0

        recorder.run(recorded)
    recorder.close()
    assert [gap.code for gap in reported] == [CanFault.LOG_PAUSED, CanFault.LOG_RESUMED]
    assert {gap.values["bus"] for gap in reported} == {device.buses[0].channel}
    assert (tmp_path / "bus.can.log").read_text().split()[2] == "001#FFFFFFFFFFFFFFFD"


def test_buses_of_one_channel_name_have_a_name_each_in_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    legs = each_joint(with_motor("AK80-64/V2"), lambda n, joint: msgspec.structs.replace(joint, can_bus=n // 2))
    adapters = tuple(BusDevice(interface="gs_usb", channel="0", options={"index": index}) for index in range(2))
    device = msgspec.structs.replace(legs, buses=adapters)
    monkeypatch.setattr("hal.joints.can.recorder.open_bus", lambda bus: can.Bus(f"name {bus.options}", "virtual"))
    recorder = BusRecorder(device, tmp_path / "bus.can.log")
    for adapter in adapters:
        with can.Bus(f"name {adapter.options}", "virtual") as bus:
            bus.send(message_of(special_frame(1, Order.DISABLE)))
    with in_time():
        recorder.run(lambda: recorder.frames == 2)
    recorder.close()
    assert [line.split()[1] for line in (tmp_path / "bus.can.log").read_text().splitlines()] == ["can0_0", "can0_1"]


def test_a_frame_that_was_cut_makes_no_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reported: list[HardwareError]
) -> None:
    """slcan raises this; opening the adapter anew would lose frames."""
    bus = BreakingBus(receiving=ValueError("non-hexadecimal number"))
    monkeypatch.setattr("hal.joints.can.recorder.open_bus", lambda _: bus)
    recorder = BusRecorder(with_motor("AK80-64/V2"), tmp_path / "bus.can.log", report=reported.append)
    turns = iter(range(3))
    recorder.run(lambda: next(turns, None) is None)
    recorder.close()
    assert not reported


def test_a_bus_that_is_not_waited_for_must_be_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hal.joints.can.recorder.open_bus", gone)
    with refused(CanFault.NO_INTERFACE):
        BusRecorder(with_motor("AK80-64/V2"), tmp_path / "bus.can.log")


def test_a_controller_that_leaves_the_bus_is_recorded_as_that(tmp_path: Path) -> None:
    device = with_motor("AK80-64/V2")
    path = tmp_path / "bus.can.log"
    recorder, stop = BusRecorder(device, path), threading.Event()
    thread = threading.Thread(target=recorder.run, args=(stop.is_set,), daemon=True)
    thread.start()
    port = BusPort(open_bus(device.buses[0]), "test")
    if not port.send_error(CAN_ERR_BUSOFF):
        pytest.skip("a kernel takes no error frames from programs")
    until(lambda: recorder.frames)
    stop.set()
    thread.join()
    recorder.close()
    port.close()
    (line,) = path.read_text().splitlines()
    assert line.split()[2] == "20000040#0000000000000000"
    with path.open() as file:
        (message,) = messages_of(file, LogSummary())
    decoded = LogDecoder(device).decode(message)
    assert (decoded.kind, decoded.content) == (FrameKind.ERROR, CanFault.CONTROLLER_OFF)
