"""Between standing and sitting, and from any measured pose to standing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import asin, cos, pi, radians, sin

import numpy as np

from app.motion import kinematics
from app.motion.kinematics import Array, Swing, SwingShape, cruise, smoothstep
from app.motion.path import LEFT, RIGHT, CartesianMotion, Path, by_side, lifted, path_of_joints, sample, ticks
from app.motion.plan import Patient, PlanFault
from app.motion.walking import SOFT_KNEE_RAD, standing_hip_m, standing_segments
from app.system.errors import AppError
from hal.joints.body import BUTTOCK_M, Body, trunk_lean
from hal.joints.scene import Block, BlockKind, Scene

SEATED_SHANK_RAD = radians(-4)  # the knee a little before the ankle
RISING_SHANK_RAD = radians(-14)  # further before it half way, as people do
CHAIR_DEPTH_M = 0.45
# Sitting down and rising begin so that a joint visibly turns within 0.2 s of the command; only a share of the movement
# begins early, because rising needs most torque just after its start, when the seat is left.
EARLY, ONSET_S = 0.4, 0.25
SETTLE = 0.5  # share of the time over which the early share ends
SEAT_TAKES = (0.97, 1.0)  # shares of sitting down over which the chair takes the weight

RECOVER_SPEED_RAD_S = radians(20)  # joints on the path back to standing, at the mean
RECOVER_LEAST_S = 3.0
SPLIT_M = 0.04  # feet farther apart than this are brought together by a step, not by sliding
# Up, across, down: it is unknown whether an edge, a riser or an obstacle stands between the feet.
RECOVER_UP = SwingShape(forward=(0.30, 0.75), level=(0.0, 0.30), up_by=0.30, down_from=0.70, heel_rise_rad=0.0)
RECOVER_DOWN = SwingShape(forward=(0.30, 0.75), level=(0.70, 1.0), up_by=0.30, down_from=0.70, heel_rise_rad=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Seat:
    """How a leg sits: world angles of thigh and shank, radians from hanging, forward positive."""

    thigh_rad: float
    shank_rad: float


def seat_of(patient: Patient) -> Seat:
    """The legs on this patient's chair, the feet flat before it. Raises AppError when the chair is too high."""
    body, chair = patient.body, patient.gait.chair_height_m
    knee = body.ankle_height_m + body.shank_m * cos(SEATED_SHANK_RAD)
    drop = (knee - chair - BUTTOCK_M) / body.thigh_m  # of the hip under the knee, as a share of the thigh
    if abs(drop) >= 1:
        raise AppError(PlanFault.CHAIR_DOES_NOT_FIT, chair_m=chair, thigh_m=body.thigh_m)
    return Seat(thigh_rad=pi / 2 + asin(drop), shank_rad=SEATED_SHANK_RAD)


def seated_joints(patient: Patient) -> tuple[float, float]:
    """Hip and knee of a leg that sits, radians."""
    seat = seat_of(patient)
    knee = np.array(seat.thigh_rad - seat.shank_rad)
    return seat.thigh_rad + float(trunk_lean(knee, knee)), float(knee)


def chair_scene(patient: Patient) -> Scene:
    """The chair behind the feet."""
    body, seat = patient.body, seat_of(patient)
    hip = -body.shank_m * sin(seat.shank_rad) - body.thigh_m * sin(seat.thigh_rad)
    front = hip + 0.5 * body.thigh_m * sin(seat.thigh_rad)
    chair = Block(kind=BlockKind.CHAIR, from_x_m=front - CHAIR_DEPTH_M, to_x_m=front, top_m=patient.gait.chair_height_m)
    return Scene(blocks=(chair,))


def transfer_movement(patient: Patient, duration_s: float, *, rising: bool) -> CartesianMotion:
    """Sitting down, or the same path back; the feet stay where they are."""
    body, seat = patient.body, seat_of(patient)
    thigh_up, shank_up = standing_segments(body)

    def seated(time: Array) -> Array:
        early = cruise(time, duration_s, ONSET_S, SETTLE * duration_s)
        s = EARLY * early + (1 - EARLY) * smoothstep(time, 0.0, duration_s)
        return 1 - s if rising else s

    def hip(time: Array) -> tuple[Array, Array]:
        s = seated(time)
        thigh = thigh_up + (seat.thigh_rad - thigh_up) * s
        forward = (RISING_SHANK_RAD - SEATED_SHANK_RAD) * 64 * (s * (1 - s)) ** 3
        shank = shank_up + (seat.shank_rad - shank_up) * s + forward
        x = -body.thigh_m * np.sin(thigh) - body.shank_m * np.sin(shank)
        z = body.ankle_height_m + body.thigh_m * np.cos(thigh) + body.shank_m * np.cos(shank)
        return x, z

    return CartesianMotion(
        duration_s=duration_s,
        hip_x_m=lambda time: hip(time)[0],
        hip_z_m=lambda time: hip(time)[1],
        feet_m=((0.0, 0.0), (0.0, 0.0)),
        right_share=lambda time: np.full_like(time, 0.5),
        seat_share=lambda time: smoothstep(seated(time), *SEAT_TAKES),
        scene=chair_scene(patient),
    )


