"""On the level: single steps, closing, and the periodic walk cut into one-step plans."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import pi, radians

import numpy as np

from app.motion.kinematics import (
    CLOSING,
    LEVEL,
    STRIDE,
    Array,
    Swing,
    SwingShape,
    hump,
    joints,
    leg_length,
    ramp,
    smoothstep,
)
from app.motion.path import LEFT, CartesianMotion, by_side, lifted, missing_reach
from app.motion.plan import Patient
from hal.joints.body import Body

SOFT_KNEE_RAD = radians(8)  # of a standing leg: a straight one can't be steered (the inverse is singular there)
LONGEST_KNEE_RAD = radians(6)  # a plan stretches no leg farther

# Walking, as shares of a step's time, 0 at the landing of the other foot.
TOE_OFF = 0.30  # double support lasts till here; the very slow gait of the literature stands two thirds of its cycle
HEEL_OFF = 0.05  # the other foot has landed before the rear heel rises
FLAT = 0.18  # after landing
LOWEST = 0.13  # the hip, a little before the middle of double support
AHEAD = 0.60  # share of the step length by which a landing foot is before the hip


def standing_hip_m(body: Body) -> float:
    """Height of the hip above the floor, both feet under it."""
    return body.ankle_height_m + leg_length(body, SOFT_KNEE_RAD)


def standing_segments(body: Body) -> tuple[float, float]:
    """World angles of thigh and shank of a standing leg, the ankle under the hip, radians."""
    leg = joints(body, np.array([0.0, -leg_length(body, SOFT_KNEE_RAD)]))
    return float(leg.hip), float(leg.hip - leg.knee)


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleStep:
    """One step from rest to rest: the hip's and the feet's places before and after, metres from the first hip."""

    swing_side: int
    hip_to_m: float
    stand_at_m: float
    swing_from_m: float
    swing_to_m: float
    shape: SwingShape


OFF, LAND = 0.28, 0.84  # a step from rest to rest: shares of its time at which its foot leaves and lands


def step_movement(patient: Patient, step: SingleStep, step_time_s: float) -> CartesianMotion:
    """The movement of one step from rest to rest."""
    off, land = OFF * step_time_s, LAND * step_time_s
    swing = Swing(
        rise_s=0.0,
        off_s=off,
        land_s=land,
        flat_s=step_time_s,
        start_m=(step.swing_from_m, 0.0),
        end_m=(step.swing_to_m, 0.0),
        shape=step.shape,
    )

    def right_share(time: Array) -> Array:
        lifted = 0.5 * (smoothstep(time, 0.0, off) - smoothstep(time, land, step_time_s))
        return 0.5 + lifted if step.swing_side == LEFT else 0.5 - lifted

    return CartesianMotion(
        duration_s=step_time_s,
        hip_x_m=lambda time: step.hip_to_m * smoothstep(time, 0.0, step_time_s),
        hip_z_m=lambda time: _step_height(patient.body, step, time, step_time_s),
        feet_m=by_side(step.swing_side, (step.swing_from_m, 0.0), (step.stand_at_m, 0.0)),
        swings=by_side(step.swing_side, (swing,), ()),
        right_share=right_share,
    )


def _step_height(body: Body, step: SingleStep, time: Array, step_time_s: float) -> Array:
    """The hip's height in a step from rest to rest: it vaults over the standing foot while the other is in the air."""
    start = _height_over(body, (step.stand_at_m, step.swing_from_m), 0.0)
    end = _height_over(body, (step.stand_at_m, step.swing_to_m), step.hip_to_m)
    s = smoothstep(time, 0.0, step_time_s)
    vault = _vault(body, step.hip_to_m * s - step.stand_at_m)
    at_ends = _vault(body, np.array([-step.stand_at_m, step.hip_to_m - step.stand_at_m]))
    line = at_ends[0] + (at_ends[1] - at_ends[0]) * s
    one_footed = hump(time, 0.0, OFF * step_time_s, LAND * step_time_s, step_time_s)
    height: Array = start + (end - start) * s + (vault - line) * one_footed
    return height


def start_step(patient: Patient, side: int) -> SingleStep:
    """From standing, one leg forward."""
    length = patient.gait.step_length_m
    return SingleStep(
        swing_side=side, hip_to_m=length / 2, stand_at_m=0.0, swing_from_m=0.0, swing_to_m=length, shape=LEVEL
    )


def onward_step(patient: Patient, side: int) -> SingleStep:
    """The rear leg to the front."""
    length = patient.gait.step_length_m
    return SingleStep(
        swing_side=side,
        hip_to_m=length,
        stand_at_m=length / 2,
        swing_from_m=-length / 2,
        swing_to_m=1.5 * length,
        shape=LEVEL,
    )


def closing_step(patient: Patient, side: int) -> SingleStep:
    """The rear leg beside the front one, to standing."""
    half = patient.gait.step_length_m / 2
    return SingleStep(
        swing_side=side, hip_to_m=half, stand_at_m=half, swing_from_m=-half, swing_to_m=half, shape=CLOSING
    )


