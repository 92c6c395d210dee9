"""The emulator answers frames as drivers in use elsewhere write them: every byte here is written by hand.

Notation as in can-utils: identifier (three digits standard, eight extended) # data. Drive 5 rests at zero, 25 °C.
"""

from __future__ import annotations

import math

import msgspec
import pytest

from hal.joints.codecs import codec_of
from hal.joints.codecs.wire import Frame, SetPoint
from hal.joints.device import load_exoskeleton
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.emulator.plant import Motion
from hal.joints.motors import load_motors
from hal.joints.protocol import DriveFault

# What a driver sends, and what the drive says to it, in the order of a session.
SESSIONS = {
    ("AK80-9/V2", 0): [
        ("005#FFFFFFFFFFFFFFFC", "000#057FFF7FF7FF1900"),
        ("005#7FFF7FF0000007FF", "000#057FFF7FF7FF1900"),
        ("005#FFFFFFFFFFFFFFFD", "000#057FFF7FF7FF1900"),
        ("005#FFFFFFFFFFFFFFFE", "000#057FFF7FF7FF1900"),
        ("006#FFFFFFFFFFFFFFFC", ""),
        ("005#FFFFFFFFFFFFFF", ""),  # seven bytes are no command
        ("00000005#FFFFFFFFFFFFFFFC", ""),  # nor is an extended frame
    ],
    ("mini-cheetah/bgkatz", 0): [("005#FFFFFFFFFFFFFFFC", "000#057FFF7FF7FF60")],
    ("AK80-9/V3", 0): [
        ("00000805#0000007FFF7FF7FF", "00002905#0000000000001900"),
        ("00000105#00000000", "00002905#0000000000001900"),
        ("00000505#00", "00002905#0000000000001900"),
    ],
    ("DM4310/default", 0x15): [
        ("7FF#05003316", "015#050033160000F041"),  # velocity range, asked in four bytes: 30.0 as a float
        ("7FF#0500331600000000", "015#050033160000F041"),
        ("7FF#0500550A01000000", "015#0500550A01000000"),  # MIT mode: a write is answered as a write
        ("7FF#0500CC", ""),
        ("7FF#0500CC00", "015#057FFF7FF7FF1919"),
        ("7FF#0600CC0000000000", ""),
        ("005#FFFFFFFFFFFFFFFC", "015#157FFF7FF7FF1919"),
        ("005#7FFF7FF0000007FF", "015#157FFF7FF7FF1919"),
        ("005#FFFFFFFFFFFFFFFD", "015#057FFF7FF7FF1919"),
        ("005#FFFFFFFFFFFFFFFB", "015#057FFF7FF7FF1919"),
    ],
    ("CyberGear/manual", 0): [
        ("03005505#0000000000000000", "02800555#7FFF7FFF7FFF00FA"),  # a host that calls itself 55
        ("0300FD05#0000000000000000", "028005FD#7FFF7FFF7FFF00FA"),
        ("017FFF05#7FFF7FFF00000000", "028005FD#7FFF7FFF7FFF00FA"),
        ("1100FD05#1970000000000000", "110005FD#1970000000000000"),
        ("1100FD05#1C70000000000000", "110005FD#1C7000000000C041"),  # 24 V supply
        ("1400FD05#0000000000000000", "020005FD#7FFF7FFF7FFF00FA"),  # its emergency brake takes the torque off
        ("0300FD05#0000000000000000", "028005FD#7FFF7FFF7FFF00FA"),
        ("0400FD05#0000000000000000", "020005FD#7FFF7FFF7FFF00FA"),
        ("0300FD06#0000000000000000", ""),
    ],
}