def recovery_path(patient: Patient, start_rad: Array, stretch: float = 1.0) -> Path:
    """From a measured pose (4,) to standing, slowly: feet apart come together by a high step, together they stretch.

    stretch: of its time.
    """
    apart, duration = _apart(patient.body, start_rad), stretch * _recovery_time(start_rad)
    if np.abs(apart).max() <= SPLIT_M:
        return _straighten(patient, start_rad, duration)
    movement = _bring_feet_together(patient, start_rad, duration)
    gait = patient.gait
    unknown = replace(movement, scene=Scene(floor_m=max(gait.stair_rise_m, gait.obstacle_height_m)))
    swings = lifted(patient.body, unknown, gait.swing_clearance_m).swings
    return sample(patient.body, replace(movement, swings=swings))


def _recovery_time(start_rad: Array) -> float:
    standing = np.array([SOFT_KNEE_RAD / 2, SOFT_KNEE_RAD] * 2)
    return max(RECOVER_LEAST_S, float(np.abs(start_rad - standing).max()) / RECOVER_SPEED_RAD_S)


def _ankles(body: Body, start_rad: Array) -> Array:
    """Left and right ankle from the hip, (2, 2)."""
    knees = start_rad[1::2]
    return kinematics.ankle(body, start_rad[0::2], knees, trunk_lean(knees[0], knees[1]))


def _apart(body: Body, start_rad: Array) -> Array:
    left, right = _ankles(body, start_rad)
    apart: Array = right - left
    return apart


def _straighten(patient: Patient, start_rad: Array, duration: float) -> Path:
    """Thighs and knees straight to standing, the trunk leaning as it does in between."""
    body = patient.body
    time = ticks(duration)
    s = smoothstep(time, 0.0, duration)[:, None]
    knees = start_rad[1::2] + (SOFT_KNEE_RAD - start_rad[1::2]) * s
    thighs_at_start = start_rad[0::2] - trunk_lean(start_rad[1], start_rad[3])
    thigh_up, _ = standing_segments(body)
    thighs = thighs_at_start + (thigh_up - thighs_at_start) * s
    lean = trunk_lean(knees[:, 0], knees[:, 1])
    hips = thighs + lean[:, None]
    return path_of_joints(body, time, np.stack([hips[:, 0], knees[:, 0], hips[:, 1], knees[:, 1]], axis=-1), lean)


def _bring_feet_together(patient: Patient, start_rad: Array, duration: float) -> CartesianMotion:
    """The foot nearer under the hip stays; the other comes to it.

    Its lift is still to be found: above anything that this patient steps on or over, toes and all, so that the foot
    is free whichever action was interrupted.
    """
    body = patient.body
    ankles = _ankles(body, start_rad)
    load = np.abs(ankles[:, 0]) + (ankles[:, 1] - ankles[:, 1].min())
    stay = LEFT if load[LEFT] <= load[RIGHT] else RIGHT
    hip_x, hip_z = -ankles[stay]
    low, stand = body.ankle_height_m + hip_z, standing_hip_m(body)
    swing = _approach(ankles[1 - stay] - ankles[stay], duration)

    def right_share(time: Array) -> Array:
        even = 0.5 * smoothstep(time, swing.land_s, duration)
        return 1 - even if stay == RIGHT else even

    return CartesianMotion(
        duration_s=duration,
        hip_x_m=lambda time: hip_x * (1 - smoothstep(time, 0.0, duration)),
        hip_z_m=lambda time: low + (stand - low) * smoothstep(time, 0.0, duration),
        feet_m=by_side(stay, (0.0, 0.0), swing.start_m),
        swings=by_side(stay, (), (swing,)),
        right_share=right_share,
        scene=Scene(floor_m=min(0.0, swing.start_m[1])),
    )


def _approach(away_m: Array, duration: float) -> Swing:
    """How the foot comes that is (2,) metres away from the one that stays; down first or up first."""
    return Swing(
        rise_s=0.0,
        off_s=0.05 * duration,
        land_s=0.90 * duration,
        flat_s=duration,
        start_m=(float(away_m[0]), float(away_m[1])),
        end_m=(0.0, 0.0),
        shape=RECOVER_DOWN if away_m[1] > 0 else RECOVER_UP,
    )
