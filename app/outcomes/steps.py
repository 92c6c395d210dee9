"""Steps from joint angles: when each foot moved and landed, and how far it came to stand from the other. Pure.

Only hips and knees are measured, no foot and no trunk. Two facts make steps of them, and a third tells the landing:

- With both feet on the floor, the vector from one ankle to the other is known from the joints and the lengths of thigh
  and shank alone. The trunk's unknown lean turns it by some milliradians, which leaves its level part as it is.
- Within a step both feet are flat at one moment: when the front foot has come down and the rear heel has not yet risen,
  the ankles are level. There the distance of the ankles is that of the footprints, whatever shape the sole has.
- A foot that lands turns about its heel, and its ankle, which had come to rest over the floor, goes forward again: the
  landing is where its speed rises most. (Heights tell it worse: the lean lifts the front foot by millimetres. Events
  from accelerations of the foot: Hreljac and Marshall, Journal of Biomechanics 33, 2000.)

The wearer walks forward; a foot that is set back is taken for the other one set forward. The device has no such action.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from app.motion.kinematics import Array, Mask, ankle
from app.motion.path import LEFT, RIGHT
from hal.joints.body import Body, trunk_lean
from hal.joints.protocol import TICK_HZ

SMOOTHED_TICKS = 11  # moving average over a drive's noise; a step takes 400 and more
STILL_RAD_S = 0.02  # joints slower than this are at rest
STILL_TICKS = TICK_HZ // 10
STANDING_S = 1.0  # a rest as long as this is standing, not walking
LEVEL_M = 0.005  # ankles whose heights differ by less: the swinging foot lands about now, or a short rest is one
LANDING_TICKS = TICK_HZ * 15 // 100  # about then
SLOPE_TICKS = 20  # a speed is that of a line through so many samples: shorter ones follow the drives' noise
IN_AIR_M = 0.015  # standing with more, which an unknown lean does not explain: a step that was paused
IN_PLACE_M = 0.01  # an ankle nearer to where it stands: it has not begun to move, or has arrived
LEAST_STEP_M = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step; ticks are indices of the joints that it was found in."""

    side: int  # LEFT, RIGHT: the foot that moved
    began: int  # its ankle was first IN_PLACE_M from where it stood; after a support in motion, that moment
    landed: int  # it touched the floor
    arrived: int  # its ankle was last IN_PLACE_M from where it stands now
    ahead_m: float  # on landing, of the other foot: the step length; near 0 where it came to stand beside it
    moved_m: float  # from where it stood before
    from_standing: bool  # after a rest of STANDING_S or more, or as the first of all


@dataclass(frozen=True, slots=True, kw_only=True)
class _Support:
    """Both feet on the floor."""

    first: int
    last: int
    apart_m: float  # left ankle before the right one
    rested_ticks: int  # from the first rest to the end of the last one; 0: seen in motion only


def find_steps(body: Body, joints_rad: Array) -> tuple[Step, ...]:
    """Steps in angles (n, 4) at control's rate."""
    if len(joints_rad) < 2 * SMOOTHED_TICKS:
        return ()
    angles = _smoothed(joints_rad)
    ankles = _ankles(body, angles)
    supports = _supports(ankles[LEFT] - ankles[RIGHT], resting(joints_rad))
    found: list[Step] = []
    for before, after in pairwise(supports):
        step = _step(ankles, before, after, first=not found)
        if step is not None:
            found.append(step)
    return tuple(found)


def resting(joints_rad: Array) -> Mask:
    """Where all four joints have been at rest for STILL_TICKS and more, (n,)."""
    still = np.zeros(len(joints_rad), dtype=bool)
    if len(joints_rad) > SMOOTHED_TICKS:
        over = 2 * SMOOTHED_TICKS
        moved = np.zeros((len(joints_rad), joints_rad.shape[1]))
        angles = _smoothed(joints_rad)
        moved[SMOOTHED_TICKS:-SMOOTHED_TICKS] = angles[over:] - angles[:-over]
        still[:] = (np.abs(moved) < STILL_RAD_S * over / TICK_HZ).all(axis=1)
    for first, end in runs(still):
        if end - first < STILL_TICKS:
            still[first:end] = False
    return still


