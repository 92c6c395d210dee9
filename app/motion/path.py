"""A movement in space, before joints: where hip and feet go and when, and what stands around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from app.motion import kinematics
from app.motion.kinematics import Array, Mask, Swing, displacement, heel_rise, hump, landing_pitch, progress
from hal.joints.body import ANKLE_REST_RAD, Body, trunk_lean
from hal.joints.protocol import TICK_HZ
from hal.joints.scene import LEVEL_FLOOR, Scene

T = TypeVar("T")

LEFT, RIGHT = 0, 1
SOLE_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # points of a sole from heel to toe
MID_SWING = (0.2, 0.8)  # shares of the travel forward between which a foot must keep its clearance
COARSE = 10  # ticks between the samples on which a lift is sought
LIFT_PRECISION_M = 0.001
LIFT_ROUNDS = 8


def by_side(side: int, own: T, other: T) -> tuple[T, T]:
    """Left and right: `own` belongs to this side."""
    return (own, other) if side == LEFT else (other, own)


@dataclass(frozen=True, slots=True, kw_only=True)
class CartesianMotion:
    """Where hip and feet go; functions take times (n,) in seconds and give metres or shares, (n,) each."""

    duration_s: float
    hip_x_m: Callable[[Array], Array]
    hip_z_m: Callable[[Array], Array]  # above the floor
    feet_m: tuple[tuple[float, float], tuple[float, float]]  # (x, floor height) of left and right ankle at first
    swings: tuple[tuple[Swing, ...], tuple[Swing, ...]] = ((), ())  # of left and right, in order
    right_share: Callable[[Array], Array]  # of the weight on the feet, on the right one
    seat_share: Callable[[Array], Array] | None = None  # of the weight, on a chair
    scene: Scene = LEVEL_FLOOR


@dataclass(frozen=True, slots=True, kw_only=True)
class Foot:
    """One foot along a movement."""

    ankle_m: Array  # (n, 2)
    pitch_rad: Array  # (n,), toe up; of the passive foot: flat, rolling, or square to the shank in the air
    share: Array  # (n,), of the weight on the feet
    mid_swing: Mask  # (n,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """A movement sampled: (n,) times, (n, 2) hip, (n, 4) joints in the order of hal's Joint, (n,) lean."""

    time_s: Array
    hip_m: Array
    lean_rad: Array
    joints_rad: Array
    feet: tuple[Foot, Foot]
    seat_share: Array
    scene: Scene


def ticks(duration_s: float, step: int = 1) -> Array:
    """Times of the ticks from 0 to the duration, seconds, (n,)."""
    times: Array = np.arange(0, max(2, round(duration_s * TICK_HZ)) + 1, step) / TICK_HZ
    return times


def sample(body: Body, movement: CartesianMotion, step: int = 1) -> Path:
    """The path that a movement makes, every `step` ticks; joints are NaN where a leg does not reach."""
    time = ticks(movement.duration_s, step)
    hip = np.stack([movement.hip_x_m(time), movement.hip_z_m(time)], axis=-1)
    ankles = [ankle_path(body, movement, side, time) for side in (LEFT, RIGHT)]
    legs = [kinematics.joints(body, ankle - hip) for ankle in ankles]
    lean = trunk_lean(legs[LEFT].knee, legs[RIGHT].knee)
    right = movement.right_share(time)
    shares = (1 - right, right)
    feet = [
        _foot(movement.swings[side], time, ankles[side], legs[side].hip - legs[side].knee, shares[side])
        for side in (LEFT, RIGHT)
    ]
    return Path(
        time_s=time,
        hip_m=hip,
        lean_rad=lean,
        joints_rad=np.stack(
            [legs[LEFT].hip + lean, legs[LEFT].knee, legs[RIGHT].hip + lean, legs[RIGHT].knee], axis=-1
        ),
        feet=(feet[LEFT], feet[RIGHT]),
        seat_share=np.zeros_like(time) if movement.seat_share is None else movement.seat_share(time),
        scene=movement.scene,
    )


def path_of_joints(body: Body, time: Array, joints_rad: Array, lean_rad: Array) -> Path:
    """A path given by joints (n, 4), both feet on the floor; the left one does not move."""
    ankles = [
        kinematics.ankle(body, joints_rad[:, 2 * side], joints_rad[:, 2 * side + 1], lean_rad) for side in (LEFT, RIGHT)
    ]
    hip = np.array([0.0, body.ankle_height_m]) - ankles[LEFT]
    still = np.zeros(len(time), dtype=bool)
    feet = [
        Foot(ankle_m=hip + ankle, pitch_rad=np.zeros(len(time)), share=np.full(len(time), 0.5), mid_swing=still)
        for ankle in ankles
    ]
    return Path(
        time_s=time,
        hip_m=hip,
        lean_rad=lean_rad,
        joints_rad=joints_rad,
        feet=(feet[LEFT], feet[RIGHT]),
        seat_share=np.zeros(len(time)),
        scene=LEVEL_FLOOR,
    )


