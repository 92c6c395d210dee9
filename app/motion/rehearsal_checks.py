"""The figures of a rehearsal, their limits, and the faults where a limit is exceeded."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from math import radians

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from app.ipc.snapshot import Quad
from app.ipc.states import Action
from app.motion import kinematics
from app.motion.kinematics import Array
from app.motion.path import MID_SWING, SOLE_SHARES, distances
from app.motion.plan_check import LEAST_CLEARANCE_M
from hal.joints.body import Body
from hal.joints.scene import Scene
from hal.joints.simulated.wearer import GroundTruth
from logs.reason import Reason, reason

RMS_LIMIT_RAD = radians(2.0)
SLIDE_LIMIT_M = 0.02
PENETRATION_LIMIT_M = 0.005  # contacts in the simulation are a little soft
END_POSE_LIMIT_RAD = radians(10.0)  # of a joint from the pose it should end in: farther, the wearer has fallen
SATURATION_NM = 1e-6  # a drive this near its limit was held there


class RehearsalFault(Enum):
    """Why a rehearsal failed."""

    NOT_STIFFENED = "not stiffened"
    GUARD_REFUSED = "guard refused"
    WRONG_END_POSE = "wrong end pose"
    TRACKING_ERROR = "tracking error"
    TOO_FAST = "too fast"
    SATURATED = "saturated"
    TOO_LITTLE_CLEARANCE = "too little clearance"
    FOOT_SLIDES = "foot slides"
    PENETRATION = "penetration"
    STRIKES_OBSTACLE = "strikes the obstacle"
    NOT_CARRIED_OUT = "not carried out"  # action, why


class RehearsalVerdict(Struct, frozen=True, kw_only=True):
    """One rehearsed action in figures; joints in the order of hal's Joint."""

    action: Action
    passed: bool
    reasons: tuple[Reason, ...]
    duration_s: float = 0.0
    peak_torque_nm: Quad = (0.0, 0.0, 0.0, 0.0)
    torque_limit_nm: Quad = (0.0, 0.0, 0.0, 0.0)
    peak_speed_deg_s: Quad = (0.0, 0.0, 0.0, 0.0)
    speed_limit_deg_s: Quad = (0.0, 0.0, 0.0, 0.0)
    tracking_rms_deg: Quad = (0.0, 0.0, 0.0, 0.0)
    clearance_m: float | None = None  # None: no foot swings
    slide_m: float = 0.0
    penetration_m: float = 0.0
    contact_peak_n: float = 0.0
    stride_m: float = 0.0
    energy_j: float = 0.0
    temperature_c: float = 0.0
    balance_peak_nm: float = 0.0
    hold_peak_n: float = 0.0


def faults_of(verdict: RehearsalVerdict, end_error_rad: float, *, struck: bool) -> Iterator[Reason]:
    """Everything that is wrong with it.

    end_error_rad: the farthest joint's distance from the pose that it should end in; struck: a leg met the obstacle.
    """
    worst_rad = radians(max(verdict.tracking_rms_deg))
    clearance_m = verdict.clearance_m
    if end_error_rad > END_POSE_LIMIT_RAD:
        yield reason(RehearsalFault.WRONG_END_POSE, angle_rad=end_error_rad)
    if worst_rad > RMS_LIMIT_RAD:
        yield reason(RehearsalFault.TRACKING_ERROR, angle_rad=worst_rad, limit_rad=RMS_LIMIT_RAD)
    if _any_above(verdict.peak_speed_deg_s, verdict.speed_limit_deg_s):
        yield reason(RehearsalFault.TOO_FAST, speed_rad_s=radians(max(verdict.peak_speed_deg_s)))
    if _any_above(verdict.peak_torque_nm, verdict.torque_limit_nm, by=-SATURATION_NM):
        yield reason(RehearsalFault.SATURATED, torque_nm=max(verdict.peak_torque_nm))
    if clearance_m is not None and clearance_m < LEAST_CLEARANCE_M:
        yield reason(RehearsalFault.TOO_LITTLE_CLEARANCE, clearance_m=clearance_m, limit_m=LEAST_CLEARANCE_M)
    if verdict.slide_m > SLIDE_LIMIT_M:
        yield reason(RehearsalFault.FOOT_SLIDES, slide_m=verdict.slide_m)
    if verdict.penetration_m > PENETRATION_LIMIT_M:
        yield reason(RehearsalFault.PENETRATION, depth_m=verdict.penetration_m)
    if struck:
        yield reason(RehearsalFault.STRIKES_OBSTACLE)


