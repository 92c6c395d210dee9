"""The wearer's body as the simulated exoskeleton needs it: segment lengths, masses and how much of it is carried.

Ratios of stature and mass: Drillis and Contini, and the segment table, of Winter, Biomechanics and Motor Control of
Human Movement, tables 4.1 and 4.2 (figure 4.1 for the lengths).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from hal.minimum_jerk import minimum_jerk

THIGH_OF_STATURE = 0.245
SHANK_OF_STATURE = 0.246
ANKLE_HEIGHT_OF_STATURE = 0.039
HEEL_OF_STATURE = 0.038  # the ankle stands a quarter of the foot's length (0.152 of stature) before the heel
BALL_OF_STATURE = 0.095  # sole that carries before the ankle: to the ball and half of the toes, which bend

THIGH_OF_MASS = 0.100
SHANK_OF_MASS = 0.0465
FOOT_OF_MASS = 0.0145
COM_OF_THIGH = 0.433  # from the upper joint, share of the segment's length
COM_OF_SHANK = 0.433
GYRATION_OF_THIGH = 0.323  # about the centre of mass, share of the segment's length
GYRATION_OF_SHANK = 0.302
TRUNK_COM_OF_STATURE = 0.180  # above the hip: 0.626 of hip to shoulder, which is 0.288 of stature
TRUNK_GYRATION_OF_STATURE = 0.143


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """One wearer; lengths in metres from joint to joint, mass without the device."""

    stature_m: float
    mass_kg: float
    thigh_m: float
    shank_m: float
    ankle_height_m: float
    heel_m: float  # behind the ankle, along the sole
    toe_m: float  # before the ankle, along the sole: where it still carries
    body_weight_support: float = 0.5  # share of the weight, wearer and device, that a harness carries

    @property
    def thigh_kg(self) -> float:
        """One thigh."""
        return THIGH_OF_MASS * self.mass_kg

    @property
    def shank_kg(self) -> float:
        """One shank."""
        return SHANK_OF_MASS * self.mass_kg

    @property
    def foot_kg(self) -> float:
        """One foot."""
        return FOOT_OF_MASS * self.mass_kg

    @property
    def trunk_kg(self) -> float:
        """Head, arms and trunk."""
        return self.mass_kg - 2 * (self.thigh_kg + self.shank_kg + self.foot_kg)


def average_body(stature_m: float, mass_kg: float, body_weight_support: float = 0.5) -> Body:
    """The body that the ratios make of a stature and a mass."""
    return Body(
        stature_m=stature_m,
        mass_kg=mass_kg,
        thigh_m=THIGH_OF_STATURE * stature_m,
        shank_m=SHANK_OF_STATURE * stature_m,
        ankle_height_m=ANKLE_HEIGHT_OF_STATURE * stature_m,
        heel_m=HEEL_OF_STATURE * stature_m,
        toe_m=BALL_OF_STATURE * stature_m,
        body_weight_support=body_weight_support,
    )


# The wearer's and the device's passive parts, known to the simulation and to the planner's torque estimate alike.
ANKLE_DORSIFLEXION_NM_RAD = 80.0  # a stiff ankle-foot orthosis, 1.4 Nm a degree; public devices span 1 to 5
ANKLE_PLANTARFLEXION_NM_RAD = 40.0
ANKLE_REST_RAD = radians(6)  # dorsiflexed: such orthoses lift the toes a little, for clearance
LEAN_MOST_RAD = radians(12)  # of the trunk half way between standing and sitting
LEAN_KNEE_FROM_RAD = radians(45)
LEAN_KNEE_TO_RAD = radians(92)
BUTTOCK_M = 0.085  # from the hip joint's axis down to the seat
DEVICE_ON_THIGH = 0.18  # share of the device's mass: each thigh's cuff with the hip's and half of the knee's drive
DEVICE_ON_SHANK = 0.107


def trunk_lean(left_knee_rad: NDArray[np.float64], right_knee_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far the wearer leans forward with the knees bent so far, radians, C² in both; any shape.

    People bend forward to rise and to sit down, most half way, and sit and stand upright; with one knee bent they
    stay upright.
    """
    seated = _bent(left_knee_rad) * _bent(right_knee_rad)
    return LEAN_MOST_RAD * 4 * seated * (1 - seated)


def trunk_lean_of(left_knee_rad: float, right_knee_rad: float) -> float:
    """`trunk_lean` for two plain numbers: the simulation asks every tick, and arrays of one cost ten times as much."""
    bent = [
        min(max((knee - LEAN_KNEE_FROM_RAD) / (LEAN_KNEE_TO_RAD - LEAN_KNEE_FROM_RAD), 0.0), 1.0)
        for knee in (left_knee_rad, right_knee_rad)
    ]
    left, right = (minimum_jerk(s) for s in bent)
    return LEAN_MOST_RAD * 4 * left * right * (1 - left * right)


def _bent(knee_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    s = np.clip((knee_rad - LEAN_KNEE_FROM_RAD) / (LEAN_KNEE_TO_RAD - LEAN_KNEE_FROM_RAD), 0.0, 1.0)
    return minimum_jerk(s)
