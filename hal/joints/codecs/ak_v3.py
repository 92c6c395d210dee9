"""Force-control (MIT) mode of CubeMars AK drives with V3 firmware.

Extended identifier (8 << 8) | id; gains come first: kp, kd, p, v, t. The drive answers with the servo upload
(0x2900 | id); early V3 firmware with the 8-byte reply of V2, which is accepted too. V3 has no special frames: a drive
is enabled by its first force-control command, disabled by a current of 0 A (servo mode 1), zeroed by mode 5.
"""

from __future__ import annotations

from hal.joints.codecs.mit import unpack_state
from hal.joints.codecs.servo import pack_upload, read_upload, upload_replier
from hal.joints.codecs.wire import MIT_BITS, NEUTRAL, Frame, Order, Reply, Scales, SetPoint
from hal.joints.motors import MotorModel

_CURRENT, _ORIGIN, _FORCE = 1, 5, 8
_ZERO_AMPERE = b"\x00\x00\x00\x00"
_TEMPORARY = b"\x00"  # origin until power-off; permanent ones belong to the maker's tool


def _identifier(mode: int, drive_id: int) -> int:
    return (mode << 8) | drive_id


class AkV3Codec:
    """AK drives, V3 firmware."""

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
