"""Planar leg kinematics, vectorised: hip and knee angles to ankle and foot, and back.

Axes: x forward, z up, from the hip. Angles are world angles unless they are joints': a segment's angle is measured
from hanging straight down, forward positive; lean is the trunk's, forward positive; pitch is the foot's, toe up
positive. Joints as in hal.joints.protocol: hip and knee flexion positive, standing upright = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hal.joints.body import Body

Array = NDArray[np.float64]


class LegAngles(NamedTuple):
    """Hip and knee, radians, of any one shape."""

    hip: Array
    knee: Array


def leg_length(body: Body, knee_rad: float) -> float:
    """Hip to ankle with the knee bent so far, metres."""
    a, b = body.thigh_m, body.shank_m
    return float(np.sqrt(a * a + b * b + 2 * a * b * np.cos(knee_rad)))


def ankle(body: Body, hip_rad: Array, knee_rad: Array, lean_rad: Array | float = 0.0) -> Array:
    """Ankle from the hip, (..., 2) metres."""
    thigh = hip_rad - lean_rad
    shank = thigh - knee_rad
    x = body.thigh_m * np.sin(thigh) + body.shank_m * np.sin(shank)
    z = -body.thigh_m * np.cos(thigh) - body.shank_m * np.cos(shank)
    return np.stack([x, z], axis=-1)


def joints(body: Body, ankle_from_hip_m: Array, lean_rad: Array | float = 0.0) -> LegAngles:
    """Hip and knee that bring the ankle there, (..., 2) in, knee flexed; NaN where the leg is too short or folds."""
    a, b = body.thigh_m, body.shank_m
    x, z = ankle_from_hip_m[..., 0], ankle_from_hip_m[..., 1]
    cosine = (x * x + z * z - a * a - b * b) / (2 * a * b)
    knee = np.arccos(np.where(np.abs(cosine) <= 1, cosine, np.nan))
    thigh = np.arctan2(x, -z) + np.arctan2(b * np.sin(knee), a + b * cosine)
    return LegAngles(thigh + lean_rad, knee)


def shank_angle(hip_rad: Array, knee_rad: Array, lean_rad: Array | float = 0.0) -> Array:
    """The shank's angle, radians; also the pitch of a foot whose ankle is at rest."""
    shank: Array = hip_rad - lean_rad - knee_rad
    return shank


def sole(body: Body, pitch_rad: Array) -> tuple[Array, Array]:
    """Heel and toe of the sole from the ankle, each (..., 2) metres, of a foot with that pitch."""
    sine, cosine, down = np.sin(pitch_rad), np.cos(pitch_rad), body.ankle_height_m

    def turned(along: float) -> Array:
        return np.stack([along * cosine + down * sine, along * sine - down * cosine], axis=-1)

    return turned(-body.heel_m), turned(body.toe_m)
