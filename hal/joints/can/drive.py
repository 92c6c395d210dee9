"""One drive seen from the host: its wire format, its last word, and what it still owes."""

from __future__ import annotations

import math
from collections import deque

from hal.joints.can.range_check import RangeCheck
from hal.joints.can.request_tracker import RequestTracker
from hal.joints.can.transmission import Transmission
from hal.joints.codecs import codec_of
from hal.joints.codecs.wire import Frame, Order, Reply, SetPoint
from hal.joints.device import JointDevice
from hal.joints.motors import MotorModel, WireProtocol
from hal.joints.protocol import DriveFault, Joint


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
