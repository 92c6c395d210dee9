"""What the frames of a log mean: lines that candump wrote, of two buses, of Damiao drives' registers."""

from __future__ import annotations

import io

import msgspec
import pytest

from hal.errors import CanFault
from hal.joints.can.bus import with_bus
from hal.joints.can.candump import Decoded, FrameKind, LogDecoder, LogSummary, file_channel, file_channels, messages_of
from hal.joints.codecs.wire import Reply
from hal.joints.device import BusDevice, Exoskeleton, load_exoskeleton
from hal.joints.protocol import DriveFault, Joint
from tests.support.can_rig import each_joint, with_motor

TWO_BUSES = msgspec.structs.replace(
    each_joint(
        load_exoskeleton(),
        lambda number, joint: msgspec.structs.replace(joint, can_bus=number // 2, can_id=1 + number % 2),
    ),
    buses=(BusDevice(channel="can0"), BusDevice(channel="can1")),
)


def decoded(device: Exoskeleton, *lines: str) -> list[Decoded]:
    """These lines of a log."""
    decoder = LogDecoder(device)
    text = "".join(f"({number}.0) {line}\n" for number, line in enumerate(lines, 1))
    return [decoder.decode(message) for message in messages_of(io.StringIO(text), LogSummary())]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("can0 20000040#0000000000000000", CanFault.CONTROLLER_OFF),
        ("can0 20000004#0008000000000000", CanFault.CONTROLLER_COUNTS_ERRORS),
        ("can0 200000A0#0000000000000000", CanFault.NOT_ACKNOWLEDGED),
        ("can0 20000080#", CanFault.BUS_ERROR),
    ],
)
def test_a_line_of_candump_about_an_error_counts_as_one(line: str, code: CanFault) -> None:
    (frame,) = decoded(with_motor("AK80-64/V2"), line)
    assert (frame.kind, frame.content) == (FrameKind.ERROR, code)


def test_equal_ids_on_two_buses_are_two_drives() -> None:
    command, reply = "001#7FFF7FF0000007FF", "000#018A3C7FF7FF1902"
    lines = (f"can0 {command}", f"can1 {command}", f"can0 {reply}", f"can1 {reply}", f"can2 {reply}")
    assert [(frame.joint, frame.kind) for frame in decoded(TWO_BUSES, *lines)] == [
        (Joint.LEFT_HIP, FrameKind.COMMAND),
        (Joint.RIGHT_HIP, FrameKind.COMMAND),
        (Joint.LEFT_HIP, FrameKind.REPLY),
        (Joint.RIGHT_HIP, FrameKind.REPLY),
        (None, FrameKind.UNKNOWN),
    ]


def test_buses_are_found_by_the_names_that_a_recorder_writes() -> None:
    local = with_bus(TWO_BUSES, "local", "43113,43114")
    frames = decoded(local, "can43113 001#7FFF7FF0000007FF", "can43114 001#7FFF7FF0000007FF")
    assert [frame.joint for frame in frames] == [Joint.LEFT_HIP, Joint.RIGHT_HIP]


@pytest.mark.parametrize(
    ("buses", "names"),
    [
        ([BusDevice(interface="gs_usb", channel="0", options={"index": index}) for index in (0, 1)], "can0_0 can0_1"),
        (
            [BusDevice(interface="udp_multicast", channel=f"239.74.163.2:4311{port}") for port in (3, 4)],
            "239_74_163_2__0 239_74_163_2__1",
        ),
    ],
)
def test_adapters_of_one_channel_name_are_told_apart_by_their_numbers(buses: list[BusDevice], names: str) -> None:
    """A log from before, in which they have one name, is decoded as it was: for all drives of that name."""
    device = msgspec.structs.replace(TWO_BUSES, buses=tuple(buses))
    assert file_channels(device) == names.split()
    lines = [f"{name} 001#7FFF7FF0000007FF" for name in (*names.split(), file_channel(buses[0].channel))]
    assert [frame.joint for frame in decoded(device, *lines)] == [Joint.LEFT_HIP, Joint.RIGHT_HIP, Joint.LEFT_HIP]


def test_one_bus_is_decoded_whatever_its_name() -> None:
    (frame,) = decoded(load_exoskeleton(), "vcan7 001#7FFF7FF0000007FF")
    assert frame.joint is Joint.LEFT_HIP


def test_registers_of_damiao_drives_are_no_status() -> None:
    device = with_motor("DM8009/default", max_torque_nm=50.0)
    lines = ("can0 7FF#0100331500000000", "can0 011#0100331500004841", "can0 7FF#010033", "can0 7FF#0100CC00")
    frames = decoded(device, *lines, "can0 7FF#0900331500000000")
    assert [(frame.joint, frame.kind) for frame in frames] == [
        (Joint.LEFT_HIP, FrameKind.REGISTER),
        (Joint.LEFT_HIP, FrameKind.REGISTER),
        (None, FrameKind.UNKNOWN),
        (Joint.LEFT_HIP, FrameKind.REGISTER),
        (None, FrameKind.UNKNOWN),
    ]
    assert frames[1].content == "011#0100331500004841"


def test_damiao_drives_are_known_by_their_reply_id() -> None:
    """Two IDs that end in the same four bits."""
    ids = (0x01, 0x02, 0x11, 0x12)
    device = each_joint(
        with_motor("DM8009/default", max_torque_nm=50.0),
        lambda number, joint: msgspec.structs.replace(joint, can_id=ids[number], reply_id=0x21 + number),
    )
    (frame,) = decoded(device, "can0 023#118A3C7FF7FF1919")
    assert (frame.joint, frame.kind) == (Joint.RIGHT_HIP, FrameKind.REPLY)
    assert isinstance(frame.content, Reply)
    assert frame.content.faults is DriveFault.NONE


def test_drives_in_servo_mode_are_decoded() -> None:
    (frame,) = decoded(with_motor("AK80-64/servo"), "can0 00002902#03840000000C1E00")
    assert (frame.joint, frame.kind) == (Joint.LEFT_KNEE, FrameKind.REPLY)
