"""Frames to the bit: golden ones, round trips of every motor, and what is no frame of theirs."""

from __future__ import annotations

import math
import re
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.joints.codecs import CODECS, codec_of, cybergear, damiao, mit
from hal.joints.codecs.wire import NEUTRAL, Frame, Order, Reply, Scale, SetPoint, Transmission
from hal.joints.motors import MotorModel, ReplyLayout, WireProtocol, load_motors
from hal.joints.protocol import DriveFault

TABLE = load_motors()
MOTORS = tuple(TABLE.entries.values())
COMMANDED = tuple(motor for motor in MOTORS if motor.protocol is not WireProtocol.SERVO)
UPLOADING = (WireProtocol.AK_V3, WireProtocol.SERVO)
motors = st.sampled_from(COMMANDED)
shares = st.floats(-1.0, 1.0)

# Computed by hand from u = int((x - min)(2^n - 1)/(max - min)); kept in the protocol notes
GOLDEN = [
    ("AK80-9/V2", NEUTRAL, "7F FF 7F F0 00 00 07 FF"),
    ("AK80-9/V2", SetPoint(1.0, -2.0, 20.0, 1.0, 3.0), "8A 3C 7A D0 A3 33 39 54"),
    ("AK80-64/V2", SetPoint(-0.5, 0.0, 100.0, 2.0, -10.0), "7A E0 7F F3 33 66 67 71"),
    ("AK80-9/V3", NEUTRAL, "00 00 00 7F FF 7F F7 FF"),
    ("AK80-64/V3", SetPoint(-0.5, 0.0, 100.0, 2.0, -10.0), "33 36 66 7A E0 7F F7 71"),
    ("DM4310/default", NEUTRAL, "7F FF 7F F0 00 00 07 FF"),
    ("CyberGear/manual", NEUTRAL, "7F FF 7F FF 00 00 00 00"),
]


@pytest.mark.parametrize(("label", "target", "data"), GOLDEN)
def test_golden_commands(label: str, target: SetPoint, data: str) -> None:
    assert codec_of(TABLE.find(label)).command(1, target).data == bytes.fromhex(data)


@pytest.mark.parametrize(
    ("label", "identifier", "extended"),
    [
        ("AK80-9/V2", 0x005, False),
        ("AK80-9/V3", 0x805, True),
        ("DM4310/default", 0x005, False),
        ("CyberGear/manual", 0x01_7FFF_05, True),
    ],
)
def test_golden_identifiers(label: str, identifier: int, extended: bool) -> None:
    frame = codec_of(TABLE.find(label)).command(5, NEUTRAL)
    assert (frame.arbitration_id, frame.extended) == (identifier, extended)


@pytest.mark.parametrize(
    ("label", "order", "frames"),
    [
        ("AK80-9/V2", Order.ENABLE, ["005#FFFFFFFFFFFFFFFC"]),
        ("AK80-9/V2", Order.DISABLE, ["005#FFFFFFFFFFFFFFFD"]),
        ("AK80-9/V2", Order.ZERO, ["005#FFFFFFFFFFFFFFFE"]),
        ("AK80-9/V2", Order.CLEAR, []),
        ("DM4310/default", Order.CLEAR, ["005#FFFFFFFFFFFFFFFB"]),
        ("AK80-9/V3", Order.DISABLE, ["00000105#00000000"]),
        ("AK80-9/V3", Order.ZERO, ["00000505#00"]),
        ("CyberGear/manual", Order.ENABLE, ["1200FD05#0570000000000000", "0300FD05#0000000000000000"]),
        ("CyberGear/manual", Order.DISABLE, ["0400FD05#0000000000000000"]),
        ("CyberGear/manual", Order.CLEAR, ["0400FD05#0100000000000000"]),
        ("CyberGear/manual", Order.ZERO, ["0600FD05#0100000000000000"]),
    ],
)
def test_golden_orders(label: str, order: Order, frames: list[str]) -> None:
    sent = codec_of(TABLE.find(label)).order(5, order)
    digits = [f"{frame.arbitration_id:0{8 if frame.extended else 3}X}#{frame.data.hex().upper()}" for frame in sent]
    assert digits == frames


def test_neutral_is_not_quite_zero_torque() -> None:
    for label, torque_nm in (("AK80-9/V2", -0.0044), ("AK80-64/V2", -0.0352)):
        codec = codec_of(TABLE.find(label))
        decoded = codec.read_command(1, codec.command(1, NEUTRAL))
        assert isinstance(decoded, SetPoint)
        assert decoded.torque_nm == pytest.approx(torque_nm, abs=1e-4)


