"""A bus for each leg, and an adapter that is gone: the other leg's drives are damped and switched off all the same."""

from __future__ import annotations

import can
import msgspec
import pytest

from hal.errors import CanFault, DrivesFault, HardwareError
from hal.joints.can import driver
from hal.joints.can.bus import AbsentBus, open_bus
from hal.joints.codecs.wire import Order, SetPoint
from hal.joints.device import BusDevice, Exoskeleton
from hal.joints.emulator.faults import Fault
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.factory import make_joints
from hal.joints.protocol import Joint
from tests.support.can_rig import (
    CanRig,
    MakeRig,
    assert_damping,
    command,
    each_joint,
    listening,
    with_motor,
)
from tests.support.errors import refused

LEFT, RIGHT = (Joint.LEFT_HIP, Joint.LEFT_KNEE), (Joint.RIGHT_HIP, Joint.RIGHT_KNEE)


def two_buses(motor: str = "AK80-64/V2") -> Exoskeleton:
    """The left leg on the first bus, the right one on the second."""
    first, second = (with_motor(motor) for _ in range(2))
    buses = tuple(msgspec.structs.replace(device.buses[0], bitrate=500_000) for device in (first, second))
    if buses[0] == buses[1]:
        pytest.skip("one kernel bus only")
    legs = each_joint(first, lambda number, joint: msgspec.structs.replace(joint, can_bus=number // 2))
    return msgspec.structs.replace(legs, buses=buses)


@pytest.fixture
def gone(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Channels whose adapter is not there for the driver."""
    channels: set[str] = set()

    def opened(bus: BusDevice) -> can.BusABC:
        if bus.channel in channels:
            raise HardwareError(CanFault.NO_INTERFACE, bus=bus.channel, command="")
        return open_bus(bus)

    monkeypatch.setattr(driver, "open_bus", opened)
    return channels


def stiffness_nm_rad(rig: CanRig, joints: tuple[Joint, ...]) -> list[float]:
    return [rig.emulator.drives[joint].effective(rig.now_ns()).stiffness_nm_rad for joint in joints]


def assert_damped_then_off(drive: EmulatedDrive, told: list[SetPoint | Order | None]) -> None:
    damping = told[: told.index(Order.DISABLE)]
    assert len(damping) == 15, "each 20 ms for 0.3 s"
    assert_damping(drive, damping)
    assert not drive.motor_mode


def test_torque_off_reaches_the_leg_whose_bus_is_there(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, gone: set[str]
) -> None:
    rig = make_rig(two_buses())
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())
    rig.until(lambda _: min(stiffness_nm_rad(rig, (*Joint,))) > 100.0, command(0.2, stiffness=300.0))
    rig.emulator.inject(Fault.SILENT)
    with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(*Joint,)):
        rig.joints.close(rig.now_ns())
    gone.add(rig.emulator.device.buses[0].channel)
    rig.emulator.inject(Fault.HEALED)
    told = [listening(monkeypatch, drive) for drive in rig.emulator.drives]
    with refused(CanFault.NO_INTERFACE):
        rig.joints.close(rig.now_ns())
    for joint in RIGHT:
        assert_damped_then_off(rig.emulator.drives[joint], told[joint])
    assert min(stiffness_nm_rad(rig, LEFT)) > 100.0
    gone.clear()
    for asked in told:
        asked.clear()
    rig.joints.close(rig.now_ns())
    for joint in LEFT:
        assert_damped_then_off(rig.emulator.drives[joint], told[joint])
    assert not any(told[joint] for joint in RIGHT), "they have confirmed"


@pytest.mark.parametrize("motor", ["AK80-64/V2", "AK80-64/V3"])
def test_a_start_without_one_bus_takes_the_torque_off_what_was_left_on_at_the_other(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, gone: set[str], motor: str
) -> None:
    rig = make_rig(two_buses(motor))
    session = CanRig(make_joints("can", rig.emulator.device), rig.emulator)
    for drive in rig.emulator.drives:
        drive.motor_mode, drive._target = True, SetPoint(0.1, 0.0, 200.0, 2.0, 0.0)
    gone.add(rig.emulator.device.buses[0].channel)
    told = [listening(monkeypatch, drive) for drive in rig.emulator.drives]
    with refused(CanFault.NO_INTERFACE):
        session.joints.open(session.now_ns())
    for joint in RIGHT:
        drive = rig.emulator.drives[joint]
        if drive._codec.traits.enabled_by_command:
            assert set(told[joint]) == {Order.DISABLE}
        else:
            assert_damped_then_off(drive, told[joint])
        assert not drive.motor_mode
    assert all(rig.emulator.drives[joint].motor_mode for joint in LEFT)
    gone.clear()
    session.joints.open(session.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)
    session.joints.close(session.now_ns())


def test_an_absent_bus_takes_and_gives_nothing() -> None:
    with AbsentBus("can0") as bus:
        assert bus.recv(0) is None
        with pytest.raises(can.CanOperationError):
            bus.send(can.Message())


def test_closed_drives_need_no_bus_to_be_closed_again(make_rig: MakeRig, gone: set[str]) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.joints.open(rig.now_ns())
    rig.joints.close(rig.now_ns())
    gone.add(rig.emulator.device.buses[0].channel)
    rig.joints.close(rig.now_ns())
