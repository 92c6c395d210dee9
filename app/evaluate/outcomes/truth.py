"""The measures of a simulated walk from MuJoCo's own feet, contacts and clock; `app.outcomes` computes nothing here."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from app.outcomes.measures import Measures, Range
from hal.joints.device import Joint
from hal.joints.simulated.wearer import GroundTruth

Array = NDArray[np.float64]
STANDS_N = 20.0  # a foot with less under it is not taken for one that stands
STANDS_M_S = 0.01
TOUCHES_N = 1.0
FLICKER_S = 0.1  # a foot that leaves the floor for less has not left it
NEW_PLACE_M = 0.03
IN_PLACE_M = 0.01
UPRIGHT_RAD = np.pi / 4


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueStep:
    """One foot from a place on the floor to another; seconds of MuJoCo's clock."""

    side: int
    began_s: float
    landed_s: float
    arrived_s: float
    from_m: float
    to_m: float


def true_measures(truths: tuple[GroundTruth, ...]) -> Measures:
    """The same measures, from what really happened. At least one step of each foot must be there."""
    times = np.array([truth.time_s for truth in truths])
    ankles = np.array([truth.ankle_m for truth in truths])
    contact = np.array([truth.contact_n for truth in truths])
    steps = sorted(
        (step for side in (0, 1) for step in _steps(times, ankles[:, side], contact[:, side], side)),
        key=lambda step: step.landed_s,
    )
    time_s = max(step.arrived_s for step in steps) - min(step.began_s for step in steps)
    distance_m = sum(step.to_m - step.from_m for step in steps) / 2
    lengths, step_times = _lengths(steps), _step_times(steps)
    left_m, right_m = (fmean(length for side, length in lengths if side == wanted) for wanted in (0, 1))
    left_s, right_s = (fmean(time for side, time in step_times if side == wanted) for wanted in (0, 1))
    return Measures(
        steps=len(steps),
        walking_time_s=time_s,
        up_time_s=_up_time_s(truths),
        distance_m=distance_m,
        speed_m_s=distance_m / time_s,
        cadence_steps_min=60 / fmean(time for _, time in step_times),
        step_length_left_m=left_m,
        step_length_right_m=right_m,
        step_time_left_s=left_s,
        step_time_right_s=right_s,
        step_length_asymmetry_percent=_asymmetry(left_m, right_m),
        step_time_asymmetry_percent=_asymmetry(left_s, right_s),
        range_of_motion=_ranges(times, truths, steps),
    )


_Place = tuple[int, int, Array]  # first and last sample of a foot that stands, where its ankle is


def _steps(times: Array, ankle: Array, contact_n: Array, side: int) -> list[TrueStep]:
    speed = np.hypot(*np.gradient(ankle, times, axis=0).T)
    stands = (speed < STANDS_M_S) & (contact_n > STANDS_N)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(int)))
    places: list[_Place] = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        place = np.median(ankle[first:end], axis=0)
        if places and abs(place[0] - places[-1][2][0]) < NEW_PLACE_M:
            before = places[-1]
            places[-1] = (before[0], int(end) - 1, before[2] if before[1] - before[0] > end - first else place)
        else:
            places.append((int(first), int(end) - 1, place))
    return [_true_step(times, ankle, contact_n, side, stood) for stood in pairwise(places)]


def _true_step(
    times: Array,
    ankle: Array,
    contact_n: Array,
    side: int,
    stood: tuple[_Place, _Place],
) -> TrueStep:
    before, after = stood
    swing = slice(before[0], after[1] + 1)
    away = np.hypot(*(ankle[swing] - before[2]).T) > IN_PLACE_M
    near = np.hypot(*(ankle[swing] - after[2]).T) <= IN_PLACE_M
    return TrueStep(
        side=side,
        began_s=float(times[swing][np.argmax(away)]),
        landed_s=_landed_s(times[before[1] : after[0] + 1], contact_n[before[1] : after[0] + 1]),
        arrived_s=float(times[swing][len(near) - np.argmin(near[::-1])]),
        from_m=float(before[2][0]),
        to_m=float(after[2][0]),
    )


def _landed_s(times: Array, contact_n: Array) -> float:
    """When the floor was touched after the last time that the foot was off it for longer than a flicker."""
    touches = np.concatenate([[True], contact_n > TOUCHES_N, [True]])
    landed_s = float(times[-1])
    off = np.flatnonzero(touches[:-1] & ~touches[1:]).tolist()
    on = np.flatnonzero(~touches[:-1] & touches[1:]).tolist()
    for begin, end in zip(off, on, strict=True):
        touched_s = float(times[min(end, len(times) - 1)])
        if touched_s - float(times[begin]) > FLICKER_S:
            landed_s = touched_s
    return landed_s


def _lengths(steps: list[TrueStep]) -> list[tuple[int, float]]:
    """Side, and how far the foot came to stand before the other one; without closing steps."""
    places = {step.side: step.from_m for step in reversed(steps)}
    found = []
    for step in steps:
        places[step.side] = step.to_m
        ahead = step.to_m - places[1 - step.side]
        if ahead > NEW_PLACE_M:
            found.append((step.side, ahead))
    return found


def _step_times(steps: list[TrueStep]) -> list[tuple[int, float]]:
    ahead = len(_lengths(steps))  # closing steps come last
    return [
        (step.side, step.landed_s - before.landed_s)
        for before, step in pairwise(steps[:ahead])
        if step.side != before.side
    ]


def _up_time_s(truths: tuple[GroundTruth, ...]) -> float:
    thighs = np.array([truth.joints_rad[0::2] - truth.lean_rad for truth in truths])
    upright = np.abs(thighs).min(axis=1) < UPRIGHT_RAD
    return float(upright.mean()) * (truths[-1].time_s - truths[0].time_s)


def _ranges(times: Array, truths: tuple[GroundTruth, ...], steps: list[TrueStep]) -> dict[str, Range]:
    walked = (times >= min(step.began_s for step in steps)) & (times <= max(step.arrived_s for step in steps))
    degrees = np.degrees([truth.joints_rad for truth in truths])[walked]
    return {
        joint.name.lower(): Range(low_deg=float(degrees[:, joint].min()), high_deg=float(degrees[:, joint].max()))
        for joint in Joint
    }


def _asymmetry(left: float, right: float) -> float:
    return 100 * abs(left - right) / ((left + right) / 2)
