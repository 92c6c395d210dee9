"""What every codec shares: frames, set-points, replies, the firmware's exact fixed-point scaling, and the transmission.

Transmission, between a motor's output and its joint: motor angle = direction · transmission · (joint angle − zero
offset); powers are equal on both sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar, NamedTuple, Protocol

from hal.joints.device import JointDevice
from hal.joints.motors import MotorModel
from hal.joints.protocol import DriveFault


class WireQuantity(Enum):
    """What a drive's wire format limits, or its registers report."""

    ANGLE = "rad"
    SPEED = "rad/s"
    STIFFNESS = "Nm/rad"
    DAMPING = "Nm s/rad"
    TORQUE = "Nm"
    CONTROL_MODE = "mode"


class Frame(NamedTuple):
    """A classic CAN data frame."""

    arbitration_id: int
    data: bytes
    extended: bool = False


class SetPoint(NamedTuple):
    """The MIT law's five numbers, at the motor's output: rad, rad/s, Nm/rad, Nm·s/rad, Nm."""

    position_rad: float
    velocity_rad_s: float
    stiffness_nm_rad: float
    damping_nm_s_rad: float
    torque_nm: float


NEUTRAL = SetPoint(0.0, 0.0, 0.0, 0.0, 0.0)


class Order(Enum):
    """What a drive can be commanded besides a set-point."""

    ENABLE = "enable"
    DISABLE = "disable"
    ZERO = "set zero here"
    CLEAR = "clear faults"


class Reply(NamedTuple):
    """What a drive reported, at the motor's output; `enabled` is None where the protocol does not report it."""

    drive_id: int
    position_rad: float
    velocity_rad_s: float
    torque_nm: float
    temperature_c: float = float("nan")
    faults: DriveFault = DriveFault.NONE
    enabled: bool | None = None


def raw_temperature(motor: MotorModel, state: Reply, low: int, high: int, per_degree: int = 1) -> int:
    """The byte or word of a reply's temperature, within low and high; an unknown temperature counts as 0 °C."""
    temperature_c = 0.0 if math.isnan(state.temperature_c) else state.temperature_c
    return min(max(round((temperature_c + motor.temperature_offset_c) * per_degree), low), high)


class Traits(NamedTuple):
    """What driver, scan and doctor rest on besides a protocol's bytes; without defaults, so that none is forgotten."""

    scan_name: str  # of the question in can/scan.py that finds its drives
    standard_replies: bool  # some of its firmware replies on a standard identifier, the device's reply_id
    enabled_by_command: bool  # any set-point powers the drive, also one that has faulted: there is no order to enable
    loses_zero: bool  # keeps a zero that was set until power-off only
    read_only: bool  # is never commanded


class Codec(Protocol):
    """One protocol with one motor's ranges. Reading functions answer None for what is not theirs."""

    traits: ClassVar[Traits]

    def __init__(self, motor: MotorModel) -> None: ...

    def command(self, drive_id: int, target: SetPoint, /) -> Frame:
        """The frame that commands `target`; values beyond the wire's range are clamped as the firmware does."""

    def order(self, drive_id: int, order: Order, /) -> tuple[Frame, ...]:
        """The frames that carry out an order; empty where the protocol has none."""

    def replier(self, frame: Frame, /) -> int | None:
        """Whose reply this frame claims to be, or None when it is no reply of this protocol."""

    def read_reply(self, frame: Frame, /) -> Reply | None:
        """A reply decoded, or None when its length or layout is wrong."""

    def read_command(self, drive_id: int, frame: Frame, /) -> SetPoint | Order | None:
        """The drive's end: what this frame asks of drive `drive_id`."""

    def reply(self, state: Reply, reply_id: int, error_code: int, /) -> Frame:
        """The drive's end: the frame that reports `state` (its `faults` are ignored: the code counts)."""


# A decoded value lies this share of a quantum above its grid point, so that encoding it again by truncation gives
# the same bits in spite of binary fractions. It is 1e-6 of what the wire can resolve.
_NUDGE = 1e-6


