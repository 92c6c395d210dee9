"""The Joints Protocol: four drives, commanded by the MIT impedance law, read back with their age.

Sign and zero, here and nowhere else: hip flexion positive, knee flexion positive, standing = 0, radians at the
joint (after gear, sign and offset).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, Flag, auto
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hal.errors import HardwareError
from hal.joints.device import Joint as Joint  # noqa: PLC0414 - exported again beside its arrays

JointArray = NDArray[np.float64]  # (4,), in the order of Joint


TICK_HZ = 500  # control's rate: limits per tick, the bus's load and the simulation's step follow from it
TICK_S = 1 / TICK_HZ
TICK_NS = 1_000_000_000 // TICK_HZ
LEFT_ON_DAMPING_S = 0.3  # of drives that may be stiff, before their torque goes: as long as control's ramp to damping


class DriveState(Enum):
    """Life cycle of the drives as the driver last confirmed it."""

    UNCONFIGURED = "unconfigured"
    PROBED = "probed"
    ENABLED = "enabled"
    DISABLED = "disabled"
    FAULTED = "faulted"


def carries_power(state: DriveState) -> bool:
    """Whether the drives count as powered. A drive that faulted carries no power, but the three beside it do."""
    return state in {DriveState.ENABLED, DriveState.FAULTED}


class DriveFault(Flag):
    """What a drive or its bus reports, after translation from the motor's own error table."""

    NONE = 0
    OVER_TEMPERATURE = auto()
    OVER_CURRENT = auto()
    OVER_VOLTAGE = auto()
    UNDER_VOLTAGE = auto()
    ENCODER = auto()
    PHASE = auto()
    OVERLOAD = auto()
    LOST_COMMUNICATION = auto()
    UNEXPECTEDLY_DISABLED = auto()
    WRONG_RANGE = auto()
    OTHER = auto()


class BusFault(Flag):
    """What happened on the bus since the last read."""

    NONE = 0
    SEND_FAILED = auto()
    BUS_OFF = auto()
    ERROR_FRAME = auto()
    ARBITRATION_LOST = auto()
    UNKNOWN_ID = auto()
    DUPLICATE_ID = auto()
    MALFORMED = auto()
    INTERFACE_GONE = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCommand:
    """One tick's command, each field (4,): τ = kp(q* − q) + kd(q̇* − q̇) + τ_ff, at the joint."""

    position_rad: JointArray
    velocity_rad_s: JointArray
    stiffness_nm_rad: JointArray
    damping_nm_s_rad: JointArray
    torque_nm: JointArray

    @property
    def fields(self) -> tuple[JointArray, JointArray, JointArray, JointArray, JointArray]:
        """Position, velocity, stiffness, damping, torque."""
        return self.position_rad, self.velocity_rad_s, self.stiffness_nm_rad, self.damping_nm_s_rad, self.torque_nm

    def rows(self) -> list[tuple[float, ...]]:
        """The fields joint by joint, plain numbers; fewer rows when a field has fewer values."""
        position, velocity = self.position_rad.tolist(), self.velocity_rad_s.tolist()
        stiffness, damping = self.stiffness_nm_rad.tolist(), self.damping_nm_s_rad.tolist()
        return list(zip(position, velocity, stiffness, damping, self.torque_nm.tolist(), strict=False))


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFeedback:
    """What the joints last reported, each array (4,); measured_ns is each joint's own time of measurement.

    temperature_c is NaN where the drive does not report it. A joint that has never answered has measured_ns 0.
    """

    measured_ns: NDArray[np.int64]
    position_rad: JointArray
    velocity_rad_s: JointArray
    torque_nm: JointArray
    temperature_c: JointArray
    faults: tuple[DriveFault, DriveFault, DriveFault, DriveFault]
    state: DriveState
    bus: BusFault = BusFault.NONE
    detail: HardwareError | None = None  # what is known of the newest fault
    unasked: frozenset[Joint] = frozenset()  # not asked without power: their drives answer to being enabled alone


class Joints(Protocol):
    """Four drives. Only control opens them; every command passes the guard first."""

    def open(self, now_ns: int) -> None:
        """Probe: who answers, with which ranges. Raises HardwareError when they don't."""

    def enable(self, now_ns: int) -> None:
        """Neutral command, enable, confirm by feedback. Raises HardwareError when a drive does not confirm."""

    def write(self, command: JointCommand, now_ns: int) -> None:
        """Send one command to all four; never blocks, never raises for the bus: faults come with `read`."""

    def read(self, now_ns: int) -> JointFeedback:
        """Drain what has arrived; never blocks, never raises for the bus."""

    def close(self, now_ns: int) -> None:
        """Disable, confirm, release; does nothing when it isn't open."""