def within(motor: MotorModel, fractions: tuple[float, float, float, float, float]) -> SetPoint:
    """A set-point at these shares of the motor's ranges."""
    p, v, kp, kd, t = fractions
    return SetPoint(
        p * motor.position_rad,
        v * motor.velocity_rad_s,
        abs(kp) * motor.stiffness_nm_rad,
        abs(kd) * motor.damping_nm_s_rad,
        t * motor.torque_nm,
    )


def quanta(motor: MotorModel) -> tuple[float, ...]:
    """One step of each field."""
    fine = motor.protocol is WireProtocol.CYBERGEAR
    spans = (
        2 * motor.position_rad,
        2 * motor.velocity_rad_s,
        motor.stiffness_nm_rad,
        motor.damping_nm_s_rad,
        2 * motor.torque_nm,
    )
    bits = (16,) * 5 if fine else (16, 12, 12, 12, 12)
    return tuple(span / (2**width - 1) for span, width in zip(spans, bits, strict=True))


@given(motor=motors, fractions=st.tuples(shares, shares, shares, shares, shares))
def test_a_set_point_comes_through_at_most_one_quantum_low(
    motor: MotorModel, fractions: tuple[float, float, float, float, float]
) -> None:
    """The firmware's rule truncates, so what arrives is in (x - 1 quantum, x]: half a quantum about its middle."""
    codec = codec_of(motor)
    target = within(motor, fractions)
    decoded = codec.read_command(7, codec.command(7, target))
    assert isinstance(decoded, SetPoint)
    for sent, received, quantum in zip(target, decoded, quanta(motor), strict=True):
        middle = received + quantum / 2
        assert abs(sent - middle) <= quantum / 2 * (1 + 1e-4)


@given(motor=motors, wire=st.tuples(st.integers(0, 65535), *[st.integers(0, 4095)] * 4))
def test_what_was_decoded_encodes_to_the_same_bits(motor: MotorModel, wire: tuple[int, ...]) -> None:
    codec = codec_of(motor)
    word = (wire[0] << 48) | (wire[1] << 36) | (wire[2] << 24) | (wire[3] << 12) | wire[4]
    template = codec.command(7, NEUTRAL)
    frame = template._replace(data=word.to_bytes(8, "big"))
    decoded = codec.read_command(7, frame)
    if isinstance(decoded, SetPoint):
        assert codec.command(7, decoded) == frame


@given(
    motor=st.sampled_from([motor for motor in MOTORS if motor.protocol not in UPLOADING]),
    state=st.tuples(shares, shares, shares),
)
def test_a_reply_comes_through_at_most_one_quantum_low(motor: MotorModel, state: tuple[float, float, float]) -> None:
    codec = codec_of(motor)
    p, v, _, _, t = quanta(motor)
    reported = Reply(
        3, state[0] * motor.position_rad, state[1] * motor.velocity_rad_s, state[2] * motor.torque_nm, 40.0
    )
    frame = codec.reply(reported, 0, 0)
    decoded = codec.read_reply(frame)
    assert decoded is not None
    assert codec.replier(frame) == decoded.drive_id == 3
    pairs = ((reported[1], decoded[1], p), (reported[2], decoded[2], v), (reported[3], decoded[3], t))
    assert all(-1e-4 <= (sent - received) / quantum <= 1 + 1e-4 for sent, received, quantum in pairs)


@pytest.mark.parametrize("motor", COMMANDED, ids=lambda motor: motor.label)
def test_no_command_at_any_corner_collides_with_a_special_frame(motor: MotorModel) -> None:
    codec = codec_of(motor)
    top = max(quanta(motor)[2:4])
    for signs in product((-2.0, -1.0, 1.0 - 1e-7, 1.0, 2.0), repeat=5):
        frame = codec.command(1, within(motor, (signs[0], signs[1], signs[2], signs[3], signs[4])))
        assert mit.special_order(frame.data) is None or frame.extended
        assert frame.data[:7] != b"\xff" * 7 or frame.extended
        decoded = codec.read_command(1, frame)
        assert isinstance(decoded, SetPoint)
        assert decoded.damping_nm_s_rad <= motor.damping_nm_s_rad + top


@given(motor=motors, values=st.tuples(*[st.floats(allow_nan=False)] * 5))
def test_no_command_whatever_collides_with_a_special_frame(
    motor: MotorModel, values: tuple[float, float, float, float, float]
) -> None:
    frame = codec_of(motor).command(1, SetPoint(*values))
    assert frame.extended or frame.data[:7] != b"\xff" * 7
    assert len(frame.data) == 8


