"""One emulated drive: what its firmware does with a frame, with silence, and with faults.

Quirks follow the motor entry: it holds its last command for ever or goes limp after its watchdog's time, it ignores
"set zero" in motor mode unless the entry says otherwise, and it replays its last command on enabling.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

import msgspec

from hal.joints.codecs import codec_of, cybergear, damiao
from hal.joints.codecs.wire import NEUTRAL, Codec, Frame, Order, Reply, SetPoint
from hal.joints.device import ROOM_C, JointDevice
from hal.joints.emulator.faults import Fault
from hal.joints.emulator.plant import Motion
from hal.joints.motors import MotorModel, OnTimeout, Watchdog, WireProtocol

CYBERGEAR_ID_REPLY = 0xFE
_DAMIAO_LOST = 0xD
_SUPPLY_V = 24.0
_PARAMETER = struct.Struct("<H2x4s")  # index, value
AT_REST = Motion(0.0, 0.0, 0.0, ROOM_C)


class EmulatedDrive:
    """Frames in, frames out; between them `effective` is the motor's law for the plant."""

    def __init__(self, device: JointDevice, model: MotorModel) -> None:
        self.device = device
        self.model = model
        self.state = AT_REST
        self.motor_mode = False
        self.error_code = 0
        self.zero_rad = 0.0
        self.silent = self.garbage = self.duplicate = self.ignores_zero = False
        self.answers_as: int | None = None
        self.late_ns = 0
        self.temperature_c: float | None = None
        self._codec: Codec = codec_of(model)
        self._extended = model.protocol not in (WireProtocol.MIT, WireProtocol.DAMIAO)
        self._target = NEUTRAL
        self._received_ns = 0
        self._host = 0
        self._registers = _registers(device, model)
        self._parameters: dict[int, bytes] = {}

    def inject(self, fault: Fault, value: float) -> None:
        """Inject a fault (those of the whole bus are the emulator's)."""
        _INJECT[fault](self, value)

    def accepts(self, frame: Frame) -> bool:
        """Whether the identifier can mean this drive: its own, or the one that Damiao drives share."""
        if self._extended:
            return frame.extended and frame.arbitration_id & 0xFF == self.device.can_id
        return not frame.extended and frame.arbitration_id in (self.device.can_id, damiao.REGISTER_ID)

    def receive(self, frame: Frame, now_ns: int) -> list[Frame]:
        """What the drive answers to a frame; nothing when it isn't meant."""
        if self.silent:
            return []
        answer = self._answer_question(frame)
        if answer is not None:
            return answer
        asked = self._codec.read_command(self.device.can_id, frame)
        if asked is None:
            return []
        self._received_ns = now_ns
        self._note_host(frame)
        self._execute(asked)
        return self._reports()

    def upload(self) -> list[Frame]:
        """What a drive in servo mode sends by itself."""
        return [] if self.silent or self.model.protocol is not WireProtocol.SERVO else self._reports()

    def effective(self, now_ns: int) -> SetPoint:
        """The set-point the motor follows now, with its own zero; NEUTRAL when it is off."""
        watchdog = self.model.watchdog
        if watchdog.on_silence is OnTimeout.LIMPS and watchdog.after_ms > 0 and self.motor_mode:
            self._watch(now_ns, int(watchdog.after_ms * 1e6))
        if not self.motor_mode:
            return NEUTRAL
        return self._target._replace(position_rad=self._target.position_rad + self.zero_rad)

    def _watch(self, now_ns: int, limit_ns: int) -> None:
        if now_ns - self._received_ns <= limit_ns:
            return
        self._target = NEUTRAL
        if self.model.protocol is WireProtocol.DAMIAO:
            self.fail(_DAMIAO_LOST)

    def _execute(self, asked: SetPoint | Order) -> None:
        if isinstance(asked, SetPoint):
            self._target = asked
            if self._codec.traits.enabled_by_command and not self.error_code:
                self.motor_mode = True
        elif asked is Order.ENABLE:
            self.motor_mode = not self.error_code
        elif asked is Order.DISABLE:
            self.motor_mode = False
        elif asked is Order.CLEAR:
            self.error_code, self.motor_mode = 0, False
        elif (self.model.zero_in_motor_mode or not self.motor_mode) and not self.ignores_zero:
            self.zero_rad = self.state.position_rad

    def _reports(self) -> list[Frame]:
        drive_id = self.device.can_id if self.answers_as is None else self.answers_as
        temperature = self.state.temperature_c if self.temperature_c is None else self.temperature_c
        report = Reply(
            drive_id,
            self.state.position_rad - self.zero_rad,
            self.state.velocity_rad_s,
            self.state.torque_nm,
            temperature,
            enabled=self.motor_mode,
        )
        frame = self._codec.reply(report, self.device.reply_id or self._host, self.error_code)
        if self.garbage:
            frame = frame._replace(data=frame.data[:3])
        return [frame, frame] if self.duplicate else [frame]

    def _note_host(self, frame: Frame) -> None:
        if self.model.protocol is not WireProtocol.CYBERGEAR:
            return
        identifier = cybergear.unpack_identifier(frame.arbitration_id)
        if identifier.kind != cybergear.Kind.CONTROL:
            self._host = identifier.field & 0xFF

    def _answer_question(self, frame: Frame) -> list[Frame] | None:
        if self.model.protocol is WireProtocol.DAMIAO and frame.arbitration_id == damiao.REGISTER_ID:
            return self._answer_register(frame)
        if self.model.protocol is WireProtocol.CYBERGEAR and frame.extended:
            return self._answer_parameter(frame)
        return None

    def _answer_register(self, frame: Frame) -> list[Frame]:
        data = frame.data
        if len(data) < 4 or data[0] | (data[1] << 8) != self.device.can_id:
            return []  # questions have four bytes that count; some drivers send no more
        action, register = data[2], data[3]
        if action == damiao.REFRESH:
            return self._reports()
        if action == damiao.WRITE and len(data) != 8:
            return []
        if action == damiao.WRITE:
            form = "<f" if register in damiao.FLOAT_REGISTERS else "<I"
            self._registers[register] = float(struct.unpack(form, data[4:])[0])
            if register == damiao.Register.TIMEOUT:
                self._set_watchdog(self._registers[register])
        if action in (damiao.READ, damiao.WRITE) and register in self._registers:
            value = damiao.RegisterValue(self.device.can_id, register, self._registers[register])
            return [damiao.pack_register(self.device.reply_id, value, action)]
        return []

    def _answer_parameter(self, frame: Frame) -> list[Frame] | None:
        kind, field, target = cybergear.unpack_identifier(frame.arbitration_id)
        if target != self.device.can_id:
            return None
        if kind == cybergear.Kind.WHO:
            identifier = cybergear.pack_identifier(cybergear.Kind.WHO, target, CYBERGEAR_ID_REPLY)
            return [Frame(identifier, target.to_bytes(8, "big"), extended=True)]
        if kind == cybergear.Kind.WRITE_PARAMETER and len(frame.data) == 8:
            self._note_host(frame)
            self._write_parameter(*_PARAMETER.unpack(frame.data))
            return self._reports()
        if kind == cybergear.Kind.READ_PARAMETER and len(frame.data) == 8:
            index, _ = _PARAMETER.unpack(frame.data)
            identifier = cybergear.pack_identifier(kind, target, field & 0xFF)
            return [Frame(identifier, _PARAMETER.pack(index, self._parameter(index)), extended=True)]
        return None

    def _write_parameter(self, index: int, value: bytes) -> None:
        self._parameters[index] = value
        if index == cybergear.TIMEOUT_PARAMETER:
            self._set_watchdog(float(int.from_bytes(value, "little")))

    def _parameter(self, index: int) -> bytes:
        measured = {
            cybergear.POSITION_PARAMETER: self.state.position_rad - self.zero_rad,
            cybergear.VELOCITY_PARAMETER: self.state.velocity_rad_s,
            cybergear.SUPPLY_PARAMETER: _SUPPLY_V,
        }
        if index in measured:
            return struct.pack("<f", measured[index])
        return self._parameters.get(index, bytes(4))

    def _set_watchdog(self, ticks: float) -> None:
        """Damiao and CyberGear count their watchdog in 50 µs; 0 turns it off."""
        watchdog = Watchdog(on_silence=OnTimeout.LIMPS if ticks else OnTimeout.HOLDS, after_ms=ticks / 20)
        self.model = msgspec.structs.replace(self.model, watchdog=watchdog)

    def fail(self, code: float) -> None:
        """Report this error code and give no torque."""
        self.error_code, self.motor_mode = int(code), False

    def rescale(self, share: float) -> None:
        """Scale velocity on the wire by this share of the table's range."""
        other = msgspec.structs.replace(self.model, velocity_rad_s=self.model.velocity_rad_s * share)
        self._codec = codec_of(other)
        self._registers = _registers(self.device, other)

    def heal(self) -> None:
        """All faults end; motor mode stays off where a fault ended it."""
        self.silent = self.garbage = self.duplicate = self.ignores_zero = False
        self.error_code = self.late_ns = 0
        self.answers_as = self.temperature_c = None
        self._codec = codec_of(self.model)
        self._registers = _registers(self.device, self.model)