def walk_start(patient: Patient, step_time_s: float) -> CartesianMotion:
    """From standing, left foot first, into the periodic walk: ends as the left foot lands."""
    length = patient.gait.step_length_m
    speed = length / step_time_s
    sink = _walking_sink(patient)
    begin = (1 - 2 * (1 - AHEAD)) * step_time_s  # so that the hip ends where the periodic walk has it

    def hip_x(time: Array) -> Array:
        return speed * ramp(time, begin, step_time_s)

    def hip_z(time: Array) -> Array:
        into = smoothstep(time, 0.0, step_time_s)
        return (1 - into) * standing_hip_m(patient.body) + into * _walking_height(patient, time / step_time_s, sink)

    left = _walk_swing(step_time_s, 0.0, (0.0, length))
    return CartesianMotion(
        duration_s=step_time_s,
        hip_x_m=hip_x,
        hip_z_m=hip_z,
        feet_m=((0.0, 0.0), (0.0, 0.0)),
        swings=((left,), ()),
        right_share=lambda time: 0.5 + 0.5 * smoothstep(time, 0.0, TOE_OFF * step_time_s),
    )


def walk_on(patient: Patient, side: int, step_time_s: float, sink_m: float | None = None) -> CartesianMotion:
    """One step of the periodic walk, from the landing of the other foot to the landing of this one."""
    length = patient.gait.step_length_m
    front = AHEAD * length
    sink = _walking_sink(patient) if sink_m is None else sink_m

    def share(time: Array) -> Array:
        over = smoothstep(time, 0.0, TOE_OFF * step_time_s)  # from the rear foot to the front one
        return over if side == LEFT else 1 - over

    rear_swing = _walk_swing(step_time_s, 0.0, (front - length, front + length))
    just_landed = _landed_swing(step_time_s, (front - 2 * length, front))
    return CartesianMotion(
        duration_s=step_time_s,
        hip_x_m=lambda time: length / step_time_s * time,
        hip_z_m=lambda time: _walking_height(patient, time / step_time_s, sink),
        feet_m=by_side(side, (front - length, 0.0), (front - 2 * length, 0.0)),
        swings=by_side(side, (rear_swing,), (just_landed,)),
        right_share=share,
    )


def walk_close(patient: Patient, side: int, step_time_s: float) -> CartesianMotion:
    """Out of the periodic walk: the rear foot comes beside the front one, the hip comes to rest above them."""
    length = patient.gait.step_length_m
    front = AHEAD * length
    sink = _walking_sink(patient)
    duration = 2 * AHEAD * step_time_s  # half the walking speed over the distance that is left

    def hip_x(time: Array) -> Array:
        return length / step_time_s * (time - ramp(time, 0.0, duration))

    def hip_z(time: Array) -> Array:
        out = smoothstep(time, 0.0, duration)
        return (1 - out) * _walking_height(patient, time / step_time_s, sink) + out * standing_hip_m(patient.body)

    def share(time: Array) -> Array:
        over = smoothstep(time, 0.0, TOE_OFF * step_time_s) - 0.5 * smoothstep(time, step_time_s, duration)
        return over if side == LEFT else 1 - over

    rear_swing = _walk_swing(step_time_s, 0.0, (front - length, front), shape=CLOSING)
    just_landed = _landed_swing(step_time_s, (front - 2 * length, front))
    return CartesianMotion(
        duration_s=duration,
        hip_x_m=hip_x,
        hip_z_m=hip_z,
        feet_m=by_side(side, (front - length, 0.0), (front - 2 * length, 0.0)),
        swings=by_side(side, (rear_swing,), (just_landed,)),
        right_share=share,
    )


def _walk_swing(
    step_time_s: float, landing_before_s: float, ground_m: tuple[float, float], shape: SwingShape = STRIDE
) -> Swing:
    return Swing(
        rise_s=landing_before_s + HEEL_OFF * step_time_s,
        off_s=landing_before_s + TOE_OFF * step_time_s,
        land_s=landing_before_s + step_time_s,
        flat_s=landing_before_s + (1 + FLAT) * step_time_s,
        start_m=(ground_m[0], 0.0),
        end_m=(ground_m[1], 0.0),
        shape=shape,
    )


def _landed_swing(step_time_s: float, ground_m: tuple[float, float]) -> Swing:
    """The swing that ended as this plan begins: its foot still comes down flat."""
    return _walk_swing(step_time_s, -step_time_s, ground_m)


def _walking_height(patient: Patient, steps: Array, sink_m: float) -> Array:
    """The hip's height in the periodic walk, lowest in double support; (n,) steps since a landing.

    It falls as far as a leg of standing length does that vaults from upright to where the front foot lands.
    """
    body, length = patient.body, patient.gait.step_length_m
    ends = _vault(body, np.array([AHEAD * length]))[0]
    half = (standing_hip_m(body) - ends) / 2
    middle = standing_hip_m(body) - half
    height: Array = middle - half * np.cos(2 * pi * (steps - LOWEST)) - sink_m
    return height


@lru_cache(maxsize=64)
def _walking_sink(patient: Patient) -> float:
    """How much lower than vaulting the hip must go so that every leg reaches, metres."""
    vaulting = lifted(patient.body, walk_on(patient, LEFT, 1.0, sink_m=0.0), patient.gait.swing_clearance_m)
    longest_m = leg_length(patient.body, LONGEST_KNEE_RAD)
    return missing_reach(patient.body, vaulting, longest_m, np.linspace(0.0, 1.0, 101))


def _vault(body: Body, along_m: Array) -> Array:
    """The hip's height over a foot when the leg keeps its standing length, (n,) metres along from above it."""
    reach = leg_length(body, SOFT_KNEE_RAD)
    height: Array = body.ankle_height_m + np.sqrt(np.maximum(reach * reach - along_m * along_m, 0.0))
    return height


def _height_over(body: Body, feet_m: tuple[float, float], hip_m: float) -> float:
    farthest = max(abs(foot - hip_m) for foot in feet_m)
    return float(_vault(body, np.array([farthest]))[0])
