"""Planar leg kinematics, vectorised, and the C² curves on which a swinging foot moves.

Axes: x forward, z up, from the hip. Angles are world angles unless they are joints': a segment's angle is measured
from hanging straight down, forward positive; lean is the trunk's, forward positive; pitch is the foot's, toe up
positive. Joints as in hal.joints.protocol: hip and knee flexion positive, standing upright = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hal.joints.body import Body
from hal.minimum_jerk import minimum_jerk

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


Mask = NDArray[np.bool_]


def smoothstep(time_s: Array, start_s: float, end_s: float) -> Array:
    """0 before start, 1 after end, between them minimum jerk; (n,) like the time."""
    s = np.clip((time_s - start_s) / (end_s - start_s), 0.0, 1.0)
    return minimum_jerk(s)


def ramp(time_s: Array, start_s: float, end_s: float) -> Array:
    """The integral of `smoothstep`: at rest before start, moving with speed 1 after end; metres for m/s."""
    span = end_s - start_s
    s = np.clip((time_s - start_s) / span, 0.0, 1.0)
    return span * s**4 * (2.5 - 3 * s + s * s) + np.maximum(time_s - end_s, 0.0)


def cruise(time_s: Array, end_s: float, onset_s: float, settle_s: float) -> Array:
    """0 at 0, 1 from end on: the speed grows over the onset, stays, and falls over the settling; (n,) like the time."""
    travelled = ramp(time_s, 0.0, onset_s) - ramp(time_s, end_s - settle_s, end_s)
    return travelled / (end_s - (onset_s + settle_s) / 2)


def hump(time_s: Array, start_s: float, up_s: float, down_s: float, end_s: float) -> Array:
    """0, up to 1 between start and up, down to 0 between down and end."""
    return smoothstep(time_s, start_s, up_s) * (1 - smoothstep(time_s, down_s, end_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class SwingShape:
    """When things happen, as shares of the time in the air, 0 at toe off and 1 at landing."""

    forward: tuple[float, float]  # the foot travels
    level: tuple[float, float]  # it changes from the old floor's height to the new one's
    up_by: float  # it has been lifted
    down_from: float  # it begins to come down
    heel_rise_rad: float = radians(12)
    heel_highest: float = 0.12
    heel_rise_ends: float = 0.7
    land_pitch_rad: float = 0.0
    toes_up_from: float = 0.55


LEVEL = SwingShape(
    forward=(0.0, 1.0), level=(0.0, 1.0), up_by=0.45, down_from=0.45,
    heel_rise_rad=radians(32), heel_rise_ends=0.85, land_pitch_rad=radians(10),
)  # fmt: skip
# Of the periodic walk: as people swing a leg, the knee bends most while the foot is still behind the hip, and the foot
# is far forward before it comes down, so that the hip is flexed as it lands.
STRIDE = SwingShape(
    forward=(0.17, 0.90), level=(0.0, 1.0), up_by=0.30, down_from=0.42,
    heel_rise_rad=radians(23), heel_highest=0.20, heel_rise_ends=0.86, land_pitch_rad=radians(13), toes_up_from=0.48,
)  # fmt: skip
CLOSING = SwingShape(
    forward=(0.0, 0.95), level=(0.0, 1.0), up_by=0.45, down_from=0.5, heel_rise_rad=radians(28), heel_rise_ends=0.8
)
UP = SwingShape(
    forward=(0.22, 0.88), level=(0.0, 0.55), up_by=0.40, down_from=0.72, heel_rise_rad=radians(25)
)  # fmt: skip
DOWN = SwingShape(
    forward=(0.05, 0.70), level=(0.42, 1.0), up_by=0.25, down_from=0.55, land_pitch_rad=radians(12)
)  # fmt: skip
OVER = SwingShape(forward=(0.18, 0.82), level=(0.0, 1.0), up_by=0.35, down_from=0.65)


@dataclass(frozen=True, slots=True, kw_only=True)
class Swing:
    """One foot's swing from a place on the floor to another; places are of the flat foot's ankle, metres."""

    rise_s: float  # the heel begins to rise
    off_s: float  # the toes leave
    land_s: float
    flat_s: float
    start_m: tuple[float, float]
    end_m: tuple[float, float]
    shape: SwingShape
    lift_m: float = 0.0  # above the straight line

    def at(self, share: float) -> float:
        """The time at a share of the time in the air, seconds."""
        return self.off_s + share * (self.land_s - self.off_s)


def progress(swing: Swing, time_s: Array) -> Array:
    """How far the foot has travelled, 0 to 1, (n,)."""
    first, last = swing.shape.forward
    return smoothstep(time_s, swing.at(first), swing.at(last))


def lifting(swing: Swing, time_s: Array) -> Array:
    """How much of the lift is in force, 0 to 1, (n,)."""
    shape = swing.shape
    return hump(time_s, swing.at(0.0), swing.at(shape.up_by), swing.at(shape.down_from), swing.at(1.0))


def displacement(body: Body, swing: Swing, time_s: Array) -> Array:
    """The ankle from where it stood before the swing, (n, 2) metres."""
    shape = swing.shape
    first, last = shape.level
    changed = smoothstep(time_s, swing.at(first), swing.at(last))
    length, climb = swing.end_m[0] - swing.start_m[0], swing.end_m[1] - swing.start_m[1]
    moved = np.stack(
        [length * progress(swing, time_s), climb * changed + swing.lift_m * lifting(swing, time_s)], axis=-1
    )
    rolled: Array = moved + about_toe(body, heel_rise(swing, time_s)) + about_heel(body, landing_pitch(swing, time_s))
    return rolled


def heel_rise(swing: Swing, time_s: Array) -> Array:
    """How far the heel is turned up about the toes, radians, (n,)."""
    shape = swing.shape
    top = swing.at(shape.heel_highest)
    return shape.heel_rise_rad * hump(time_s, swing.rise_s, top, top, swing.at(shape.heel_rise_ends))


def landing_pitch(swing: Swing, time_s: Array) -> Array:
    """How far the toes are turned up about the heel, radians, (n,)."""
    shape = swing.shape
    return shape.land_pitch_rad * hump(time_s, swing.at(shape.toes_up_from), swing.land_s, swing.land_s, swing.flat_s)


def about_toe(body: Body, angle: Array) -> Array:
    """How far the ankle moves when the heel turns up about the toes, (n, 2) metres."""
    sine, missing = np.sin(angle), 1 - np.cos(angle)
    toe, height = body.toe_m, body.ankle_height_m
    return np.stack([toe * missing + height * sine, toe * sine - height * missing], axis=-1)


def about_heel(body: Body, angle: Array) -> Array:
    """How far the ankle moves when the foot turns up about its heel, (n, 2) metres."""
    sine, missing = np.sin(angle), 1 - np.cos(angle)
    heel, height = body.heel_m, body.ankle_height_m
    return np.stack([-heel * missing - height * sine, heel * sine - height * missing], axis=-1)
