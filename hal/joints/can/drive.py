"""One drive from the host's side, and which drive a received frame comes from."""

from __future__ import annotations

import math
from collections import Counter, deque
from pathlib import Path

from hal.errors import CanFault
from hal.joints.can.port import BusReport
from hal.joints.can.range_check import RangeCheck
from hal.joints.codecs import codec_of, damiao
from hal.joints.codecs.wire import NEUTRAL, Codec, Frame, Order, Reply, SetPoint, Transmission
from hal.joints.device import Exoskeleton, JointDevice
from hal.joints.motors import MotorModel, WireProtocol, load_motors
from hal.joints.protocol import BusFault, DriveFault, Joint

# A drive that restarts is silent, then answers without torque, and an MIT reply does not say so. 250 ms of commands
# (chosen, not measured). Not counted in time: a host that stands still sends none.
_RESTARTED_AFTER = 125
_OWED_LIMIT = 500  # a second of commands: an adapter, or a busy host, may hold replies up for tenths of one


class Drive:
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
        self.latched = DriveFault.NONE  # every fault since enabling began
        self.replies = 0
        self.replies_before = 0  # the newest command
        self.silent_commands = 0  # in a row that it left unanswered while another drive of its bus answered
        self.reply_size = 0  # bytes of the newest reply
        self._owed = 0  # replies that may still come: more than that come from another drive
        self.range_check = RangeCheck()
        self._recent: deque[bytes] = deque(maxlen=8)
        self._powers_itself = self.codec.traits.enabled_by_command  # by the next set-point, after a restart too

    @property
    def identity(self) -> dict[str, object]:
        """Values that name it in a message: joint, can_id, motor."""
        return {"joint": self.joint, "can_id": self.device.can_id, "motor": self.model.label}

    @property
    def reply_number(self) -> int:
        """The number by which its protocol's replies name it: Damiao has four bits only."""
        return self.device.can_id & 0x0F if self.model.protocol is WireProtocol.DAMIAO else self.device.can_id

    def command(self, target: SetPoint) -> Frame:
        """The frame for a set-point at the joint."""
        if self.latched is not DriveFault.NONE and self.codec.traits.enabled_by_command:
            # any stiff command would restart a drive that has faulted
            target = target._replace(stiffness_nm_rad=0.0, torque_nm=0.0)
        return self.ask(self.codec.command(self.device.can_id, self.transmission.to_motor(target)))

    def order(self, order: Order) -> list[Frame]:
        """The frames of an order."""
        return [self.ask(frame) for frame in self.codec.order(self.device.can_id, order)]

    def ask(self, frame: Frame) -> Frame:
        """A frame that the drive is to answer: a command, an order, or a question of its own protocol."""
        self._recent.append(frame.data)
        self._owed = min(self._owed + 1, _OWED_LIMIT)
        return frame

    def is_echo(self, data: bytes) -> bool:
        """Whether these bytes are what was just sent (some interfaces give them back)."""
        return data in self._recent

    def take(self, reply: Reply, measured_ns: int) -> bool:
        """Take in a reply; False when it is one more than was requested: two drives share the identifier."""
        self.position_rad = self.transmission.angle_to_joint(reply.position_rad)
        self.velocity_rad_s = reply.velocity_rad_s / self.transmission.ratio
        self.torque_nm = reply.torque_nm * self.transmission.ratio
        self.temperature_c = reply.temperature_c
        self.measured_ns = measured_ns
        self.enabled = reply.enabled
        self.replies += 1
        self._check(reply, measured_ns)
        asked_for = self._owed > 0
        self._owed = max(self._owed - 1, 0)
        return asked_for or not self.model.answers_each_command

    def _check(self, reply: Reply, measured_ns: int) -> None:
        # combining flags costs microseconds, and this runs two thousand times a second: only when there is one
        verdict = self.range_check.check(reply.position_rad, reply.velocity_rad_s, measured_ns)
        self.faults = reply.faults if verdict is DriveFault.NONE else reply.faults | verdict
        if self.silent_commands > _RESTARTED_AFTER and reply.enabled is None and not self._powers_itself:
            self.latched |= DriveFault.UNEXPECTEDLY_DISABLED
        if self.faults is not DriveFault.NONE:
            self.latched |= self.faults


def drives_of(device: Exoskeleton, motors: Path | None = None) -> tuple[Drive, ...]:
    """The device's four drives. Raises HardwareError for an unknown motor."""
    table = load_motors(motors)
    return tuple(Drive(joint, device.joints[joint], table.find(device.joints[joint].motor)) for joint in Joint)


def count_silences(drives: list[Drive]) -> None:
    """Before each command to these drives of one bus; where none has answered the last one, the bus was silent."""
    if any(drive.replies != drive.replies_before for drive in drives):
        for drive in drives:
            silent = drive.replies == drive.replies_before
            drive.silent_commands = drive.silent_commands + 1 if silent else 0
            drive.replies_before = drive.replies


