"""What the feet did in a simulation: how far they kept from things while swinging, how far they slid while standing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.control import kinematics
from app.control.trajectory_outline import MID_SWING, outside
from hal.joints.body import Body
from hal.joints.scene import Scene
from hal.joints.wearer import Truth

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
