"""Device descriptions that can't be driven are refused before anything moves, with the numbers."""

from __future__ import annotations

import msgspec
import pytest

from hal.errors import CanFault, DeviceFault, HardwareError
from hal.joints.can.driver import SocketCanJoints
from hal.joints.codecs.wire import WireQuantity
from hal.joints.device import Exoskeleton, load_exoskeleton
from hal.joints.protocol import Joint
from tests.support.can_rig import each_joint, with_motor
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
    with refused(DeviceFault.BEYOND_WIRE_RANGE, quantity=WireQuantity.TORQUE, value=115.5, limit=65.0):
        SocketCanJoints(with_motor("AK10-9/V2"))
    with refused(DeviceFault.BEYOND_WIRE_RANGE, quantity=WireQuantity.ANGLE):
        SocketCanJoints(with_motor("AK80-64/V2", transmission=9.0, max_stiffness_nm_rad=400.0))
    with refused(DeviceFault.BEYOND_WIRE_RANGE, quantity=WireQuantity.DAMPING, value=5.1, limit=5.0):
        SocketCanJoints(with_motor("AK80-64/V2", max_damping_nm_s_rad=5.1))


@pytest.mark.parametrize(
    ("limits", "quantity"),
    [
        ({"max_speed_deg_s": 450.0}, WireQuantity.SPEED),  # 458° is the most that the wire carries
        ({"max_torque_nm": 140.0}, WireQuantity.TORQUE),  # 144 Nm
        ({"max_deg": 119.0, "transmission": 6.0, "max_stiffness_nm_rad": 400.0}, WireQuantity.ANGLE),  # 119.4°
    ],
)
def test_limits_that_a_reply_can_not_exceed_by_controls_margin_are_refused(
    limits: dict[str, float], quantity: WireQuantity
) -> None:
    """The events of over-speed, over-torque and out-of-range would never come."""
    low_geared = {"max_speed_deg_s": 60.0} if "transmission" in limits else {}
    with refused(DeviceFault.BEYOND_WIRE_RANGE, quantity=quantity):
        SocketCanJoints(with_motor("AK80-64/V2", **limits, **low_geared))


def numbered(motor: str, ids: tuple[int, ...], reply_ids: tuple[int, ...], **changes: object) -> Exoskeleton:
    """The device with this motor at each joint, its drives and their replies on these identifiers."""
    return each_joint(
        with_motor(motor, **changes),
        lambda number, joint: msgspec.structs.replace(joint, can_id=ids[number], reply_id=reply_ids[number]),
    )


HOST = (0, 0, 0, 0)
CUSTOMARY = (0x11, 0x12, 0x13, 0x14)


@pytest.mark.parametrize(
    ("motor", "ids", "reply_ids", "clash"),
    [
        ("AK80-64/V2", (0, 1, 2, 3), HOST, (Joint.LEFT_HIP, Joint.LEFT_KNEE, 0)),
        ("AK80-64/V2", (1, 2, 3, 2), HOST, (Joint.LEFT_KNEE, Joint.RIGHT_KNEE, 2)),
        ("DM8009/default", (1, 2, 3, 4), (2, 0x12, 0x13, 0x14), (Joint.LEFT_KNEE, Joint.LEFT_HIP, 2)),
        ("DM8009/default", (1, 2, 3, 4), (0x7FF, 0x12, 0x13, 0x14), (Joint.LEFT_KNEE, Joint.LEFT_HIP, 0x7FF)),
        ("CyberGear/manual", (1, 2, 3, 3), HOST, (Joint.RIGHT_HIP, Joint.RIGHT_KNEE, 3)),
    ],
    ids=["counted from 0", "one ID twice", "a reply to another drive", "a reply to the registers", "extended"],
)
def test_a_drive_that_would_take_another_ones_frames_for_its_commands_is_refused(
    motor: str, ids: tuple[int, ...], reply_ids: tuple[int, ...], clash: tuple[Joint, Joint, int]
) -> None:
    joint, other, identifier = clash
    device = numbered(motor, ids, reply_ids, max_torque_nm=11.0)
    with refused(DeviceFault.IDENTIFIER_TAKEN, joint=joint, other=other, identifier=identifier):
        SocketCanJoints(device)


@pytest.mark.parametrize(
    ("motor", "ids", "reply_ids"),
    [
        ("AK80-64/V2", (1, 2, 3, 4), (5, 5, 5, 5)),
        ("AK80-64/V3", (0, 1, 2, 3), HOST),  # commanded on extended identifiers, as the CyberGears
        ("CyberGear/manual", (0, 1, 2, 3), (1, 2, 3, 0)),
        ("DM8009/default", (0, 1, 2, 3), CUSTOMARY),
        ("DM8009/default", (1, 2, 3, 4), (1, 2, 3, 4)),  # none hears its own replies
    ],
)
def test_drives_that_can_not_hear_each_others_replies_may_have_any_numbers(
    motor: str, ids: tuple[int, ...], reply_ids: tuple[int, ...]
) -> None:
    assert len(SocketCanJoints(numbered(motor, ids, reply_ids, max_torque_nm=11.0)).drives) == 4


def test_a_v3_drive_counts_as_one_that_replies_to_the_host() -> None:
    """Its early firmware has the reply of V2, on a standard identifier."""
    device = numbered("AK80-64/V3", (1, 2, 3, 4), HOST)
    mixed = msgspec.structs.replace(device, right_hip=msgspec.structs.replace(device.right_hip, motor="AK80-64/V2"))
    assert SocketCanJoints(mixed).drives[Joint.RIGHT_HIP].device.can_id == 3
    zero = msgspec.structs.replace(mixed, right_hip=msgspec.structs.replace(mixed.right_hip, can_id=0))
    with refused(DeviceFault.IDENTIFIER_TAKEN, joint=Joint.RIGHT_HIP, other=Joint.LEFT_HIP, identifier=0):
        SocketCanJoints(zero)


def test_an_identifier_is_taken_on_its_own_bus_only() -> None:
    device = numbered("AK80-64/V2", (1, 2, 1, 2), HOST)
    apart = each_joint(device, lambda number, joint: msgspec.structs.replace(joint, can_bus=number // 2))
    buses = (*device.buses, msgspec.structs.replace(device.buses[0], channel="can1"))
    assert len(SocketCanJoints(msgspec.structs.replace(apart, buses=buses)).drives) == 4


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
