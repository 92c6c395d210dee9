"""MIT (mini-cheetah) mode of CubeMars / T-Motor AK drives, firmware V1 and V2, and of bgkatz firmware.

Standard identifier = motor ID, 8 bytes out; 6, 7 or 8 bytes back, identified by data[0], not by the identifier.
Sources: bgkatz/motorcontrol Core/Src/can.c; CubeMars AK series manual V1.0.8, section 5.3.
"""

from __future__ import annotations

from typing import ClassVar

from hal.joints.codecs.wire import MIT_BITS, Frame, Order, Reply, Scales, SetPoint, Traits, raw_temperature
from hal.joints.motors import MotorModel, ReplyLayout

SPECIAL = {Order.ENABLE: 0xFC, Order.DISABLE: 0xFD, Order.ZERO: 0xFE, Order.CLEAR: 0xFB}
ORDER_OF = {code: order for order, code in SPECIAL.items()}
_SEVEN_FF = b"\xff" * 7
LENGTH_OF = {ReplyLayout.SHORT: 6, ReplyLayout.VOLTAGE: 7, ReplyLayout.TEMPERATURE: 8}


def pack_set_point(scales: Scales, target: SetPoint) -> bytes:
    """The 8 bytes of a set-point, never those of a special frame.

    Only every field at its maximum comes near seven FF; the damping is then one quantum lower (0.1 %), which
    is the field whose change moves nothing.
    """
    p, v, kp, kd, t = scales.to_wire(target)
    data = _pack(p, v, kp, kd, t)
    return data if data[:7] != _SEVEN_FF else _pack(p, v, kp, kd - 1, t)


def _pack(p: int, v: int, kp: int, kd: int, t: int) -> bytes:
    word = (p << 48) | (v << 36) | (kp << 24) | (kd << 12) | t
    return word.to_bytes(8, "big")


def unpack_set_point(scales: Scales, data: bytes) -> SetPoint:
    """The set-point in 8 bytes."""
    word = int.from_bytes(data, "big")
    return scales.to_value(word >> 48, (word >> 36) & 0xFFF, (word >> 24) & 0xFFF, (word >> 12) & 0xFFF, word & 0xFFF)


def special_order(data: bytes) -> Order | None:
    """The order in a special frame: seven FF and FC, FD, FE or FB."""
    return ORDER_OF.get(data[7]) if len(data) == 8 and data[:7] == _SEVEN_FF else None


def special_frame(drive_id: int, order: Order) -> Frame:
    """Seven FF and the order's byte."""
    return Frame(drive_id, _SEVEN_FF + bytes((SPECIAL[order],)))


def unpack_state(scales: Scales, data: bytes) -> tuple[float, float, float]:
    """Position, velocity and torque from bytes 1 to 5 of a reply."""
    word = int.from_bytes(data[1:6], "big")
    return (
        scales.position.to_value(word >> 24),
        scales.velocity.to_value((word >> 12) & 0xFFF),
        scales.torque.to_value(word & 0xFFF),
    )


def pack_state(scales: Scales, state: Reply) -> bytes:
    """Bytes 1 to 5 of a reply."""
    word = (
        (scales.position.to_wire(state.position_rad) << 24)
        | (scales.velocity.to_wire(state.velocity_rad_s) << 12)
        | scales.torque.to_wire(state.torque_nm)
    )
    return word.to_bytes(5, "big")


class MitCodec:
    """AK V1 and V2 and bgkatz drives."""

    traits: ClassVar = Traits(
        scan_name="MIT (AK V1/V2, bgkatz)",
        standard_replies=True,
        enabled_by_command=False,
        loses_zero=False,
        read_only=False,
    )

    def __init__(self, motor: MotorModel) -> None:
        self._motor = motor
        self._scales = Scales.of(motor, MIT_BITS)

    def command(self, drive_id: int, target: SetPoint) -> Frame:
        """The frame of a set-point."""
        return Frame(drive_id, pack_set_point(self._scales, target))

    def order(self, drive_id: int, order: Order) -> tuple[Frame, ...]:
        """The special frame of an order; these firmwares know no clearing of faults."""
        return () if order is Order.CLEAR else (special_frame(drive_id, order),)

    def replier(self, frame: Frame) -> int | None:
        """data[0]: the reply's identifier is the host's, usually 0, and identifies nothing."""
        return None if frame.extended or not frame.data else frame.data[0]

    def read_reply(self, frame: Frame) -> Reply | None:
        """A reply of 6, 7 (voltage, unused) or 8 bytes (temperature and error)."""
        data = frame.data
        if frame.extended or len(data) not in LENGTH_OF.values():
            return None
        position, velocity, torque = unpack_state(self._scales, data)
        if len(data) < 8 or self._motor.reply is not ReplyLayout.TEMPERATURE:
            return Reply(data[0], position, velocity, torque)
        temperature = data[6] - self._motor.temperature_offset_c
        return Reply(data[0], position, velocity, torque, temperature, self._motor.fault_of(data[7]))

    def read_command(self, drive_id: int, frame: Frame) -> SetPoint | Order | None:
        """What 8 bytes on the drive's own identifier ask."""
        if frame.extended or frame.arbitration_id != drive_id or len(frame.data) != 8:
            return None
        order = special_order(frame.data)
        return order if order is not None else unpack_set_point(self._scales, frame.data)

    def reply(self, state: Reply, reply_id: int, error_code: int) -> Frame:
        """The reply in the motor's own layout."""
        body = bytes((state.drive_id,)) + pack_state(self._scales, state)
        length = LENGTH_OF[self._motor.reply]
        if length == 7:
            body += b"\x60"  # bus voltage: 24 V in quarter volts
        elif length == 8:
            body += bytes((raw_temperature(self._motor, state, 0, 255), error_code & 0xFF))
        return Frame(reply_id, body)
