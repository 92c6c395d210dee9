"""CubeMars AK drives with V3 firmware, and servo mode, read-only.

Servo mode: the status that a drive uploads by itself, 1 to 500 times a second. Extended identifier (0x29 << 8) | id;
int16 × 0.1°, int16 × 10 electrical rpm, int16 × 0.01 A, temperature, error. Driving by servo mode is not offered.
Source: CubeMars AK series manual V1.0.8, section 5.1.

V3 force control (MIT): extended identifier (8 << 8) | id; gains come first: kp, kd, p, v, t. The drive answers with the
servo upload; early V3 firmware with the 8-byte reply of V2, which is accepted too. V3 has no special frames: a drive is
enabled by its first force-control command, disabled by a current of 0 A (servo mode 1), zeroed by mode 5.
"""

from __future__ import annotations

import math
import struct
from typing import ClassVar

from hal.errors import DeviceFault, HardwareError
from hal.joints.codecs.mit import unpack_state
from hal.joints.codecs.wire import MIT_BITS, NEUTRAL, Frame, Order, Reply, Scales, SetPoint, Traits, raw_temperature
from hal.joints.motors import MotorModel

UPLOAD = 0x29
_BODY = struct.Struct(">hhhbB")
_SCAN_NAME = "AK V3 / servo"  # one question finds both


def _identifier(mode: int, drive_id: int) -> int:
    return (mode << 8) | drive_id


def upload_replier(frame: Frame) -> int | None:
    """Whose upload a frame is."""
    return frame.arbitration_id & 0xFF if frame.extended and frame.arbitration_id >> 8 == UPLOAD else None


def _electrical_rpm(motor: MotorModel) -> float:
    """Electrical revolutions a minute for one rad/s at the output."""
    return 60.0 / math.tau * motor.pole_pairs * motor.gear_ratio


def _torque_per_ampere(motor: MotorModel) -> float:
    return motor.torque_constant_nm_a * motor.gear_ratio


def read_upload(motor: MotorModel, frame: Frame) -> Reply | None:
    """An upload decoded with the motor's pole pairs, gear ratio and torque constant."""
    drive_id = upload_replier(frame)
    if drive_id is None or len(frame.data) != _BODY.size:
        return None
    degrees10, erpm10, ampere100, warmth, error = _BODY.unpack(frame.data)
    return Reply(
        drive_id,
        math.radians(degrees10 / 10),
        erpm10 * 10 / _electrical_rpm(motor),
        ampere100 / 100 * _torque_per_ampere(motor),
        float(warmth) - motor.temperature_offset_c,
        motor.fault_of(error),
    )


def _int16(value: float) -> int:
    return min(max(round(value), -0x8000), 0x7FFF)


def pack_upload(motor: MotorModel, state: Reply, error_code: int) -> Frame:
    """The upload that reports `state`."""
    data = _BODY.pack(
        _int16(math.degrees(state.position_rad) * 10),
        _int16(state.velocity_rad_s * _electrical_rpm(motor) / 10),
        _int16(state.torque_nm / _torque_per_ampere(motor) * 100),
        raw_temperature(motor, state, -128, 127),
        error_code & 0xFF,
    )
    return Frame(_identifier(UPLOAD, state.drive_id), data, extended=True)


class ServoCodec:
    """Reads a drive that is set to servo mode; commanding one is refused."""

    traits: ClassVar = Traits(
        scan_name=_SCAN_NAME,
        standard_replies=False,
        enabled_by_command=False,
        loses_zero=False,
        read_only=True,
    )

    def __init__(self, motor: MotorModel) -> None:
        self._motor = motor

    def command(self, drive_id: int, _target: SetPoint) -> Frame:
        """Raises HardwareError: servo mode knows no impedance law."""
        raise HardwareError(DeviceFault.SERVO_MODE, can_id=drive_id, motor=self._motor.label)

    def order(self, _drive_id: int, _order: Order) -> tuple[Frame, ...]:
        """None: read-only."""
        return ()

    def replier(self, frame: Frame) -> int | None:
        """The upload's low byte."""
        return upload_replier(frame)

    def read_reply(self, frame: Frame) -> Reply | None:
        """The upload decoded."""
        return read_upload(self._motor, frame)

    def read_command(self, _drive_id: int, _frame: Frame) -> SetPoint | Order | None:
        """None: an emulated servo drive only uploads."""
        return None

    def reply(self, state: Reply, _reply_id: int, error_code: int) -> Frame:
        """The upload."""
        return pack_upload(self._motor, state, error_code)