def _registers(device: JointDevice, model: MotorModel) -> dict[int, float]:
    return {
        damiao.Register.MASTER_ID: float(device.reply_id),
        damiao.Register.DRIVE_ID: float(device.can_id),
        damiao.Register.TIMEOUT: model.watchdog.after_ms * 20,
        damiao.Register.CONTROL_MODE: float(damiao.MIT_MODE),
        damiao.Register.POSITION_MAX: model.position_rad,
        damiao.Register.VELOCITY_MAX: model.velocity_rad_s,
        damiao.Register.TORQUE_MAX: model.torque_nm,
    }


def _set(name: str, *, convert: Callable[[float], object]) -> Callable[[EmulatedDrive, float], None]:
    return lambda drive, value: setattr(drive, name, convert(value))


_INJECT: dict[Fault, Callable[[EmulatedDrive, float], None]] = {
    Fault.SILENT: _set("silent", convert=lambda _: True),
    Fault.ERROR: EmulatedDrive.fail,
    Fault.LATE: _set("late_ns", convert=lambda ms: int(ms * 1e6)),
    Fault.WRONG_ID: _set("answers_as", convert=int),
    Fault.WRONG_RANGE: EmulatedDrive.rescale,
    Fault.DUPLICATE: _set("duplicate", convert=lambda _: True),
    Fault.GARBAGE: _set("garbage", convert=lambda _: True),
    Fault.DISABLED: _set("motor_mode", convert=lambda _: False),
    Fault.HOT: _set("temperature_c", convert=float),
    Fault.HEALED: lambda drive, _: drive.heal(),
}
