"""One drive seen from the host, and which drive a received frame comes from."""

from __future__ import annotations

import math
from collections import Counter, deque

from hal.joints.can.reply_checks import RangeCheck, RequestTracker
from hal.joints.codecs import codec_of, damiao
from hal.joints.codecs.wire import NEUTRAL, Codec, Frame, Order, Reply, SetPoint, Transmission
from hal.joints.device import JointDevice
from hal.joints.motors import MotorModel, WireProtocol
from hal.joints.protocol import BusFault, DriveFault, Joint


class Station:
    """A drive's commands out and replies in. Angles here are at the joint."""

    def __init__(self, joint: Joint, device: JointDevice, model: MotorModel) -> None:
        self.joint = joint
        self.device = device
        self.model = model
        self.codec = codec_of(model)
        self.transmission = Transmission.of(device)
        self.position_rad = self.velocity_rad_s = self.torque_nm = 0.0
        self.temperature_c = math.nan
        self.measured_ns = 0
        self.faults = DriveFault.NONE
        self.enabled: bool | None = None
        self.latched = DriveFault.NONE  # every fault since opening
        self.answered = 0
        self.ledger = RequestTracker()
        self.watch = RangeCheck()
        self._recent: deque[bytes] = deque(maxlen=8)

    @property
    def name(self) -> str:
        """For people: "left knee (drive 2, AK80-64/V2)"."""
        return f"{self.joint.name.lower().replace('_', ' ')} (drive {self.device.can_id}, {self.model.label})"

    @property
    def short_name(self) -> str:
        """For tables: "left knee"."""
        return self.joint.name.lower().replace("_", " ")

    @property
    def told_as(self) -> int:
        """The number by which its protocol's replies name it: Damiao has four bits only."""
        return self.device.can_id & 0x0F if self.model.protocol is WireProtocol.DAMIAO else self.device.can_id

    def command(self, target: SetPoint, now_ns: int) -> Frame:
        """The frame for a set-point at the joint."""
        if self.latched is not DriveFault.NONE and self.model.protocol is WireProtocol.AK_V3:
            # this firmware has no enable: any stiff command would restart a drive that has faulted
            target = target._replace(stiffness_nm_rad=0.0, torque_nm=0.0)
        return self._outgoing(self.codec.command(self.device.can_id, self.transmission.to_motor(target)), now_ns)

    def order(self, order: Order, now_ns: int) -> list[Frame]:
        """The frames of an order."""
        return [self._outgoing(frame, now_ns) for frame in self.codec.order(self.device.can_id, order)]

    def ask(self, frame: Frame, now_ns: int) -> Frame:
        """A question of the drive's own protocol."""
        return self._outgoing(frame, now_ns)

    def is_echo(self, data: bytes) -> bool:
        """Whether these bytes are what was just sent (some interfaces give them back)."""
        return data in self._recent

    def take(self, reply: Reply, measured_ns: int) -> bool:
        """Take in a reply; False when it is one more than was asked for: two drives share the identifier."""
        self.position_rad = self.transmission.angle_to_joint(reply.position_rad)
        self.velocity_rad_s = reply.velocity_rad_s / self.transmission.ratio
        self.torque_nm = reply.torque_nm * self.transmission.ratio
        self.temperature_c = reply.temperature_c
        self.measured_ns = measured_ns
        self.enabled = reply.enabled
        self.answered += 1
        self._judge(reply, measured_ns)
        return self.ledger.receive(measured_ns) or not self.model.answers_each_command

    def _judge(self, reply: Reply, measured_ns: int) -> None:
        # combining flags costs microseconds, and this runs two thousand times a second: only when there is one
        verdict = self.watch.judge(reply.position_rad, reply.velocity_rad_s, measured_ns)
        self.faults = reply.faults if verdict is DriveFault.NONE else reply.faults | verdict
        if self.faults is not DriveFault.NONE:
            self.latched |= self.faults

    def _outgoing(self, frame: Frame, now_ns: int) -> Frame:
        self._recent.append(frame.data)
        self.ledger.send(now_ns)
        return frame