def _any_above(values: Quad, limits: Quad, by: float = 0.0) -> bool:
    return any(value > limit + by for value, limit in zip(values, limits, strict=True))


AIRBORNE_N = 1.0  # a foot with less under it swings
STANDING_N = 60.0  # one with more stands
LEAST_SWING_M = 0.04  # shorter hops of a foot are no swings
LANDED_N = 30.0
LEAST_STEP_M = 0.03  # between two landings


def least_clearance(body: Body, truths: list[GroundTruth], scene: Scene) -> float | None:
    """The least distance of a foot in mid-swing from floor and scene, metres; None when no foot swings.

    The scene stands as it was staged, with the feet where the first of the truths has them.
    """
    ankles = np.array([truth.ankle_m for truth in truths])
    origin = np.array([ankles[0, :, 0].mean(), ankles[0, :, 1].min() - body.ankle_height_m])
    least = None
    for side in (0, 1):
        heel, toe = _sole(body, truths, side)
        gap = distances(np.stack([heel + share * (toe - heel) for share in SOLE_SHARES]) - origin, scene)
        for first, last in _runs(np.array([truth.contact_n[side] for truth in truths]) < AIRBORNE_N):
            travel = ankles[first : last + 1, side, 0]
            if abs(travel[-1] - travel[0]) < LEAST_SWING_M:
                continue
            gone = (travel - travel[0]) / (travel[-1] - travel[0])
            middle = (gone > MID_SWING[0]) & (gone < MID_SWING[1])
            lowest = float(gap[first : last + 1][middle].min())
            least = lowest if least is None else min(least, lowest)
    return least


def most_slide(body: Body, truths: list[GroundTruth]) -> float:
    """How far a standing foot moved over what it stands on at most, metres.

    A foot that rolls keeps its heel or its toe where it is, so each moment counts the one that moved less.
    """
    most = 0.0
    for side in (0, 1):
        heel, toe = _sole(body, truths, side)
        moved = np.stack([np.diff(heel[:, 0]), np.diff(toe[:, 0])])
        slid = np.take_along_axis(moved, np.abs(moved).argmin(axis=0)[None], axis=0)[0]
        for first, last in _runs(np.array([truth.contact_n[side] for truth in truths]) > STANDING_N):
            if last > first:
                travel = np.concatenate([[0.0], np.cumsum(slid[first:last])])
                most = max(most, float(travel.max() - travel.min()))
    return most


def stride_m(truths: list[GroundTruth]) -> float:
    """Twice the mean distance between the landings of the feet in a walk, metres."""
    ankles = np.array([truth.ankle_m[:, 0] for truth in truths])
    loaded = np.array([truth.contact_n for truth in truths]) > LANDED_N
    landings = sorted(
        float(ankles[tick + 1, side])
        for side in (0, 1)
        for tick in np.flatnonzero(~loaded[:-1, side] & loaded[1:, side])
    )
    apart = np.diff(landings)
    steps = apart[apart > LEAST_STEP_M]
    return 2 * float(np.median(steps)) if steps.size else 0.0


def _sole(body: Body, truths: list[GroundTruth], side: int) -> tuple[Array, Array]:
    """Heel and toe of one foot, each (n, 2) metres."""
    ankle = np.array([truth.ankle_m[side] for truth in truths])
    joints = np.array([truth.joints_rad[2 * side : 2 * side + 2] for truth in truths])
    lean = np.array([truth.lean_rad for truth in truths])
    bent = np.array([truth.ankle_rad[side] for truth in truths])
    heel, toe = kinematics.sole(body, kinematics.shank_angle(joints[:, 0], joints[:, 1], lean) + bent)
    return ankle + heel, ankle + toe


def _runs(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of True that begins and ends inside, or spans the whole."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(int)))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]
