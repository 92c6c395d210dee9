"""From an action to a checked plan: movement in space, joints by inverse kinematics, torques, check. Pure.

A plan starts at the measured pose: the nominal movement of its state, and the difference to the measured pose, which
fades while it moves. Steps inside a walk start where the step before them ends, in motion, and take no measured pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import radians

import numpy as np

from app.ipc.states import Action, GaitState
from app.motion import kinematics
from app.motion.kinematics import Array, leg_length, smoothstep
from app.motion.path import LEFT, RIGHT, CartesianMotion, Path, lifted, reaching, sample
from app.motion.plan import Patient, Phase, Plan, PlanCheck, PlanFault, PlanRequest
from app.motion.plan_check import check_path, joint_torques
from app.motion.terrain import Crossing, crossing_movement, obstacle, stair_down, stair_up
from app.motion.transfer import recovery_path, seated_joints, transfer_movement
from app.motion.walking import (
    LONGEST_KNEE_RAD,
    SOFT_KNEE_RAD,
    SingleStep,
    closing_step,
    onward_step,
    standing_segments,
    start_step,
    step_movement,
    walk_close,
    walk_on,
    walk_start,
)
from app.system.errors import AppError
from hal.joints.guard import ENGAGE_RAD
from hal.joints.protocol import TICK_HZ, JointArray
from hal.joints.scene import LEVEL_FLOOR, Scene
from logs.reason import reason, reason_of

FADE_S = 0.6  # a difference between measured and nominal pose fades within this
FAR_RAD = radians(12)  # farther than this from its state's pose no action starts

STRETCHES = (1.0, 1.15, 1.3, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0)  # of a movement's time, tried in turn

Build = Callable[[Patient, float], CartesianMotion]  # patient, stretch of time (1: as the profile has it)


def _single(step: Callable[[Patient, int], SingleStep], side: int) -> Build:
    return lambda patient, stretch: step_movement(patient, step(patient, side), stretch * patient.gait.step_time_s)


def _crossing(over: Callable[[Patient], Crossing]) -> Build:
    return lambda patient, stretch: crossing_movement(patient, over(patient), stretch * patient.gait.step_time_s)


def _walk(phase: Callable[[Patient, int, float], CartesianMotion], side: int) -> Build:
    return lambda patient, stretch: phase(patient, side, stretch * patient.gait.step_time_s)


def _transfer(*, rising: bool) -> Build:
    return lambda patient, stretch: transfer_movement(patient, stretch * patient.gait.transfer_time_s, rising=rising)


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """How one movement is made, and where it leads."""

    build: Build
    to_state: GaitState
    steps: int = 0
    chained: bool = False  # starts in motion, where the step before it ends
    speed_share: float = 1.0  # of the speed that a plan may use, before the measured pose is blended in


# Over an obstacle both joints of a leg turn back at once: after a pause of 50 ms, at the full speed of plans, the leg
# swung back beyond the drives' limit (docs/safety.md, "How long commands may be missing").
OBSTACLE_SPEED_SHARE = 0.8

S, A, P = GaitState, Action, Phase
RECIPES: dict[tuple[Action, Phase], Recipe] = {
    (A.STEP_RIGHT_FIRST, P.WHOLE): Recipe(build=_single(start_step, RIGHT), to_state=S.RIGHT_FORWARD, steps=1),
    (A.STEP_LEFT, P.WHOLE): Recipe(build=_single(onward_step, LEFT), to_state=S.LEFT_FORWARD, steps=1),
    (A.STEP_RIGHT, P.WHOLE): Recipe(build=_single(onward_step, RIGHT), to_state=S.RIGHT_FORWARD, steps=1),
    (A.STEP_END, P.WHOLE): Recipe(build=_single(closing_step, LEFT), to_state=S.STANDING, steps=1),
    (A.WALK, P.WALK_START): Recipe(
        build=lambda patient, stretch: walk_start(patient, stretch * patient.gait.step_time_s),
        to_state=S.LEFT_FORWARD,
        steps=1,
    ),
    (A.WALK, P.WALK_RIGHT): Recipe(build=_walk(walk_on, RIGHT), to_state=S.RIGHT_FORWARD, steps=1, chained=True),
    (A.WALK, P.WALK_LEFT): Recipe(build=_walk(walk_on, LEFT), to_state=S.LEFT_FORWARD, steps=1, chained=True),
    (A.WALK_END, P.WALK_CLOSE_RIGHT): Recipe(
        build=_walk(walk_close, RIGHT), to_state=S.STANDING, steps=1, chained=True
    ),
    (A.WALK_END, P.WALK_CLOSE_LEFT): Recipe(build=_walk(walk_close, LEFT), to_state=S.STANDING, steps=1, chained=True),
    (A.STAIR_UP, P.WHOLE): Recipe(build=_crossing(stair_up), to_state=S.STANDING, steps=2),
    (A.STAIR_DOWN, P.WHOLE): Recipe(build=_crossing(stair_down), to_state=S.STANDING, steps=2),
    (A.OBSTACLE, P.WHOLE): Recipe(
        build=_crossing(obstacle), to_state=S.STANDING, steps=2, speed_share=OBSTACLE_SPEED_SHARE
    ),
    (A.SIT_DOWN, P.WHOLE): Recipe(build=_transfer(rising=False), to_state=S.SITTING),
    (A.STAND_UP, P.WHOLE): Recipe(build=_transfer(rising=True), to_state=S.STANDING),
}
WALKING = tuple(recipe for key, recipe in RECIPES.items() if key[1] is not P.WHOLE)


def plan(request: PlanRequest, patient: Patient) -> Plan:
    """The checked plan for a request; one that can't be done has `check.ok` False, the reason, and one row."""
    try:
        return _planned(request, patient)
    except AppError as error:
        return _refused(request, PlanCheck(reason=reason_of(error)))