@pytest.mark.parametrize("motor", [motor for motor in MOTORS if motor.protocol is WireProtocol.AK_V3])
def test_the_first_power_on_asks_a_v3_drive_for_a_tenth_of_its_velocity_range(motor: MotorModel) -> None:
    """What docs/how-to/drives.md sends to find a wrong entry, as a drive of each entry reads it."""
    sent = re.findall(r"cansend can0 (\w{8})#(\w+)", Path("docs/how-to/drives.md").read_text(encoding="utf-8"))
    frames = [Frame(int(identifier, 16), bytes.fromhex(data), extended=True) for identifier, data in sent]
    turn, again, off = (codec_of(motor).read_command(2, frame) for frame in frames)
    assert isinstance(turn, SetPoint)
    assert (again, off) == (turn, Order.DISABLE)
    assert turn.velocity_rad_s == pytest.approx(motor.velocity_rad_s / 10, abs=quanta(motor)[1])
    assert turn.stiffness_nm_rad == 0.0
    assert turn.damping_nm_s_rad == pytest.approx(4.0)
    assert turn.torque_nm == pytest.approx(0.0, abs=quanta(motor)[4])


def test_beyond_the_range_is_the_end_of_the_range() -> None:
    scale = Scale(-8.0, 8.0, 12)
    assert (scale.to_wire(-9), scale.to_wire(9), scale.to_wire(math.inf)) == (0, 4095, 4095)
    assert scale.to_value(0) == pytest.approx(-8.0)
    assert scale.to_value(4095) == 8.0
    with pytest.raises(ValueError, match="NaN"):
        scale.to_wire(math.nan)


@pytest.mark.parametrize(
    ("label", "data", "temperature_c", "faults"),
    [
        ("AK80-6/V1", "02 7FFF 7FF 7FF", math.nan, DriveFault.NONE),
        ("mini-cheetah/bgkatz", "02 7FFF 7FF 7FF 60", math.nan, DriveFault.NONE),
        ("AK80-9/V2", "02 7FFF 7FF 7FF 2A 04", 42.0, DriveFault.UNDER_VOLTAGE),
        ("AK80-9/V2", "02 7FFF 7FF 7FF", math.nan, DriveFault.NONE),  # shorter than announced: still a state
        ("AK80-9/V2", "02 7FFF 7FF 7FF 2A 63", 42.0, DriveFault.OTHER),
    ],
)
def test_replies_of_six_seven_and_eight_bytes(label: str, data: str, temperature_c: float, faults: DriveFault) -> None:
    decoded = codec_of(TABLE.find(label)).read_reply(Frame(0, bytes.fromhex(data.replace(" ", ""))))
    assert decoded is not None
    assert decoded.drive_id == 2
    assert decoded.position_rad == pytest.approx(0, abs=0.01)
    assert decoded.temperature_c == pytest.approx(temperature_c, nan_ok=True)
    assert decoded.faults is faults


@pytest.mark.parametrize(
    ("status", "enabled", "faults"),
    [
        (0x0, False, DriveFault.NONE),
        (0x1, True, DriveFault.NONE),
        (0x8, False, DriveFault.OVER_VOLTAGE),
        (0x9, False, DriveFault.UNDER_VOLTAGE),
        (0xA, False, DriveFault.OVER_CURRENT),
        (0xB, False, DriveFault.OVER_TEMPERATURE),
        (0xC, False, DriveFault.OVER_TEMPERATURE),
        (0xD, False, DriveFault.LOST_COMMUNICATION),
        (0xE, False, DriveFault.OVERLOAD),
        (0x5, False, DriveFault.OTHER),
    ],
)
def test_damiao_status(status: int, enabled: bool, faults: DriveFault) -> None:
    frame = Frame(0x11, bytes((status << 4 | 1,)) + bytes.fromhex("7FFF7FF7FF1E28"))
    decoded = codec_of(TABLE.find("DM4310/default")).read_reply(frame)
    assert decoded is not None
    assert (decoded.drive_id, decoded.enabled, decoded.faults, decoded.temperature_c) == (1, enabled, faults, 40.0)


def test_damiao_registers_travel_as_little_endian() -> None:
    assert damiao.read_register(0x105, 21).data.hex(" ") == "05 01 33 15 00 00 00 00"
    reported = damiao.RegisterValue(5, damiao.Register.VELOCITY_MAX, 30.0)
    frame = damiao.pack_register(0x11, reported)
    assert frame.data.hex(" ") == "05 00 33 16 00 00 f0 41"
    assert damiao.register_reply(frame) == reported
    mode = damiao.RegisterValue(5, damiao.Register.CONTROL_MODE, 1.0)
    assert damiao.register_reply(damiao.pack_register(0x11, mode)) == mode


