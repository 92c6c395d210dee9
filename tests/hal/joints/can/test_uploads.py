"""What CubeMars drives upload in servo mode and with V3 firmware: to the bit, and read-only."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.errors import DeviceFault
from hal.joints.codecs import codec_of
from hal.joints.codecs.wire import NEUTRAL, Frame, Order, Reply
from hal.joints.motors import MotorModel, WireProtocol, load_motors
from hal.joints.protocol import DriveFault
from tests.support.errors import refused

TABLE = load_motors()
UPLOADING = (WireProtocol.AK_V3, WireProtocol.SERVO)
shares = st.floats(-1.0, 1.0)


@given(
    motor=st.sampled_from([motor for motor in TABLE.entries.values() if motor.protocol in UPLOADING]),
    degrees=st.floats(-3000, 3000),
    speed=shares,
    torque=shares,
)
def test_an_upload_comes_through_within_half_a_quantum(
    motor: MotorModel, degrees: float, speed: float, torque: float
) -> None:
    codec = codec_of(motor)
    reported = Reply(9, math.radians(degrees), speed * motor.velocity_rad_s, torque * motor.torque_nm, 31.0)
    decoded = codec.read_reply(codec.reply(reported, 0, 2))
    assert decoded is not None
    erpm = 60 / math.tau * motor.pole_pairs * motor.gear_ratio
    ampere = motor.torque_constant_nm_a * motor.gear_ratio
    assert decoded.position_rad == pytest.approx(reported.position_rad, abs=math.radians(0.0501))
    assert decoded.velocity_rad_s == pytest.approx(reported.velocity_rad_s, abs=5.001 / erpm)
    limit = 327.67 * ampere
    assert decoded.torque_nm == pytest.approx(min(max(reported.torque_nm, -limit), limit), abs=0.006 * ampere)
    assert (decoded.drive_id, decoded.temperature_c, decoded.faults) == (9, 31.0, DriveFault.OVER_CURRENT)


def test_golden_upload() -> None:
    """0.1°, 10 electrical rpm, 0.01 A: 90°, 12600 erpm = 6.98 rad/s at 21 pole pairs and 1:9 … by hand."""
    frame = Frame(0x2907, bytes.fromhex("0384 04EC FF9C 1E 05"), extended=True)
    decoded = codec_of(TABLE.find("AK80-9/servo")).read_reply(frame)
    assert decoded is not None
    assert decoded.drive_id == 7
    assert decoded.position_rad == pytest.approx(math.pi / 2)
    assert decoded.velocity_rad_s == pytest.approx(12600 / (21 * 9) * math.tau / 60)
    assert decoded.torque_nm == pytest.approx(-1.0 * 0.091 * 9)
    assert decoded.temperature_c == 30.0
    assert decoded.faults is DriveFault.ENCODER


def test_servo_mode_is_read_only() -> None:
    codec = codec_of(TABLE.find("AK80-9/servo"))
    with refused(DeviceFault.SERVO_MODE):
        codec.command(1, NEUTRAL)
    assert [codec.order(1, order) for order in Order] == [()] * len(Order)