_FINE = (BusFault.NONE, "")


class Routes:
    """The stations of one bus by everything that can name them in a frame."""

    def __init__(self, stations: list[Station]) -> None:
        self._commands: dict[tuple[int, bool], Station] = {}
        self._registers: tuple[Station, dict[int, float]] | None = None
        self._by_reply_id: dict[int, Station] = {}
        self._by_drive: dict[WireProtocol, tuple[Codec, dict[int, Station]]] = {}
        shared = Counter(station.device.reply_id for station in stations)
        for station in stations:
            protocol, drive_id = station.model.protocol, station.device.can_id
            self._by_drive.setdefault(protocol, (station.codec, {}))[1][station.told_as] = station
            commanding = station.codec.command(drive_id, NEUTRAL)
            self._commands[(commanding.arbitration_id, commanding.extended)] = station
            # a Damiao drive with a master ID of its own is told by it: data[0] has only four bits of the ID
            if protocol is WireProtocol.DAMIAO and station.device.reply_id and shared[station.device.reply_id] == 1:
                self._by_reply_id[station.device.reply_id] = station

    def deliver(self, frame: Frame, measured_ns: int) -> tuple[BusFault, str]:
        """Hand a frame to its station; what is wrong with it otherwise, with a sentence."""
        if self._registers is not None and self._take_register(frame, *self._registers):
            return _FINE
        commanded = self._commands.get((frame.arbitration_id, frame.extended))
        if commanded is not None and commanded.is_echo(frame.data):
            return _FINE
        station = self._sender(frame)
        if station is None or self._only_seems_to_be(station, commanded, frame):
            return self._stray(frame, commanded)
        return _take_in(station, frame, measured_ns)

    def await_registers(self, station: Station, told: dict[int, float] | None) -> None:
        """From now on, register replies of this station go into `told`; None ends that."""
        self._registers = None if told is None else (station, told)

    def _take_register(self, frame: Frame, station: Station, told: dict[int, float]) -> bool:
        value = damiao.register_reply(frame)
        if value is None or value.drive_id != station.device.can_id:
            return False
        told[value.register] = value.value
        return True

    def _sender(self, frame: Frame) -> Station | None:
        if not frame.extended and frame.arbitration_id in self._by_reply_id:
            return self._by_reply_id[frame.arbitration_id]
        for codec, by_drive in self._by_drive.values():
            drive_id = codec.replier(frame)
            if drive_id is not None and drive_id in by_drive:
                return by_drive[drive_id]
        return None

    def _only_seems_to_be(self, station: Station, commanded: Station | None, frame: Frame) -> bool:
        """On a drive's command ID only that drive may answer, unless the host has the same ID (drive 0, host 0)."""
        return commanded not in (None, station) and frame.arbitration_id != station.device.reply_id

    def _stray(self, frame: Frame, commanded: Station | None) -> tuple[BusFault, str]:
        if self._is_own_echo(frame):
            return _FINE
        if commanded is not None:
            return BusFault.DUPLICATE_ID, f"another program commands {commanded.name}: end it"
        return (
            BusFault.UNKNOWN_ID,
            f"a frame of nobody described: ID {frame.arbitration_id:X}, {frame.data.hex(' ')}",
        )

    def _is_own_echo(self, frame: Frame) -> bool:
        return any(
            station.is_echo(frame.data) for _, by_drive in self._by_drive.values() for station in by_drive.values()
        )


def _take_in(station: Station, frame: Frame, measured_ns: int) -> tuple[BusFault, str]:
    reply = station.codec.read_reply(frame)
    if reply is None:
        return BusFault.MALFORMED, f"a reply of {len(frame.data)} bytes from {station.name} makes no sense"
    if not station.take(reply, measured_ns):
        text = "answers more often than asked: two drives share its ID, or another program commands it"
        return BusFault.DUPLICATE_ID, f"{station.name} {text}"
    return _FINE