@pytest.mark.parametrize(
    ("bits", "faults"),
    [
        (0b000001, DriveFault.UNDER_VOLTAGE),
        (0b000010, DriveFault.OVER_CURRENT),
        (0b000100, DriveFault.OVER_TEMPERATURE),
        (0b001000, DriveFault.ENCODER),
        (0b000110, DriveFault.OVER_CURRENT | DriveFault.OVER_TEMPERATURE),
    ],
)
def test_cybergear_faults_and_mode_ride_in_the_identifier(bits: int, faults: DriveFault) -> None:
    identifier = (2 << 24) | (2 << 22) | (bits << 16) | (0x7F << 8) | 0xFD
    decoded = codec_of(TABLE.find("CyberGear/manual")).read_reply(
        Frame(identifier, bytes.fromhex("7FFF7FFF7FFF0101"), extended=True)
    )
    assert decoded is not None
    assert (decoded.drive_id, decoded.faults, decoded.enabled) == (0x7F, faults, True)
    assert decoded.temperature_c == pytest.approx(25.7)


def test_cybergear_identifiers_round_trip() -> None:
    packed = cybergear.pack_identifier(17, 0xABCD, 0x7F)
    assert packed == 0x11_ABCD_7F
    assert cybergear.unpack_identifier(packed) == (17, 0xABCD, 0x7F)


@given(motor=st.sampled_from(MOTORS), identifier=st.integers(0, 0x1FFFFFFF), data=st.binary(max_size=8))
def test_garbage_is_read_or_refused_but_never_raises(motor: MotorModel, identifier: int, data: bytes) -> None:
    codec = codec_of(motor)
    for frame in (Frame(identifier, data, extended=True), Frame(identifier & 0x7FF, data)):
        codec.replier(frame)
        decoded = codec.read_reply(frame)
        assert decoded is None or math.isfinite(decoded.position_rad)
        codec.read_command(identifier & 0x7F, frame)
        damiao.register_reply(frame)


@pytest.mark.parametrize("motor", MOTORS, ids=lambda motor: motor.label)
def test_replies_of_wrong_length_are_refused(motor: MotorModel) -> None:
    codec = codec_of(motor)
    good = codec.reply(Reply(3, 0.0, 0.0, 0.0, 20.0), 0, 0)
    allowed = {6, 7, 8} if motor.protocol is WireProtocol.MIT else {8}
    for length in set(range(9)) - allowed:
        assert codec.read_reply(good._replace(data=(good.data + bytes(8))[:length])) is None


def test_every_protocol_has_its_codec_and_a_motor() -> None:
    assert set(CODECS) == set(WireProtocol), "register the codec in CODECS, hal/joints/codecs/__init__.py"
    assert {motor.protocol for motor in MOTORS} == set(WireProtocol), "add its motor to hal/joints/motors.toml"


@pytest.mark.parametrize("motor", MOTORS, ids=lambda motor: motor.label)
def test_traits_are_those_of_the_frames(motor: MotorModel) -> None:
    codec = codec_of(motor)
    enabling = [codec.read_command(3, frame) for frame in codec.order(3, Order.ENABLE)]
    wrong = f"traits of {type(codec).__name__}"
    assert codec.traits.enabled_by_command is any(isinstance(asked, SetPoint) for asked in enabling), wrong
    assert codec.traits.read_only is (not enabling), wrong
    replies_standard = not codec.reply(Reply(3, 0.0, 0.0, 0.0), 0, 0).extended
    assert codec.traits.standard_replies or not replies_standard, wrong


@pytest.mark.parametrize("layout", list(ReplyLayout))
def test_every_layout_is_somebodys(layout: ReplyLayout) -> None:
    assert any(motor.reply is layout for motor in MOTORS)


def test_a_transmission_carries_ratio_and_sign_to_the_motor_and_back() -> None:
    """A motor that turns twice as far as its joint and the other way, with half the torque."""
    transmission = Transmission(ratio=-2.0, zero_offset_rad=0.25)
    at_joint, at_motor = SetPoint(0.75, 1.0, 40.0, 8.0, 6.0), SetPoint(-1.0, -2.0, 10.0, 2.0, -3.0)
    assert transmission.to_motor(at_joint) == at_motor
    assert transmission.to_joint(at_motor) == SetPoint(0.75, 1.0, 40.0, 8.0, 6.0)
    assert transmission.angle_to_motor(0.75) == -1.0
    assert transmission.angle_to_joint(-1.0) == 0.75
