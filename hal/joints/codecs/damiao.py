"""Damiao DM drives: MIT packing out, status nibble and two temperatures back, registers through 0x7FF.

Sources: Damiao DM-J4310 manual; huggingface/lerobot motors/damiao (tables and register numbers).
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import ClassVar, NamedTuple

from hal.joints.codecs.mit import MitCodec, pack_state, special_frame
from hal.joints.codecs.mit import unpack_state as unpack_mit_state
from hal.joints.codecs.wire import Frame, Order, Reply, Traits, raw_temperature
from hal.joints.protocol import DriveFault

REGISTER_ID = 0x7FF
READ, WRITE, REFRESH = 0x33, 0x55, 0xCC
_ENABLED = 1
_HEALTHY = (0, _ENABLED)


class Register(IntEnum):
    """Register numbers that this program reads."""

    MASTER_ID = 7
    DRIVE_ID = 8
    TIMEOUT = 9  # in 50 µs
    CONTROL_MODE = 10  # 1 = MIT
    POSITION_MAX = 21
    VELOCITY_MAX = 22
    TORQUE_MAX = 23


FLOAT_REGISTERS = frozenset({Register.POSITION_MAX, Register.VELOCITY_MAX, Register.TORQUE_MAX})
MIT_MODE = 1


class RegisterValue(NamedTuple):
    """A register as a drive reported it."""

    drive_id: int
    register: int
    value: float


def read_register(drive_id: int, register: int) -> Frame:
    """Requests a register."""
    return Frame(REGISTER_ID, bytes((drive_id & 0xFF, drive_id >> 8, READ, register, 0, 0, 0, 0)))


def register_reply(frame: Frame) -> RegisterValue | None:
    """A register's value from a reply, or None when it is none.

    A status reply can look alike; ask only while a register is awaited.
    """
    data = frame.data
    if frame.extended or len(data) != 8 or data[2] not in (READ, WRITE) or frame.arbitration_id == REGISTER_ID:
        return None
    form = "<f" if data[3] in FLOAT_REGISTERS else "<I"
    return RegisterValue(data[0] | (data[1] << 8), data[3], float(struct.unpack(form, data[4:])[0]))


def register_owner(frame: Frame) -> int | None:
    """The drive whose register a frame asks for, writes or reports; None when it concerns no register known here."""
    data = frame.data
    if frame.extended or len(data) < 4:
        return None
    if frame.arbitration_id != REGISTER_ID and (register_reply(frame) is None or data[3] not in set(Register)):
        return None
    return data[0] | (data[1] << 8)


def pack_register(reply_id: int, value: RegisterValue, action: int = READ) -> Frame:
    """The drive's end: the reply that reports a register, to a read or to a write."""
    number = value.value if value.register in FLOAT_REGISTERS else int(value.value)
    form = "<f" if value.register in FLOAT_REGISTERS else "<I"
    head = bytes((value.drive_id & 0xFF, value.drive_id >> 8, action, value.register))
    return Frame(reply_id, head + struct.pack(form, number))


class DamiaoCodec(MitCodec):
    """DM drives in MIT mode: packed and read as MIT, with other orders and replies."""

    traits: ClassVar = Traits(
        scan_name="Damiao",
        standard_replies=True,
        enabled_by_command=False,
        loses_zero=False,
        read_only=False,
    )

    def order(self, drive_id: int, order: Order) -> tuple[Frame, ...]:
        """The special frame of an order, clearing faults included."""
        return (special_frame(drive_id, order),)

    def replier(self, frame: Frame) -> int | None:
        """The low nibble of data[0]; identifiers above 15 are identified by their MST_ID (the driver's router)."""
        return None if frame.extended or not frame.data else frame.data[0] & 0x0F

    def read_reply(self, frame: Frame) -> Reply | None:
        """A status reply of 8 bytes; the hotter of the two temperatures counts."""
        data = frame.data
        if frame.extended or len(data) != 8:
            return None
        status = data[0] >> 4
        position, velocity, torque = unpack_mit_state(self._scales, data)
        faults = DriveFault.NONE if status in _HEALTHY else self._motor.fault_of(status)
        temperature = max(data[6], data[7]) - self._motor.temperature_offset_c
        return Reply(data[0] & 0x0F, position, velocity, torque, temperature, faults, status == _ENABLED)

    def reply(self, state: Reply, reply_id: int, error_code: int) -> Frame:
        """A status reply; an error code takes the place of enabled and disabled."""
        status = error_code if error_code else int(bool(state.enabled))
        raw = raw_temperature(self._motor, state, 0, 255)
        head = bytes((((status & 0x0F) << 4) | (state.drive_id & 0x0F),))
        return Frame(reply_id, head + pack_state(self._scales, state) + bytes((raw, raw)))
