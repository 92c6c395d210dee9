"""What a rehearsal is judged by: its figures, their limits, and what is said of those that pass them."""

from __future__ import annotations

from math import degrees, radians

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from app.ipc.messages import Quad
from app.motion import kinematics
from app.motion.outline import MID_SWING, outside
from hal.joints.body import Body
from hal.joints.scene import Scene
from hal.joints.simulated.wearer import Truth

RMS_LIMIT_RAD = radians(2.0)
CLEARANCE_LIMIT_M = 0.02
SLIDE_LIMIT_M = 0.02
PENETRATION_LIMIT_M = 0.005  # contacts in the simulation are a little soft
FALLEN_RAD = radians(10.0)  # of a joint from the pose it should end in
ALL_IT_HAS_NM = 1e-6  # a drive this near its limit was held there


class Verdict(Struct, frozen=True, kw_only=True):
    """One rehearsed action in figures; joints in the order of hal's Joint."""

    action: str
    passed: bool
    reasons: tuple[str, ...]
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


def objections(verdict: Verdict, missed_rad: float, *, struck: bool) -> tuple[str, ...]:
    """Everything that is wrong with it.

    missed_rad: the farthest joint's distance from the pose that it should end in; struck: a leg met the obstacle.
    """
    worst_rms = max(verdict.tracking_rms_deg)
    clearance_m = verdict.clearance_m
    found = [
        (missed_rad > FALLEN_RAD, f"It ends {degrees(missed_rad):.0f}° from where it should."),
        (worst_rms > degrees(RMS_LIMIT_RAD), f"Tracking error {worst_rms:.1f}° rms, at most 2° are allowed."),
        (
            _any_above(verdict.peak_speed_deg_s, verdict.speed_limit_deg_s),
            f"A joint turns at {max(verdict.peak_speed_deg_s):.0f}°/s, beyond its limit.",
        ),
        (
            _any_above(verdict.peak_torque_nm, verdict.torque_limit_nm, by=-ALL_IT_HAS_NM),
            f"A drive gives all it has, {max(verdict.peak_torque_nm):.0f} Nm.",
        ),
        (
            clearance_m is not None and clearance_m < CLEARANCE_LIMIT_M,
            f"A swinging foot passes at {100 * (clearance_m or 0):.1f} cm, at least 2 cm are needed.",
        ),
        (verdict.slide_m > SLIDE_LIMIT_M, f"A standing foot slides {100 * verdict.slide_m:.1f} cm."),
        (
            verdict.penetration_m > PENETRATION_LIMIT_M,
            f"Something sinks {1000 * verdict.penetration_m:.0f} mm into something.",
        ),
        (struck, "A leg strikes the obstacle."),
    ]
    return tuple(text for wrong, text in found if wrong)


def _any_above(values: Quad, limits: Quad, by: float = 0.0) -> bool:
    return any(value > limit + by for value, limit in zip(values, limits, strict=True))


Array = NDArray[np.float64]

AIRBORNE_N = 1.0  # a foot with less under it swings
STANDING_N = 60.0  # one with more stands
LEAST_SWING_M = 0.04  # shorter hops of a foot are no swings
LANDED_N = 30.0
LEAST_STEP_M = 0.03  # between two landings


def least_clearance(body: Body, truths: list[Truth], scene: Scene) -> float | None:
    """The least distance of a foot in mid-swing from floor and scene, metres; None when no foot swings.

    The scene stands as it was staged, with the feet where the first of the truths has them.
    """
    ankles = np.array([truth.ankle_m for truth in truths])
    origin = np.array([ankles[0, :, 0].mean(), ankles[0, :, 1].min() - body.ankle_height_m])
    least = None
    for side in (0, 1):
        heel, toe = _sole(body, truths, side)
        points = np.stack([heel + share * (toe - heel) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]) - origin
        gap = points[..., 1] - scene.floor_m
        for block in scene.blocks:
            gap = np.minimum(gap, outside(points, block.from_x_m, block.to_x_m, block.top_m))
        gap = gap.min(axis=0)
        for first, last in _runs(np.array([truth.contact_n[side] for truth in truths]) < AIRBORNE_N):
            way = ankles[first : last + 1, side, 0]
            if abs(way[-1] - way[0]) < LEAST_SWING_M:
                continue
            gone = (way - way[0]) / (way[-1] - way[0])
            middle = (gone > MID_SWING[0]) & (gone < MID_SWING[1])
            lowest = float(gap[first : last + 1][middle].min())
            least = lowest if least is None else min(least, lowest)
    return least


def most_slide(body: Body, truths: list[Truth]) -> float:
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
                way = np.concatenate([[0.0], np.cumsum(slid[first:last])])
                most = max(most, float(way.max() - way.min()))
    return most


def stride_m(truths: list[Truth]) -> float:
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


def _sole(body: Body, truths: list[Truth], side: int) -> tuple[Array, Array]:
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
