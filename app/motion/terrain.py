"""Over things: up a stair, down a stair, across an obstacle; the right leg first, then the left, to standing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from app.motion.kinematics import DOWN, OVER, UP, Array, Swing, SwingShape, about_heel, hump, leg_length, smoothstep
from app.motion.path import CartesianMotion
from app.motion.plan import Patient
from app.motion.walking import LONGEST_KNEE_RAD, standing_hip_m
from hal.joints.scene import Block, BlockKind, Scene

GAP_M = 0.03  # between the toes and what stands before them
RISER_GAP_M = 0.065  # the rising foot points its toes down and forward
LANDING_M = 5.0  # the floor that a stair leads to

# Shares of an action's time.
RIGHT_OFF, RIGHT_LANDS = 0.06, 0.42
LEFT_OFF, LEFT_LANDS = 0.58, 0.95
TWO_SWINGS = 3.0  # times the step time: two swings and what lies between


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Two swings that carry both feet as far and as high, and the hip's path between: places and heights in metres."""

    travel_m: float
    climb_m: float
    shape: SwingShape
    hip_first_m: float  # where the hip is as the right foot lands
    hip_second_m: float  # where it is as the left foot leaves
    hip_drop_m: float  # how far below standing it is then
    scene: Scene


def stair_up(patient: Patient) -> Crossing:
    """The feet stand before a stair; they end on it, as far from the next."""
    rise, tread = patient.gait.stair_rise_m, patient.gait.stair_tread_m
    edge = patient.body.toe_m + RISER_GAP_M
    step = Block(kind=BlockKind.STEP, from_x_m=edge, to_x_m=edge + LANDING_M, top_m=rise)
    return Crossing(
        travel_m=tread,
        climb_m=rise,
        shape=UP,
        hip_first_m=0.40 * tread,
        hip_second_m=0.60 * tread,
        hip_drop_m=0.012,
        scene=Scene(blocks=(step,)),
    )


def stair_down(patient: Patient) -> Crossing:
    """The feet stand with the toes over the edge, so far that after the step they stand so again."""
    body, rise, tread = patient.body, patient.gait.stair_rise_m, patient.gait.stair_tread_m
    edge = min(body.toe_m, tread - body.heel_m) - GAP_M
    first = -0.28 * tread  # behind the bent leg's foot, so that hip and knee share the load
    reach = leg_length(body, LONGEST_KNEE_RAD)
    heel_back, heel_up = about_heel(body, np.array([DOWN.land_pitch_rad]))[0]
    height = sqrt(max(reach * reach - (tread + heel_back - first) ** 2, 0.0)) + body.ankle_height_m + heel_up - rise
    step = Block(kind=BlockKind.STEP, from_x_m=edge - LANDING_M, to_x_m=edge, top_m=0.0)
    return Crossing(
        travel_m=tread,
        climb_m=-rise,
        shape=DOWN,
        hip_first_m=first,
        hip_second_m=0.42 * tread,
        hip_drop_m=float(standing_hip_m(body) - height),
        scene=Scene(floor_m=-rise, blocks=(step,)),
    )


def obstacle(patient: Patient) -> Crossing:
    """The feet stand before the obstacle; they end behind it."""
    body, gait = patient.body, patient.gait
    start = body.toe_m + GAP_M
    end = start + gait.obstacle_depth_m
    travel = end + GAP_M + body.heel_m
    reach = leg_length(body, LONGEST_KNEE_RAD)
    height = sqrt(max(reach * reach - (0.62 * travel) ** 2, 0.0)) + body.ankle_height_m
    thing = Block(kind=BlockKind.OBSTACLE, from_x_m=start, to_x_m=end, top_m=gait.obstacle_height_m)
    return Crossing(
        travel_m=travel,
        climb_m=0.0,
        shape=OVER,
        hip_first_m=0.38 * travel,
        hip_second_m=0.66 * travel,
        hip_drop_m=standing_hip_m(body) - height,
        scene=Scene(blocks=(thing,)),
    )


def crossing_movement(patient: Patient, crossing: Crossing, step_time_s: float) -> CartesianMotion:
    """Both swings, and the hip between them."""
    total = TWO_SWINGS * step_time_s
    stand = standing_hip_m(patient.body)
    return CartesianMotion(
        duration_s=total,
        hip_x_m=lambda time: _hip_x(crossing, time / total),
        hip_z_m=lambda time: stand + _hip_z(crossing, time / total),
        feet_m=((0.0, 0.0), (0.0, 0.0)),
        swings=_swings(crossing, total),
        right_share=lambda time: _right_share(time / total),
        scene=crossing.scene,
    )


def _swings(crossing: Crossing, total_s: float) -> tuple[tuple[Swing, ...], tuple[Swing, ...]]:
    """Of left and right; the right foot goes first and both swing alike."""
    right = Swing(
        rise_s=0.0,
        off_s=RIGHT_OFF * total_s,
        land_s=RIGHT_LANDS * total_s,
        flat_s=(RIGHT_LANDS + 0.06) * total_s,
        start_m=(0.0, 0.0),
        end_m=(crossing.travel_m, crossing.climb_m),
        shape=crossing.shape,
    )
    left = replace(
        right,
        rise_s=(RIGHT_LANDS + 0.02) * total_s,
        off_s=LEFT_OFF * total_s,
        land_s=LEFT_LANDS * total_s,
        flat_s=total_s,
    )
    return (left,), (right,)


def _hip_x(crossing: Crossing, share: Array) -> Array:
    """The hip's travel forward, metres; (n,) shares of the time."""
    first, second = crossing.hip_first_m, crossing.hip_second_m
    to_first = smoothstep(share, 0.0, RIGHT_LANDS)
    to_second = smoothstep(share, RIGHT_LANDS - 0.06, LEFT_OFF + 0.08)
    to_end = smoothstep(share, LEFT_OFF - 0.04, LEFT_LANDS)
    return first * to_first + (second - first) * to_second + (crossing.travel_m - second) * to_end


def _hip_z(crossing: Crossing, share: Array) -> Array:
    """The hip's height over standing at the start, metres; (n,) shares of the time."""
    dip = hump(share, 0.02, RIGHT_LANDS, RIGHT_LANDS, 0.9)
    return crossing.climb_m * smoothstep(share, 0.40, 0.92) - crossing.hip_drop_m * dip


def _right_share(share: Array) -> Array:
    """Of the weight on the feet, on the right one; (n,) shares of the time."""
    off = smoothstep(share, 0.0, RIGHT_OFF)
    on = smoothstep(share, RIGHT_LANDS, LEFT_OFF)
    even = smoothstep(share, LEFT_LANDS, 1.0)
    return 0.5 - 0.5 * off + on - 0.5 * even