def nominal_pose(state: GaitState, patient: Patient) -> JointArray:
    """Where the joints are in a state between actions, (4,) radians.

    NaN where the state has no pose of its own, and for sitting when the patient does not fit the chair.
    """
    thigh, shank = standing_segments(patient.body)
    if state is S.SITTING:
        try:
            return np.array(seated_joints(patient) * 2)
        except AppError:
            return np.full(4, np.nan)
    if state in {S.RIGHT_FORWARD, S.LEFT_FORWARD}:
        half = patient.gait.step_length_m / 2
        reach = leg_length(patient.body, SOFT_KNEE_RAD)
        down = np.sqrt(max(reach * reach - half * half, 0.0))
        front = kinematics.joints(patient.body, np.array([half, -down]))
        rear = kinematics.joints(patient.body, np.array([-half, -down]))
        left, right = (front, rear) if state is S.LEFT_FORWARD else (rear, front)
        return np.array([left.hip, left.knee, right.hip, right.knee])
    if state is S.BETWEEN:
        return np.full(4, np.nan)
    return np.array([thigh, thigh - shank] * 2)


def scene_of(action: Action, patient: Patient) -> Scene:
    """What has to stand around the feet as an action starts."""
    recipe = RECIPES.get((action, P.WHOLE))
    if recipe is None:
        return LEVEL_FLOOR
    try:
        return recipe.build(patient, 1.0).scene
    except AppError:
        return LEVEL_FLOOR


@lru_cache(maxsize=64)
def path_of(action: Action, phase: Phase, patient: Patient) -> Path:
    """The nominal path of a movement, slow enough for every joint; raises AppError for one that can't be made.

    Cached: it takes most of a plan's time, and the wearer waits for it between release and first command.
    """
    recipe = RECIPES[action, phase]
    return sample(patient.body, _movement(recipe.build, patient, _stretch(recipe, patient)))


