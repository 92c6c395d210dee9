"""A whole path against the patient and the device: reach, ranges, speed, torque, clearance; refusals with numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from app.motion.kinematics import Array
from app.motion.path import LEFT, RIGHT, Foot, Path, clearances
from app.motion.plan import Patient, PlanCheck, PlanFault, quad
from hal.joints.body import (
    ANKLE_DORSIFLEXION_NM_RAD,
    ANKLE_PLANTARFLEXION_NM_RAD,
    ANKLE_REST_RAD,
    COM_OF_SHANK,
    COM_OF_THIGH,
    DEVICE_ON_SHANK,
    DEVICE_ON_THIGH,
    GYRATION_OF_SHANK,
    GYRATION_OF_THIGH,
    TRUNK_COM_OF_STATURE,
    Body,
)
from hal.joints.protocol import TICK_HZ, Joint
from logs.reason import Reason, reason

LEAST_CLEARANCE_M = 0.02
ROUNDING_RAD = 1e-9  # of angles computed to lie on a limit
NOT_SWINGING_M = 1.0  # clearance reported for a movement without a swing


def check_path(patient: Patient, path: Path, velocity_rad_s: Array, torque_nm: Array) -> PlanCheck:
    """Everything about a path; (n, 4) velocity and torque. `reason` holds the first thing that is wrong."""
    if np.isnan(path.joints_rad).any():
        return PlanCheck(reason=_out_of_reach(path))
    clearance = mid_swing_clearance(patient, path)
    speed, torque = np.abs(velocity_rad_s).max(axis=0), np.abs(torque_nm).max(axis=0)
    return PlanCheck(
        reason=next(_faults(patient, path, speed, torque, clearance), None),
        peak_speed_rad_s=quad(speed),
        peak_torque_nm=quad(torque),
        min_clearance_m=clearance,
    )


def mid_swing_clearance(patient: Patient, path: Path) -> float:
    """The least distance of a foot in mid-swing from floor and scene, metres."""
    least = NOT_SWINGING_M
    for side in (LEFT, RIGHT):
        over = path.feet[side].mid_swing
        if over.any():
            least = min(least, float(clearances(patient.body, path, side)[over].min()))
    return least


def _faults(patient: Patient, path: Path, speed: Array, torque: Array, clearance: float) -> Iterator[Reason]:
    lowest, highest = path.joints_rad.min(axis=0), path.joints_rad.max(axis=0)
    for joint in Joint:
        low, high = float(patient.low_rad[joint]), float(patient.high_rad[joint])
        if highest[joint] > high + ROUNDING_RAD:
            yield reason(PlanFault.BEYOND_FLEXION, joint=joint, angle_rad=float(highest[joint]), limit_rad=high)
        if lowest[joint] < low - ROUNDING_RAD:
            yield reason(PlanFault.BEYOND_EXTENSION, joint=joint, angle_rad=float(lowest[joint]), limit_rad=low)
        fastest = float(patient.speed_rad_s[joint])
        if speed[joint] > fastest:
            yield reason(PlanFault.TOO_FAST, joint=joint, speed_rad_s=float(speed[joint]), limit_rad_s=fastest)
        strongest = float(patient.torque_nm[joint])
        if torque[joint] > strongest:
            yield reason(PlanFault.TOO_MUCH_TORQUE, joint=joint, torque_nm=float(torque[joint]), limit_nm=strongest)
    if clearance < LEAST_CLEARANCE_M:
        yield reason(PlanFault.TOO_LITTLE_CLEARANCE, clearance_m=clearance, limit_m=LEAST_CLEARANCE_M)


def _out_of_reach(path: Path) -> Reason:
    lost = np.isnan(path.joints_rad)
    fault = PlanFault.LEFT_LEG_TOO_SHORT if lost[:, 1].any() else PlanFault.RIGHT_LEG_TOO_SHORT
    return reason(fault, share=float(np.argmax(lost.any(axis=1)) / len(lost)))


GRAVITY_M_S2 = 9.81
_UP = np.array([0.0, 1.0])


class _Segment(NamedTuple):
    """A moving mass: place and acceleration with gravity (n, 2), angular acceleration (n,)."""

    mass_kg: float
    inertia_kgm2: float
    place_m: Array
    pull_m_s2: Array  # acceleration less that of a falling body
    turn_rad_s2: Array


def joint_torques(patient: Patient, path: Path) -> Array:
    """Torque of each joint along a path, (n, 4) Nm, flexing positive; drives' own inertia and friction not included."""
    legs = [_leg(patient, path, side) for side in (LEFT, RIGHT)]
    ground = _ground_force(patient, path, legs)
    torques = [_leg_torques(patient.body, path, side, legs[side], ground) for side in (LEFT, RIGHT)]
    return np.concatenate(torques, axis=1)