# What drivers in use elsewhere put on a bus for these numbers, taken down beside the emulator. In this order:
# mini-cheetah-motor-driver-socketcan 0.4.3 (its axis turned round), damiao-motor 1.0.6, python-cybergear 0.1.2, and
# pycybergear 1.0.0, which leaves the torque in the identifier at 0, that is −12 Nm, whatever it is given; a public
# SocketCAN driver for the manual V3.0.1 (its class CubeMarsAkV3Motor). TMotorCANControl 1.2.6
# scales MIT mode by 2ⁿ where the firmware does by 2ⁿ − 1: not pinned.
SEEN = [
    ("AK10-9/V2", SetPoint(-0.3, 0.0, 40.0, 2.0, 0.0), "005#7CED7FF1476667FF"),
    ("DM4340/v10", SetPoint(0.5, 0.0, 30.0, 1.5, 0.0), "005#851E7FF0F54CC7FF"),
    ("CyberGear/sample", SetPoint(0.5, 0.0, 30.0, 1.5, 0.0), "017FFF05#851E7FFF0F5C4CCC"),
    ("CyberGear/sample", SetPoint(0.5, 0.0, 30.0, 1.5, -12.0), "01000005#851E7FFF0F5C4CCC"),
    ("AK60-6/V3.0.1", SetPoint(-0.3, 2.0, 40.0, 2.0, -3.5), "00000805#1476667CF08435AA"),
    ("AK80-9/V3.0.1", SetPoint(-0.3, 2.0, 40.0, 2.0, -3.5), "00000805#1476667CF083E671"),
    ("AK10-9/V3.0.1", SetPoint(-0.3, 2.0, 40.0, 2.0, -3.5), "00000805#1476667CF089177A"),
]


@pytest.mark.parametrize(("label", "reported", "observed"), SEEN)
def test_other_drivers_pack_the_same_numbers_into_the_same_bits(label: str, reported: SetPoint, observed: str) -> None:
    codec = codec_of(load_motors().find(label))
    assert text_of(codec.command(5, reported)) == observed
    understood = codec.read_command(5, frame_of(observed))
    assert isinstance(understood, SetPoint)
    coarsest = 500 / 4095  # quantum here: of stiffness
    assert tuple(understood) == pytest.approx(tuple(reported), abs=coarsest)


def test_an_upload_reports_to_another_driver_what_it_reports_here() -> None:
    """TMotorCANControl 1.2.6 reads the emulator's upload as 40.1°, 2170 electrical rpm, 3.66 A, 31 °C."""
    model = load_motors().find("AK80-9/servo")
    joint = msgspec.structs.replace(load_exoskeleton().left_knee, can_id=5, reply_id=0)
    emulated = EmulatedDrive(joint, model)
    emulated.state = Motion(position_rad=0.7, velocity_rad_s=1.2, torque_nm=3.0, temperature_c=31.0)
    (upload,) = emulated.upload()
    assert text_of(upload) == "00002905#019100D9016E1F00"
    decoded = codec_of(model).read_reply(upload)
    assert decoded is not None
    assert decoded.position_rad == pytest.approx(math.radians(40.1))
    assert decoded.velocity_rad_s == pytest.approx(2170 / (21 * 9) * math.tau / 60)
    assert decoded.torque_nm == pytest.approx(3.66 * 0.091 * 9)
    assert (decoded.temperature_c, decoded.faults) == (31.0, DriveFault.NONE)


def frame_of(text: str) -> Frame:
    identifier, _, data = text.partition("#")
    return Frame(int(identifier, 16), bytes.fromhex(data), extended=len(identifier) == 8)


def text_of(frame: Frame) -> str:
    return f"{frame.arbitration_id:0{8 if frame.extended else 3}X}#{frame.data.hex().upper()}"


@pytest.mark.parametrize(("drive", "session"), SESSIONS.items(), ids=[label for label, _ in SESSIONS])
def test_the_emulator_answers_what_other_drivers_send(drive: tuple[str, int], session: list[tuple[str, str]]) -> None:
    label, reply_id = drive
    joint = msgspec.structs.replace(load_exoskeleton().left_knee, can_id=5, reply_id=reply_id)
    emulated = EmulatedDrive(joint, load_motors().find(label))
    replies = [(asked, " ".join(map(text_of, emulated.receive(frame_of(asked), 0)))) for asked, _ in session]
    assert replies == session