@dataclass(frozen=True, slots=True)
class Scale:
    """Fixed point as in bgkatz/motorcontrol `float_to_uint` and the CubeMars AK manual V1.0.8, section 5.3.

    u = int((x − low)·(2ⁿ − 1)/(high − low)) after clamping: it truncates, so a value is up to one quantum low.
    """

    low: float
    high: float
    bits: int
    top: int = field(init=False)
    span: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "top", (1 << self.bits) - 1)
        object.__setattr__(self, "span", self.high - self.low)

    def to_wire(self, value: float) -> int:
        """The unsigned integer for a value; raises ValueError for NaN."""
        if value <= self.low:
            return 0
        if value >= self.high:
            return self.top
        return int((value - self.low) * self.top / self.span)

    def to_value(self, wire: int) -> float:
        """The value of an unsigned integer."""
        if wire >= self.top:
            return self.high
        return (wire + _NUDGE) * self.span / self.top + self.low if wire else self.low


def symmetric(limit: float, bits: int) -> Scale:
    """The scale of ±limit."""
    return Scale(-limit, limit, bits)


@dataclass(frozen=True, slots=True)
class Scales:
    """The five scales of a motor's MIT law."""

    position: Scale
    velocity: Scale
    stiffness: Scale
    damping: Scale
    torque: Scale

    @classmethod
    def of(cls, motor: MotorModel, bits: tuple[int, int, int, int, int]) -> Scales:
        """A motor's scales with these widths: position, velocity, stiffness, damping, torque."""
        return cls(
            symmetric(motor.position_rad, bits[0]),
            symmetric(motor.velocity_rad_s, bits[1]),
            Scale(0.0, motor.stiffness_nm_rad, bits[2]),
            Scale(0.0, motor.damping_nm_s_rad, bits[3]),
            symmetric(motor.torque_nm, bits[4]),
        )

    def to_wire(self, target: SetPoint) -> tuple[int, int, int, int, int]:
        """The five unsigned integers of a set-point."""
        return (
            self.position.to_wire(target[0]),
            self.velocity.to_wire(target[1]),
            self.stiffness.to_wire(target[2]),
            self.damping.to_wire(target[3]),
            self.torque.to_wire(target[4]),
        )

    def to_value(self, p: int, v: int, kp: int, kd: int, t: int) -> SetPoint:
        """The set-point of five unsigned integers."""
        return SetPoint(
            self.position.to_value(p),
            self.velocity.to_value(v),
            self.stiffness.to_value(kp),
            self.damping.to_value(kd),
            self.torque.to_value(t),
        )


MIT_BITS = (16, 12, 12, 12, 12)


@dataclass(frozen=True, slots=True)
class Transmission:
    """One joint's conventions; `ratio` carries the sign."""

    ratio: float
    zero_offset_rad: float

    @classmethod
    def of(cls, joint: JointDevice) -> Transmission:
        """As the device description has it."""
        return cls(joint.direction * joint.transmission, math.radians(joint.zero_offset_deg))

    def to_motor(self, at_joint: SetPoint) -> SetPoint:
        """A set-point at the joint, as at the motor."""
        position, velocity, stiffness, damping, torque = at_joint
        ratio = self.ratio
        return SetPoint(
            (position - self.zero_offset_rad) * ratio,
            velocity * ratio,
            stiffness / (ratio * ratio),
            damping / (ratio * ratio),
            torque / ratio,
        )

    def to_joint(self, at_motor: SetPoint) -> SetPoint:
        """A set-point at the motor, as at the joint."""
        position, velocity, stiffness, damping, torque = at_motor
        ratio = self.ratio
        return SetPoint(
            position / ratio + self.zero_offset_rad,
            velocity / ratio,
            stiffness * ratio * ratio,
            damping * ratio * ratio,
            torque * ratio,
        )

    def angle_to_joint(self, motor_rad: float) -> float:
        """A motor angle as a joint angle."""
        return motor_rad / self.ratio + self.zero_offset_rad

    def angle_to_motor(self, joint_rad: float) -> float:
        """A joint angle as a motor angle."""
        return (joint_rad - self.zero_offset_rad) * self.ratio