_CURRENT, _ORIGIN, _FORCE = 1, 5, 8
_ZERO_AMPERE = b"\x00\x00\x00\x00"
_TEMPORARY = b"\x00"  # origin until power-off; permanent ones belong to the maker's tool


class AkV3Codec:
    """AK drives, V3 firmware."""

    traits: ClassVar = Traits(
        scan_name=_SCAN_NAME,
        standard_replies=True,
        enabled_by_command=True,
        loses_zero=True,
        read_only=False,
    )

    def __init__(self, motor: MotorModel) -> None:
        self._motor = motor
        self._scales = Scales.of(motor, MIT_BITS)

    def command(self, drive_id: int, target: SetPoint) -> Frame:
        """The force-control frame of a set-point."""
        p, v, kp, kd, t = self._scales.to_wire(target)
        word = (kp << 52) | (kd << 40) | (p << 24) | (v << 12) | t
        return Frame(_identifier(_FORCE, drive_id), word.to_bytes(8, "big"), extended=True)

    def order(self, drive_id: int, order: Order) -> tuple[Frame, ...]:
        """Enable: a neutral command; disable: zero current; zero: origin."""
        if order is Order.ENABLE:
            return (self.command(drive_id, NEUTRAL),)
        if order is Order.DISABLE:
            return (Frame(_identifier(_CURRENT, drive_id), _ZERO_AMPERE, extended=True),)
        if order is Order.ZERO:
            return (Frame(_identifier(_ORIGIN, drive_id), _TEMPORARY, extended=True),)
        return ()

    def replier(self, frame: Frame) -> int | None:
        """The upload's low byte, or data[0] of a V2-like reply."""
        if frame.extended:
            return upload_replier(frame)
        return frame.data[0] if len(frame.data) == 8 else None

    def read_reply(self, frame: Frame) -> Reply | None:
        """An upload, or a V2-like reply of 8 bytes."""
        if frame.extended:
            return read_upload(self._motor, frame)
        if len(frame.data) != 8:
            return None
        position, velocity, torque = unpack_state(self._scales, frame.data)
        temperature = frame.data[6] - self._motor.temperature_offset_c
        return Reply(frame.data[0], position, velocity, torque, temperature, self._motor.fault_of(frame.data[7]))

    def read_command(self, drive_id: int, frame: Frame) -> SetPoint | Order | None:
        """What an extended frame in one of the three modes asks."""
        if not frame.extended or frame.arbitration_id & 0xFF != drive_id:
            return None
        mode = frame.arbitration_id >> 8
        if mode == _FORCE and len(frame.data) == 8:
            return self._set_point(int.from_bytes(frame.data, "big"))
        if mode == _CURRENT and frame.data == _ZERO_AMPERE:
            return Order.DISABLE
        if mode == _ORIGIN and len(frame.data) == 1:
            return Order.ZERO
        return None

    def _set_point(self, word: int) -> SetPoint:
        return self._scales.to_value(
            (word >> 24) & 0xFFFF, (word >> 12) & 0xFFF, word >> 52, (word >> 40) & 0xFFF, word & 0xFFF
        )

    def reply(self, state: Reply, _reply_id: int, error_code: int) -> Frame:
        """The upload."""
        return pack_upload(self._motor, state, error_code)
