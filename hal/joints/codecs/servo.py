"""CubeMars servo mode, read-only: the status that a drive uploads by itself, 1 to 500 times a second.

Extended identifier (0x29 << 8) | id; int16 × 0.1°, int16 × 10 electrical rpm, int16 × 0.01 A, temperature, error.
Source: CubeMars AK series manual V1.0.8, section 5.1 (upload); driving by servo mode is not offered.
"""

from __future__ import annotations

import math
import struct

from hal.errors import HardwareError
from hal.joints.codecs.wire import Frame, Order, Reply, SetPoint
from hal.joints.motors import MotorModel

UPLOAD = 0x29
_BODY = struct.Struct(">hhhbB")


def upload_id(drive_id: int) -> int:
    """The extended identifier of a drive's upload."""
    return (UPLOAD << 8) | drive_id


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
    warmth = 0.0 if math.isnan(state.temperature_c) else state.temperature_c
    data = _BODY.pack(
        _int16(math.degrees(state.position_rad) * 10),
        _int16(state.velocity_rad_s * _electrical_rpm(motor) / 10),
        _int16(state.torque_nm / _torque_per_ampere(motor) * 100),
        min(max(round(warmth + motor.temperature_offset_c), -128), 127),
        error_code & 0xFF,
    )
    return Frame(upload_id(state.drive_id), data, extended=True)


class ServoCodec:
    """Reads a drive that is set to servo mode; commanding one is refused with what to do."""

    def __init__(self, motor: MotorModel) -> None:
        self._motor = motor

    def command(self, drive_id: int, _target: SetPoint) -> Frame:
        """Raises HardwareError: servo mode knows no impedance law."""
        raise HardwareError(
            f"Drive {drive_id} ({self._motor.label}) is in servo mode, which is read-only here; "
            f"set the drive to MIT mode with the maker's tool and name its MIT entry in the device description."
        )

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
