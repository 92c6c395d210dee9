"""Xiaomi CyberGear: extended identifier = type[28:24] ‖ data[23:8] ‖ target[7:0], big-endian u16 in the data.

Source: Xiaomi CyberGear manual V1.2, section 4. The drive reports fault bits and its mode in the identifier.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import ClassVar, NamedTuple

from hal.joints.codecs.wire import Frame, Order, Reply, Scales, SetPoint, Traits, raw_temperature
from hal.joints.motors import MotorModel

HOST_ID = 0xFD  # the manual's example; any drive answers to whoever asked
_BITS = (16, 16, 16, 16, 16)
_FIELDS = struct.Struct(">HHHH")
_RUN_MODE = 2
TIMEOUT_PARAMETER = 0x200C  # CAN_TIMEOUT, in 50 µs; 0 = off, the default
POSITION_PARAMETER = 0x7019
VELOCITY_PARAMETER = 0x701B
SUPPLY_PARAMETER = 0x701C  # volts
RUN_MODE_PARAMETER = 0x7005  # 0 = operation control, the MIT law


class Kind(IntEnum):
    """Communication types."""

    WHO = 0
    CONTROL = 1
    FEEDBACK = 2
    ENABLE = 3
    STOP = 4
    ZERO = 6
    READ_PARAMETER = 17
    WRITE_PARAMETER = 18
    EMERGENCY_STOP = 20  # not in the manual; python-cybergear 0.1.2 sends it, by the maker's tool's traffic


class Identifier(NamedTuple):
    """The three fields of the extended identifier."""

    kind: int
    field: int
    target: int


def pack_identifier(kind: int, field: int, target: int) -> int:
    """The 29 bits."""
    return (kind << 24) | ((field & 0xFFFF) << 8) | (target & 0xFF)


def unpack_identifier(arbitration_id: int) -> Identifier:
    """The three fields."""
    return Identifier((arbitration_id >> 24) & 0x1F, (arbitration_id >> 8) & 0xFFFF, arbitration_id & 0xFF)


def _frame(kind: Kind, drive_id: int, data: bytes = bytes(8)) -> Frame:
    return Frame(pack_identifier(kind, HOST_ID, drive_id), data, extended=True)


def who(drive_id: int) -> Frame:
    """Asks a drive for its unique number; the answer has type 0 and target 0xFE."""
    return _frame(Kind.WHO, drive_id)


def operation_control(drive_id: int) -> Frame:
    """Chooses the MIT law (run mode 0)."""
    return _frame(Kind.WRITE_PARAMETER, drive_id, struct.pack("<HHI", RUN_MODE_PARAMETER, 0, 0))


_ORDERS = {
    Order.DISABLE: (Kind.STOP, bytes(8)),
    Order.ZERO: (Kind.ZERO, b"\x01" + bytes(7)),
    Order.CLEAR: (Kind.STOP, b"\x01" + bytes(7)),
}


class CyberGearCodec:
    """CyberGear drives in operation-control mode."""

    traits: ClassVar = Traits(
        scan_name="CyberGear",
        standard_replies=False,
        enabled_by_command=False,
        loses_zero=True,
        read_only=False,
    )

    def __init__(self, motor: MotorModel) -> None:
        self._motor = motor
        self._scales = Scales.of(motor, _BITS)

    def command(self, drive_id: int, target: SetPoint) -> Frame:
        """Type 1: the torque rides in the identifier."""
        p, v, kp, kd, t = self._scales.to_wire(target)
        return Frame(pack_identifier(Kind.CONTROL, t, drive_id), _FIELDS.pack(p, v, kp, kd), extended=True)

    def order(self, drive_id: int, order: Order) -> tuple[Frame, ...]:
        """The frames of an order; enabling chooses the MIT law first."""
        if order is Order.ENABLE:
            return (operation_control(drive_id), _frame(Kind.ENABLE, drive_id))
        return (_frame(_ORDERS[order][0], drive_id, _ORDERS[order][1]),)

    def replier(self, frame: Frame) -> int | None:
        """Bits 15 to 8 of a type 2 identifier."""
        kind, field, _ = unpack_identifier(frame.arbitration_id)
        return field & 0xFF if frame.extended and kind == Kind.FEEDBACK else None

    def read_reply(self, frame: Frame) -> Reply | None:
        """Type 2: state in the data, faults and mode in the identifier."""
        kind, field, _ = unpack_identifier(frame.arbitration_id)
        if not frame.extended or kind != Kind.FEEDBACK or len(frame.data) != 8:
            return None
        p, v, t, warmth = _FIELDS.unpack(frame.data)
        return Reply(
            field & 0xFF,
            self._scales.position.to_value(p),
            self._scales.velocity.to_value(v),
            self._scales.torque.to_value(t),
            warmth / 10 - self._motor.temperature_offset_c,
            self._motor.fault_bits((field >> 8) & 0x3F),
            (field >> 14) & 0b11 == _RUN_MODE,
        )

    def read_command(self, drive_id: int, frame: Frame) -> SetPoint | Order | None:
        """What an extended frame to this target asks."""
        kind, field, target = unpack_identifier(frame.arbitration_id)
        if not frame.extended or target != drive_id or len(frame.data) != 8:
            return None
        if kind == Kind.CONTROL:
            p, v, kp, kd = _FIELDS.unpack(frame.data)
            return self._scales.to_value(p, v, kp, kd, field)
        if kind == Kind.EMERGENCY_STOP:
            return Order.DISABLE
        if kind == Kind.STOP:
            return Order.CLEAR if frame.data[0] == 1 else Order.DISABLE
        if kind == Kind.ZERO:
            return Order.ZERO if frame.data[0] == 1 else None
        return Order.ENABLE if kind == Kind.ENABLE else None

    def reply(self, state: Reply, reply_id: int, error_code: int) -> Frame:
        """Type 2; `error_code` holds the six fault bits, `reply_id` the host."""
        mode = _RUN_MODE if state.enabled else 0
        field = (mode << 14) | ((error_code & 0x3F) << 8) | (state.drive_id & 0xFF)
        data = _FIELDS.pack(
            self._scales.position.to_wire(state.position_rad),
            self._scales.velocity.to_wire(state.velocity_rad_s),
            self._scales.torque.to_wire(state.torque_nm),
            raw_temperature(self._motor, state, 0, 0xFFFF, per_degree=10),
        )
        return Frame(pack_identifier(Kind.FEEDBACK, field, (reply_id or HOST_ID) & 0xFF), data, extended=True)