def lifted(body: Body, movement: CartesianMotion, clearance_m: float) -> CartesianMotion:
    """The movement with each swing lifted as far as the clearance asks, and no farther."""
    for _ in range(LIFT_ROUNDS):
        path = sample(body, movement, COARSE)
        missing = [
            [_missing(body, path, side, swing, clearance_m) for swing in movement.swings[side]]
            for side in (LEFT, RIGHT)
        ]
        if max((lack for side in missing for lack in side), default=0.0) < LIFT_PRECISION_M:
            break
        raised = tuple(
            tuple(
                replace(swing, lift_m=swing.lift_m + lack)
                for swing, lack in zip(movement.swings[side], missing[side], strict=True)
            )
            for side in (LEFT, RIGHT)
        )
        movement = replace(movement, swings=(raised[LEFT], raised[RIGHT]))
    return movement


def reaching(body: Body, movement: CartesianMotion, longest_m: float) -> CartesianMotion:
    """The movement with the hip as much lower in between as the legs need to reach their feet."""
    lack = missing_reach(body, movement, longest_m, ticks(movement.duration_s, COARSE))
    if lack <= 0:
        return movement
    total = movement.duration_s

    def lower(time: Array) -> Array:
        height: Array = movement.hip_z_m(time) - lack * hump(time, 0.0, 0.3 * total, 0.7 * total, total)
        return height

    return replace(movement, hip_z_m=lower)


def missing_reach(body: Body, movement: CartesianMotion, longest_m: float, time: Array) -> float:
    """By how much the hip is too high at most for legs of that length to reach their feet, metres; 0: they do."""
    hip_x, hip_z = movement.hip_x_m(time), movement.hip_z_m(time)
    lack = 0.0
    for side in (LEFT, RIGHT):
        foot = ankle_path(body, movement, side, time)
        reach = np.sqrt(np.maximum(longest_m**2 - (foot[:, 0] - hip_x) ** 2, 0.0))
        lack = max(lack, float((hip_z - foot[:, 1] - reach).max()))
    return lack


def clearances(body: Body, path: Path, side: int) -> Array:
    """Distance of one foot from everything below and around it, (n,) metres, negative inside."""
    foot = path.feet[side]
    heel, toe = kinematics.sole(body, foot.pitch_rad)
    return distances(np.stack([foot.ankle_m + heel + share * (toe - heel) for share in SOLE_SHARES]), path.scene)


def distances(points_m: Array, scene: Scene) -> Array:
    """Least distance of points (k, n, 2) from everything in a scene, (n,) metres, negative inside."""
    distance = points_m[..., 1] - scene.floor_m
    for block in scene.blocks:
        distance = np.minimum(distance, _outside(points_m, block.from_x_m, block.to_x_m, block.top_m))
    nearest: Array = distance.min(axis=0)
    return nearest


def _missing(body: Body, path: Path, side: int, swing: Swing, clearance_m: float) -> float:
    share = progress(swing, path.time_s)
    over = (share > MID_SWING[0]) & (share < MID_SWING[1])
    if not over.any():
        return 0.0
    lack = clearance_m - clearances(body, path, side)[over]
    worst = float(np.nan_to_num(lack, nan=0.0).max())
    return max(0.0, worst)


def ankle_path(body: Body, movement: CartesianMotion, side: int, time: Array) -> Array:
    """Where one foot's ankle is, (n, 2) metres."""
    x, floor = movement.feet_m[side]
    place = np.full((len(time), 2), (x, floor + body.ankle_height_m))
    for swing in movement.swings[side]:
        place += displacement(body, swing, time)
    return place


def _foot(swings: tuple[Swing, ...], time: Array, ankle: Array, shank: Array, share: Array) -> Foot:
    mid = np.zeros(len(time), dtype=bool)
    pitch = np.zeros(len(time))
    for swing in swings:
        in_air = (time > swing.off_s) & (time < swing.land_s)
        gone = progress(swing, time)
        rolled = np.where(time <= swing.off_s, -heel_rise(swing, time), landing_pitch(swing, time))
        pitch += np.where(in_air, shank + ANKLE_REST_RAD, rolled)
        mid |= in_air & (gone > MID_SWING[0]) & (gone < MID_SWING[1])
    return Foot(ankle_m=ankle, pitch_rad=pitch, share=share, mid_swing=mid)


def _outside(points: Array, from_x: float, to_x: float, top: float) -> Array:
    """Signed distance of points (..., 2) from a block that stands on the floor."""
    across = np.maximum(from_x - points[..., 0], points[..., 0] - to_x)
    above = points[..., 1] - top
    outside = np.hypot(np.maximum(across, 0.0), np.maximum(above, 0.0))
    inside = np.minimum(np.maximum(across, above), 0.0)
    distance: Array = outside + inside
    return distance
