"""The measures of one session from its joints: definitions with their sources. Pure.

Spatio-temporal terms as in Whittle's Gait Analysis (chapter 2): the step length of a foot is how far it lands before
the other one, its step time the time from the other foot's landing to its own, cadence the number of steps a minute.
A quantity that the joints do not tell is None, never an estimate of another kind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import radians
from statistics import fmean

import numpy as np
from msgspec import Struct

from app.motion.kinematics import Array, Mask
from app.motion.path import LEFT, RIGHT
from app.outcomes.steps import LEAST_STEP_M, STANDING_S, Step, find_steps, resting, runs, thigh_angles
from hal.joints.body import Body
from hal.joints.device import Joint
from hal.joints.protocol import TICK_HZ, TICK_S

# A thigh nearer to hanging straight down than this is that of a person who stands or walks: as thigh-worn monitors tell
# sitting from standing (Grant, Ryan, Tigbe and Granat, British Journal of Sports Medicine 40, 2006).
UPRIGHT_RAD = radians(45)


class Range(Struct, frozen=True, kw_only=True):
    """Range of motion of one joint while walking; flexion positive, standing = 0."""

    low_deg: float
    high_deg: float

    @property
    def range_deg(self) -> float:
        """From the lowest angle to the highest."""
        return self.high_deg - self.low_deg


class Measures(Struct, frozen=True, kw_only=True):
    """One session, or one part of it; None: not measured."""

    steps: int | None
    walking_time_s: float | None  # from the first movement of a foot to its last; rests of a second and more are none
    up_time_s: float | None = None  # standing or walking, powered
    distance_m: float | None = None  # on the level, of the middle between both feet
    speed_m_s: float | None = None  # distance by walking time
    cadence_steps_min: float | None = None  # of mean step time: starting and closing steps have none
    step_length_left_m: float | None = None
    step_length_right_m: float | None = None
    step_time_left_s: float | None = None
    step_time_right_s: float | None = None
    # Robinson, Herzog and Nigg (J Manipulative Physiol Ther 10, 1987): 100 % · |left − right| / mean of both; 0: alike
    step_length_asymmetry_percent: float | None = None
    step_time_asymmetry_percent: float | None = None
    range_of_motion: dict[str, Range] = {}  # by joint


@dataclass(frozen=True, slots=True, kw_only=True)
class LegHistory:
    """What the measures are made of, (n, ...) at control's rate."""

    body: Body
    joints_rad: Array  # (n, 4)
    powered: Mask
    walking: Mask  # an action that walks on the level runs


def measure(history: LegHistory) -> Measures:
    """All measures of a history; steps that belong to no walking action (stairs, an obstacle, rising) do not count."""
    bouts = _bouts(find_steps(history.body, history.joints_rad), lambda step: _counts(history, step))
    steps = [step for bout in bouts for step in bout]
    still = resting(history.joints_rad)
    time_s = sum(_walking_time_s(bout, still) for bout in bouts)
    distance_m = sum(step.moved_m for step in steps) / 2
    times = [_step_times(bout) for bout in bouts]
    left_s, right_s = ([at for bout in times for side, at in bout if side == wanted] for wanted in (LEFT, RIGHT))
    left_m, right_m = (
        [step.ahead_m for step in steps if step.side == side and step.ahead_m > LEAST_STEP_M] for side in (LEFT, RIGHT)
    )
    return Measures(
        steps=len(steps),
        walking_time_s=time_s,
        up_time_s=_up_time_s(history),
        distance_m=distance_m if steps else None,
        speed_m_s=distance_m / time_s if time_s else None,
        cadence_steps_min=60 / fmean([*left_s, *right_s]) if left_s or right_s else None,
        step_length_left_m=_mean(left_m),
        step_length_right_m=_mean(right_m),
        step_time_left_s=_mean(left_s),
        step_time_right_s=_mean(right_s),
        step_length_asymmetry_percent=asymmetry_percent(_mean(left_m), _mean(right_m)),
        step_time_asymmetry_percent=asymmetry_percent(_mean(left_s), _mean(right_s)),
        range_of_motion=_ranges(history.joints_rad, bouts),
    )


def asymmetry_percent(left: float | None, right: float | None) -> float | None:
    """Robinson's symmetry index without its sign, per cent; None where a side is missing."""
    if left is None or right is None or left + right == 0:
        return None
    return 100 * abs(left - right) / ((left + right) / 2)


def _counts(history: LegHistory, step: Step) -> bool:
    return bool(history.walking[(step.began + step.landed) // 2] and history.powered[step.landed])


def _bouts(steps: Iterable[Step], counts: Callable[[Step], bool]) -> list[list[Step]]:
    """Steps that count, with neither standing nor another step between them."""
    found: list[list[Step]] = [[]]
    for step in steps:
        if step.from_standing or not counts(step):
            found.append([])
        if counts(step):
            found[-1].append(step)
    return [bout for bout in found if bout]


def _walking_time_s(bout: Sequence[Step], still: Mask) -> float:
    first, last = bout[0].began, bout[-1].arrived
    paused = [end - begin for begin, end in runs(still[first:last]) if end - begin >= STANDING_S * TICK_HZ]
    return (last - first - sum(paused)) * TICK_S


def _step_times(bout: Sequence[Step]) -> list[tuple[int, float]]:
    """Side and seconds from the other foot's landing to this one's, without closing steps."""
    return [
        (step.side, (step.landed - before.landed) * TICK_S)
        for before, step in pairwise(bout)
        if step.side != before.side and min(before.ahead_m, step.ahead_m) > LEAST_STEP_M
    ]


def _up_time_s(history: LegHistory) -> float:
    upright = np.abs(thigh_angles(history.joints_rad)).min(axis=1) < UPRIGHT_RAD
    return float((upright & history.powered).sum() * TICK_S)


def _ranges(joints_rad: Array, bouts: Sequence[Sequence[Step]]) -> dict[str, Range]:
    if not bouts:
        return {}
    walked = np.degrees(np.concatenate([joints_rad[bout[0].began : bout[-1].arrived + 1] for bout in bouts]))
    low, high = walked.min(axis=0), walked.max(axis=0)
    return {joint.name.lower(): Range(low_deg=float(low[joint]), high_deg=float(high[joint])) for joint in Joint}


def _mean(values: Sequence[float]) -> float | None:
    return fmean(values) if values else None