class Router:
    """The drives of one bus by everything that can name them in a frame."""

    def __init__(self, drives: list[Drive]) -> None:
        self._commands: dict[tuple[int, bool], Drive] = {}
        self._awaited: dict[tuple[int, int], dict[int, float]] = {}  # drive's ID, register: where its value goes
        self._by_reply_id: dict[int, Drive] = {}
        self._by_drive: dict[WireProtocol, tuple[Codec, dict[int, Drive]]] = {}
        self._drives = drives
        shared = Counter(drive.device.reply_id for drive in drives)
        for drive in drives:
            protocol, reply_id = drive.model.protocol, drive.device.reply_id
            if not drive.codec.traits.read_only:
                commanding = drive.codec.command(drive.device.can_id, NEUTRAL)
                self._commands[(commanding.arbitration_id, commanding.extended)] = drive
            # A Damiao drive with a master ID of its own is known by it alone: data[0] has only four bits of the ID.
            if protocol is WireProtocol.DAMIAO and reply_id and shared[reply_id] == 1:
                self._by_reply_id[reply_id] = drive
            else:
                self._by_drive.setdefault(protocol, (drive.codec, {}))[1][drive.reply_number] = drive

    def deliver(self, frame: Frame, measured_ns: int) -> BusReport | None:
        """Hand a frame to its drive; what is wrong with it otherwise."""
        if self._awaited and self._take_register(frame):
            return None
        commanded = self._commanded(frame)
        if commanded is not None and commanded.is_echo(frame.data):
            return None
        drive = self.sender(frame)
        if drive is None:
            return self._unassigned(frame, commanded)
        return _take_in(drive, frame, measured_ns)

    def expect_register(self, drive: Drive, register: int, reported: dict[int, float]) -> None:
        """From now on, this drive's replies about this register go into `reported`."""
        self._awaited[drive.device.can_id, register] = reported

    def forget_register(self, drive: Drive, register: int) -> None:
        """Every question about it is answered; a late reply about another one still is no status."""
        del self._awaited[drive.device.can_id, register]

    def sender(self, frame: Frame) -> Drive | None:
        """Whose reply a frame is; nobody's when it is a command."""
        drive = self._claimed(frame)
        return None if drive is None or self._is_impostor(drive, frame) else drive

    def _commanded(self, frame: Frame) -> Drive | None:
        return self._commands.get((frame.arbitration_id, frame.extended))

    def _claimed(self, frame: Frame) -> Drive | None:
        """The drive that a frame names as its sender; nobody where identifier and number name two."""
        owner = None if frame.extended else self._by_reply_id.get(frame.arbitration_id)
        if owner is not None:
            return owner if owner.codec.replier(frame) == owner.reply_number else None
        for codec, by_drive in self._by_drive.values():
            drive_id = codec.replier(frame)
            if drive_id is not None and drive_id in by_drive:
                return by_drive[drive_id]
        return None

    def _take_register(self, frame: Frame) -> bool:
        value = damiao.register_reply(frame)
        reported = self._awaited.get((value.drive_id, value.register)) if value is not None else None
        if value is None or reported is None:
            return False
        owner = self._by_reply_id.get(frame.arbitration_id)
        if owner is None or owner.device.can_id == value.drive_id:  # the whole ID, of which a status has four bits
            reported[value.register] = value.value
        return True

    def _is_impostor(self, drive: Drive, frame: Frame) -> bool:
        """On a drive's command ID only that drive may answer, unless the host has the same ID (drive 0, host 0).

        Damiao drives answer on their master ID alone: the four bits that name one may be those of a command's angle.
        """
        commanded = self._commanded(frame)
        if commanded is None or frame.arbitration_id == drive.device.reply_id:
            return False
        return commanded is not drive or drive.model.protocol is WireProtocol.DAMIAO

    def _unassigned(self, frame: Frame, commanded: Drive | None) -> BusReport | None:
        if self._is_own_echo(frame):
            return None
        if commanded is not None:
            return BusReport(BusFault.DUPLICATE_ID, CanFault.OTHER_COMMANDER, commanded.identity)
        values = {"identifier": f"{frame.arbitration_id:X}", "data": frame.data.hex(" ")}
        return BusReport(BusFault.UNKNOWN_ID, CanFault.UNKNOWN_SENDER, values)

    def _is_own_echo(self, frame: Frame) -> bool:
        return any(drive.is_echo(frame.data) for drive in self._drives)


def _take_in(drive: Drive, frame: Frame, measured_ns: int) -> BusReport | None:
    reply = drive.codec.read_reply(frame)
    if reply is None:
        values = {**drive.identity, "size": len(frame.data)}
        return BusReport(BusFault.MALFORMED, CanFault.UNREADABLE_REPLY, values)
    drive.reply_size = len(frame.data)
    if not drive.take(reply, measured_ns):
        return BusReport(BusFault.DUPLICATE_ID, CanFault.TOO_MANY_REPLIES, drive.identity)
    return None
