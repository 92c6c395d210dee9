"""Between a motor's output and its joint: sign, zero and gear, in one place for driver, emulator and guardian.

Motor angle = direction · transmission · (joint angle − zero offset); powers are equal on both sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hal.joints.codecs.wire import SetPoint
from hal.joints.device import JointDevice


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
        """A set-point at the joint, seen from the motor."""
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
        """A set-point at the motor, seen from the joint."""
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