def ankle_moment(dorsiflexion_rad: Array) -> Array:
    """The passive ankle's moment on the foot, (n,) Nm, toe-down positive when dorsiflexed."""
    bent = dorsiflexion_rad - ANKLE_REST_RAD
    moment: Array = np.where(bent > 0, ANKLE_DORSIFLEXION_NM_RAD, ANKLE_PLANTARFLEXION_NM_RAD) * bent
    return moment


def _leg(patient: Patient, path: Path, side: int) -> list[_Segment]:
    """Thigh, shank, foot."""
    body, foot = patient.body, path.feet[side]
    thigh = path.joints_rad[:, 2 * side] - path.lean_rad
    shank = thigh - path.joints_rad[:, 2 * side + 1]
    knee = path.hip_m + body.thigh_m * _along(thigh)
    return [
        _segment(
            body.thigh_kg + DEVICE_ON_THIGH * patient.device_kg,
            GYRATION_OF_THIGH * body.thigh_m,
            path.hip_m + COM_OF_THIGH * body.thigh_m * _along(thigh),
            thigh,
        ),
        _segment(
            body.shank_kg + DEVICE_ON_SHANK * patient.device_kg,
            GYRATION_OF_SHANK * body.shank_m,
            knee + COM_OF_SHANK * body.shank_m * _along(shank),
            shank,
        ),
        _segment(body.foot_kg, 0.0, foot.ankle_m, shank),
    ]


def _ground_force(patient: Patient, path: Path, legs: list[list[_Segment]]) -> Array:
    """Of both feet together, (n, 2) newtons."""
    body = patient.body
    trunk_kg = body.trunk_kg + (1 - 2 * DEVICE_ON_THIGH - 2 * DEVICE_ON_SHANK) * patient.device_kg
    height = TRUNK_COM_OF_STATURE * body.stature_m
    place = path.hip_m + height * np.stack([np.sin(path.lean_rad), np.cos(path.lean_rad)], axis=-1)
    segments = [_segment(trunk_kg, 0.0, place, path.lean_rad), *legs[LEFT], *legs[RIGHT]]
    total = sum(segment.mass_kg for segment in segments)
    force = np.sum([segment.mass_kg * segment.pull_m_s2 for segment in segments], axis=0)
    supported_n = body.body_weight_support * total * GRAVITY_M_S2
    on_ground: Array = (force - supported_n * _UP) * (1 - path.seat_share)[:, None]
    return on_ground


def _leg_torques(body: Body, path: Path, side: int, leg: list[_Segment], ground_n: Array) -> Array:
    thigh, shank, foot = leg
    knee = path.hip_m + (thigh.place_m - path.hip_m) / COM_OF_THIGH
    force = ground_n * path.feet[side].share[:, None]
    at_ankle = _foot_moment(body, path, side, path.feet[side], force)
    hip = _needed(path.hip_m, [thigh, shank, foot]) - _cross(foot.place_m - path.hip_m, force) - at_ankle
    knee_torque = _cross(foot.place_m - knee, force) + at_ankle - _needed(knee, [shank, foot])
    return np.stack([hip, knee_torque], axis=-1)


def _foot_moment(body: Body, path: Path, side: int, foot: Foot, force: Array) -> Array:
    """Of the ground's force about the ankle: as much as the passive ankle holds, and the sole can carry; (n,) Nm."""
    shank = path.joints_rad[:, 2 * side] - path.lean_rad - path.joints_rad[:, 2 * side + 1]
    held = ankle_moment(foot.pitch_rad - shank)
    down = np.maximum(force[:, 1], 0.0)
    moment: Array = np.clip(held, -body.heel_m * down, body.toe_m * down)
    return moment


def _needed(about_m: Array, segments: list[_Segment]) -> Array:
    """Moment about a place that moves and carries these segments, (n,) Nm."""
    moment: Array = np.sum(
        [
            segment.mass_kg * _cross(segment.place_m - about_m, segment.pull_m_s2)
            + segment.inertia_kgm2 * segment.turn_rad_s2
            for segment in segments
        ],
        axis=0,
    )
    return moment


def _segment(mass_kg: float, gyration_m: float, place_m: Array, angle_rad: Array) -> _Segment:
    return _Segment(
        mass_kg, mass_kg * gyration_m**2, place_m, _second(place_m) + GRAVITY_M_S2 * _UP, _second(angle_rad)
    )


def _along(angle: Array) -> Array:
    return np.stack([np.sin(angle), -np.cos(angle)], axis=-1)


def _cross(arm: Array, force: Array) -> Array:
    turned: Array = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    return turned


def _second(values: Array) -> Array:
    """Second derivative by central differences, the ends repeated."""
    inner = (values[2:] - 2 * values[1:-1] + values[:-2]) * TICK_HZ**2
    return np.concatenate([inner[:1], inner, inner[-1:]])
