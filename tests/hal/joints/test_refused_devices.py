"""Device descriptions that can't be driven are refused before anything moves, with the numbers and what to do."""

from __future__ import annotations

import msgspec
import pytest

from hal.errors import HardwareError
from hal.joints.can.driver import SocketCanJoints
from hal.joints.device import Exoskeleton, load_exoskeleton
from tests.hal.joints.rig import with_motor


def refuse(device: Exoskeleton) -> str:
    with pytest.raises(HardwareError) as caught:
        SocketCanJoints(device)
    return str(caught.value)


def test_a_bus_that_would_be_too_full_is_refused_with_the_share() -> None:
    device = with_motor("AK80-64/V2")
    slow = msgspec.structs.replace(device.buses[0], bitrate=500_000)
    assert "108% full with 4 drives" in refuse(msgspec.structs.replace(device, buses=(slow,)))


def test_a_joint_on_a_bus_that_is_not_described_is_refused() -> None:
    assert "sits on bus 3" in refuse(with_motor("AK80-64/V2", can_bus=3))


def test_limits_beyond_the_wire_are_refused_with_the_numbers() -> None:
    assert "largest torque is 110.0 Nm at the motor, but the wire carries 65.0" in refuse(with_motor("AK10-9/V2"))
    assert "largest angle" in refuse(with_motor("AK80-64/V2", transmission=9.0, max_stiffness_nm_rad=400.0))


def test_a_servo_drive_is_refused_with_what_to_do() -> None:
    assert "MIT mode" in refuse(with_motor("AK80-64/servo"))


def test_a_bus_that_does_not_exist_names_the_command_that_mends_it() -> None:
    device = load_exoskeleton()
    gone = msgspec.structs.replace(device.buses[0], channel="vcan99")
    joints = SocketCanJoints(msgspec.structs.replace(device, buses=(gone,)))
    with pytest.raises(HardwareError, match="ip link add vcan99 type vcan"):
        joints.open(0)
