"""Device descriptions that can't be driven are refused before anything moves, with the numbers."""

from __future__ import annotations

import msgspec
import pytest

from hal.errors import CanFault, DeviceFault, HardwareError
from hal.joints.can.driver import SocketCanJoints
from hal.joints.codecs.wire import WireQuantity
from hal.joints.device import load_exoskeleton
from tests.support.can_rig import with_motor
from tests.support.errors import refused


def test_a_bus_that_would_be_too_full_is_refused_with_the_share() -> None:
    device = with_motor("AK80-64/V2")
    slow = msgspec.structs.replace(device.buses[0], bitrate=500_000)
    with refused(DeviceFault.BUS_OVERLOADED, load=pytest.approx(1.08, abs=0.005), drives=4):
        SocketCanJoints(msgspec.structs.replace(device, buses=(slow,)))


def test_a_joint_on_a_bus_that_is_not_described_is_refused() -> None:
    with refused(DeviceFault.NO_SUCH_BUS, bus=3, count=1):
        SocketCanJoints(with_motor("AK80-64/V2", can_bus=3))


def test_limits_beyond_the_wire_are_refused_with_the_numbers() -> None:
    with refused(DeviceFault.BEYOND_WIRE_RANGE, quantity=WireQuantity.TORQUE, value=110.0, limit=65.0):
        SocketCanJoints(with_motor("AK10-9/V2"))
    with refused(DeviceFault.BEYOND_WIRE_RANGE, quantity=WireQuantity.ANGLE):
        SocketCanJoints(with_motor("AK80-64/V2", transmission=9.0, max_stiffness_nm_rad=400.0))


def test_a_servo_drive_is_refused_with_what_to_do() -> None:
    with refused(DeviceFault.SERVO_MODE, motor="AK80-64/servo"):
        SocketCanJoints(with_motor("AK80-64/servo"))


def test_a_bus_that_does_not_exist_names_the_command_that_repairs_it() -> None:
    device = load_exoskeleton()
    gone = msgspec.structs.replace(device.buses[0], channel="vcan99")
    joints = SocketCanJoints(msgspec.structs.replace(device, buses=(gone,)))
    with pytest.raises(HardwareError) as caught:
        joints.open(0)
    assert caught.value.code is CanFault.NO_INTERFACE
    assert "ip link add vcan99 type vcan" in str(caught.value.values["command"])