def runs(true: Mask) -> list[tuple[int, int]]:
    """First index of each run of True, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    return [(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def thigh_angles(joints_rad: Array) -> Array:
    """Angle of both thighs from hanging straight down, forward positive, (n, 2) radians, by the modelled lean."""
    lean = trunk_lean(joints_rad[:, 1], joints_rad[:, 3])
    return joints_rad[:, 0::2] - lean[:, None]


def _smoothed(joints_rad: Array) -> Array:
    half = SMOOTHED_TICKS // 2
    padded = np.pad(joints_rad, ((half + 1, half), (0, 0)), mode="edge").cumsum(axis=0)
    mean: Array = (padded[SMOOTHED_TICKS:] - padded[:-SMOOTHED_TICKS]) / SMOOTHED_TICKS
    return mean


def _ankles(body: Body, joints_rad: Array) -> tuple[Array, Array]:
    """Left and right ankle from the hip, (n, 2) metres each."""
    lean = trunk_lean(joints_rad[:, 1], joints_rad[:, 3])
    return (
        ankle(body, joints_rad[:, 0], joints_rad[:, 1], lean),
        ankle(body, joints_rad[:, 2], joints_rad[:, 3], lean),
    )


def _supports(apart: Array, still: Mask) -> list[_Support]:
    """Moments and stretches with both feet flat on the floor, in order, no two alike; apart: (n, 2) left from right."""
    rests = [
        _Support(first=first, last=end - 1, apart_m=float(np.median(apart[first:end, 0])), rested_ticks=end - first)
        for first, end in runs(still)
        if abs(np.median(apart[first:end, 1])) < (IN_AIR_M if end - first >= STANDING_S * TICK_HZ else LEVEL_M)
    ]
    landings = [
        _Support(first=tick, last=tick, apart_m=_level_at(apart, tick), rested_ticks=0)
        for tick in _level_moments(apart).tolist()
        if not still[tick]
    ]
    found: list[_Support] = []
    for one in sorted([*rests, *landings], key=lambda support: support.first):
        if found and abs(one.apart_m - found[-1].apart_m) < LEAST_STEP_M:
            found[-1] = _joined(found[-1], one)
        else:
            found.append(one)
    return found


def _joined(before: _Support, after: _Support) -> _Support:
    """The same support seen twice; at rest it is seen better."""
    best = after if after.rested_ticks and not before.rested_ticks else before
    both = before.rested_ticks and after.rested_ticks
    rested_ticks = after.last - before.first + 1 if both else best.rested_ticks
    return _Support(first=before.first, last=after.last, apart_m=best.apart_m, rested_ticks=rested_ticks)


def _level_moments(apart: Array) -> NDArray[np.intp]:
    """Ticks after which the front foot is no longer the higher one."""
    higher = np.sign(apart[:, 0]) * apart[:, 1]  # front foot above the rear one
    far = np.abs(apart[:, 0]) > LEAST_STEP_M
    crossed = (higher[:-1] > 0) & (higher[1:] <= 0) & far[:-1] & far[1:]
    return np.flatnonzero(crossed & (np.sign(apart[:-1, 0]) == np.sign(apart[1:, 0])))


def _level_at(apart: Array, tick: int) -> float:
    """How far the ankles are apart where their heights cross, between this tick and the next."""
    before, after = apart[tick], apart[tick + 1]
    share = before[1] / (before[1] - after[1]) if before[1] != after[1] else 0.0
    return float(before[0] + share * (after[0] - before[0]))


def _step(ankles: tuple[Array, Array], before: _Support, after: _Support, *, first: bool) -> Step | None:
    """None: no foot moved between the supports, the legs crept within one of them."""
    side = LEFT if after.apart_m > before.apart_m else RIGHT
    forward = 1 if side == LEFT else -1
    moving, standing = (ankles[one][before.last : after.first + 1] for one in (side, 1 - side))
    from_other = moving - standing
    left = np.flatnonzero(np.hypot(from_other[:, 0] - forward * before.apart_m, from_other[:, 1]) > IN_PLACE_M)
    away = np.flatnonzero(np.hypot(from_other[:, 0] - forward * after.apart_m, from_other[:, 1]) > IN_PLACE_M)
    if not left.size or not away.size:
        return None
    return Step(
        side=side,
        began=before.last + int(left[0]),
        landed=_landing(ankles[side] - ankles[1 - side], before.last, after.first + 1),
        arrived=before.last + int(away[-1]) + 1,
        ahead_m=forward * after.apart_m,
        moved_m=abs(after.apart_m - before.apart_m),
        from_standing=first or before.rested_ticks >= STANDING_S * TICK_HZ,
    )


def _landing(from_other: Array, begin: int, end: int) -> int:
    """The tick at which a foot touches the floor; (n, 2) from the other one, which moved between begin and end."""
    high = np.flatnonzero(from_other[begin:end, 1] > LEVEL_M)
    about = begin + int(high[-1]) + 1 if high.size else end - 1
    first = max(begin, about - LANDING_TICKS, SLOPE_TICKS)
    last = min(about + LANDING_TICKS, len(from_other) - SLOPE_TICKS)
    if from_other[about, 0] < LEAST_STEP_M or last <= first:
        return about  # beside the other foot it comes down flat
    slopes = _slopes(from_other[first - SLOPE_TICKS + 1 : last + SLOPE_TICKS - 1, 0])
    rise = slopes[SLOPE_TICKS - 1 :] - slopes[: last - first]
    return first + int(np.argmax(rise))


def _slopes(values: Array) -> Array:
    """Per tick, of the line of least squares through each SLOPE_TICKS values, (n - SLOPE_TICKS + 1,)."""
    centred = np.arange(SLOPE_TICKS) - (SLOPE_TICKS - 1) / 2
    return np.correlate(values, centred / (centred @ centred), "valid")