def _planned(request: PlanRequest, patient: Patient) -> Plan:
    start = _within_range(np.array(request.start_rad), patient)
    if request.action is A.INITIALISE:
        recipe = Recipe(build=_transfer(rising=True), to_state=S.STANDING)
        path = _recovery(patient, start)
    else:
        recipe = RECIPES[request.action, request.phase]
        path = path_of(request.action, request.phase, patient)
    if not recipe.chained:
        far = np.abs(start - path.joints_rad[0])
        if request.action is not A.INITIALISE and not (far <= FAR_RAD).all():
            why = reason(
                PlanFault.TOO_FAR_FROM_STATE, angle_rad=float(far.max()), state=request.from_state, limit_rad=FAR_RAD
            )
            return _refused(request, PlanCheck(reason=why))
        path = replace(path, joints_rad=path.joints_rad + _fading(path.time_s, start - path.joints_rad[0]))
    velocity = np.gradient(path.joints_rad, 1 / TICK_HZ, axis=0, edge_order=2)
    torque = joint_torques(patient, path)
    check = check_path(patient, path, velocity, torque)
    if not check.ok:
        return _refused(request, check)
    return Plan(
        number=request.number,
        action=request.action,
        phase=request.phase,
        from_state=request.from_state,
        to_state=recipe.to_state,
        position_rad=path.joints_rad,
        velocity_rad_s=velocity,
        torque_nm=torque,
        check=check,
        steps=recipe.steps,
        advance_m=float(path.hip_m[-1, 0] - path.hip_m[0, 0]) if recipe.steps else 0.0,
    )


def _refused(request: PlanRequest, check: PlanCheck) -> Plan:
    start = np.array([request.start_rad])
    return Plan(
        number=request.number,
        action=request.action,
        phase=request.phase,
        from_state=request.from_state,
        to_state=request.from_state,
        position_rad=start,
        velocity_rad_s=np.zeros_like(start),
        torque_nm=np.zeros_like(start),
        check=check,
    )


def _within_range(measured_rad: JointArray, patient: Patient) -> JointArray:
    """A joint that leans on its end stop starts from the range of plans; the follower fades the difference."""
    within = np.clip(measured_rad, patient.low_rad, patient.high_rad)
    near: JointArray = np.where(np.abs(within - measured_rad) <= ENGAGE_RAD, within, measured_rad)
    return near


def _fading(time_s: Array, difference_rad: Array) -> Array:
    left: Array = (1 - smoothstep(time_s, 0.0, min(FADE_S, float(time_s[-1]))))[:, None] * difference_rad
    return left


def _movement(build: Build, patient: Patient, stretch: float) -> CartesianMotion:
    body = patient.body
    movement = reaching(body, build(patient, stretch), leg_length(body, LONGEST_KNEE_RAD))
    return lifted(body, movement, patient.gait.swing_clearance_m)


def _stretch(recipe: Recipe, patient: Patient) -> float:
    """How much slower than the profile asks, so that no joint exceeds speed or torque; the steps of a walk alike."""
    recipes = WALKING if recipe in WALKING else (recipe,)
    return max(_own_stretch(one.build, patient, one.speed_share) for one in recipes)


def _recovery(patient: Patient, start_rad: Array) -> Path:
    """The path to standing, slow enough for every joint's speed and torque; in few tries, because it is waited for."""
    for stretch in STRETCHES[::2]:
        path = recovery_path(patient, start_rad, stretch)
        if _slow_enough(patient, path) and _weak_enough(patient, path):
            break
    return path


def _slow_enough(patient: Patient, path: Path, share: float = 1.0) -> bool:
    speed = np.abs(np.gradient(path.joints_rad, 1 / TICK_HZ, axis=0)).max(axis=0)
    return bool((speed <= share * patient.speed_rad_s).all())


def _weak_enough(patient: Patient, path: Path) -> bool:
    return bool((np.abs(joint_torques(patient, path)).max(axis=0) <= patient.torque_nm).all())


@lru_cache(maxsize=256)
def _own_stretch(build: Build, patient: Patient, speed_share: float) -> float:
    """The first stretch at which one movement fits; that for its speed alone when no slowness saves its torque."""
    enough_for_speed = 0.0
    for stretch in STRETCHES:
        path = sample(patient.body, _movement(build, patient, stretch))
        if not _slow_enough(patient, path, speed_share):
            continue
        enough_for_speed = enough_for_speed or stretch
        if _weak_enough(patient, path):
            return stretch
    return enough_for_speed or STRETCHES[-1]
