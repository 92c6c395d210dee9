"""How the digital hand moves: keyframed tracks with minimum-jerk runs between them. Pure; time is an argument.

Commands only add to what was; so the pose of any past moment of the last minute stays known exactly.

What a digital patient's hand can't do is nobody's measured hand: fingers that stay bent or can't be spread, a tremor of
all joints are plain cases of what a therapist sees after a stroke, to try the enrolment of gestures on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from hal.cameras.digital_hand.render import Person
from hal.cameras.digital_hand.skeleton import AWAY, FloatArray, HandPlace, find_pose, joints_m, placed_m
from hal.minimum_jerk import minimum_jerk

MORPH_S = 0.22  # one hand shape to the next
PRESS_S = 0.30  # a push, or a withdrawal
SHIFT_S = 0.15
LEAVE_S = 0.25
LEAVE_M = 0.60  # how far below the image an absent hand is
KEEP_NS = 60_000_000_000
SETTLED = "rest"
# The limits within which keys may move the hand, metres in the camera's frame.
_REACH_M = ((-0.25, 0.25), (-0.15, 0.20), (0.08, 0.80))
# A real hand trembles: amplitude in metres and radians, and unrelated frequencies in Hz.
TREMOR_M = 0.0007
TREMOR_RAD = math.radians(0.4)
_TREMOR_HZ = np.array([1.3, 1.7, 0.9, 1.1, 1.5, 0.7])


@dataclass(frozen=True, slots=True)
class Run:
    """From wherever the track is at start_ns to `target`, arriving at end_ns."""

    start_ns: int
    end_ns: int
    origin: FloatArray
    target: FloatArray

    def at(self, now_ns: int) -> FloatArray:
        """Minimum-jerk position, as hands reach."""
        share = min(1.0, (now_ns - self.start_ns) / max(1, self.end_ns - self.start_ns))
        return self.origin + minimum_jerk(share) * (self.target - self.origin)


@dataclass(frozen=True, slots=True)
class Track:
    """A value over time: where it began, and the runs since, each beginning after the one before it."""

    initial: FloatArray
    runs: tuple[Run, ...] = ()

    def at(self, now_ns: int) -> FloatArray:
        """The value at a moment."""
        for run in reversed(self.runs):
            if run.start_ns <= now_ns:
                return run.at(now_ns)
        return self.initial

    def towards(self, target: FloatArray, start_ns: int, duration_s: float) -> Track:
        """Forget what was planned from start_ns on, and run to the target from there."""
        past = tuple(run for run in self.runs if run.start_ns < start_ns)
        origin = Track(self.initial, past).at(start_ns)
        run = Run(start_ns, start_ns + int(duration_s * 1e9), origin, target)
        old = [one for one in past if one.end_ns < start_ns - KEEP_NS]
        return Track(old[-1].target if old else self.initial, (*past[len(old) :], run))

    def goal(self) -> FloatArray:
        """Where it ends."""
        return self.runs[-1].target if self.runs else self.initial

    def moving(self, now_ns: int) -> bool:
        """Whether a run is under way."""
        return any(run.start_ns <= now_ns < run.end_ns for run in self.runs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tremor:
    """The whole hand's, a sine along one axis. travel_m: peak to peak, as TETRAS rates it. axis: (3,), unit length."""

    travel_m: float
    frequency_hz: float
    axis: tuple[float, float, float]

    def offset_m(self, now_ns: int) -> FloatArray:
        """(3,), zero in the mean."""
        return np.asarray(self.axis) * (self.travel_m / 2 * math.sin(2 * math.pi * self.frequency_hz * now_ns / 1e9))


@dataclass(frozen=True, slots=True, kw_only=True)
class Movement:
    """What one hand did, does and is going to do.

    Tracks: shape (36,), see `_shape`; aside (2,); depth (1,); away (1,). tremor: beside that of a steady hand.
    """

    person: Person
    rest_m: float
    press_m: float
    shape: Track
    aside: Track
    depth: Track
    away: Track
    tremor: Tremor | None = None

    def settled(self, now_ns: int) -> bool:
        """Whether the hand has taken the requested shape."""
        return not (self.shape.moving(now_ns) or self.away.moving(now_ns))

    def angles_deg(self, now_ns: int) -> FloatArray:
        """(5, 6) joint angles."""
        return self.shape.at(now_ns)[:30].reshape(5, 6)

    def place(self, now_ns: int) -> HandPlace | None:
        """Where the hand is; None when it is away."""
        away = float(self.away.at(now_ns)[0])
        if away >= 1.0:
            return None
        shape = self.shape.at(now_ns)
        x, y, z = np.append(self.aside.at(now_ns), self.depth.at(now_ns)) + shape[33:]
        tremble = np.sin(2 * np.pi * _TREMOR_HZ * (now_ns / 1e9) + np.arange(6))
        position = np.array([x, y + away * LEAVE_M, z]) + TREMOR_M * tremble[:3]
        if self.tremor is not None:
            position = position + self.tremor.offset_m(now_ns)
        turn = np.radians(shape[30:33]) + TREMOR_RAD * tremble[3:]
        return HandPlace(
            position_m=(float(position[0]), float(position[1]), float(position[2])),
            turn_rad=(float(turn[0]), float(turn[1]), float(turn[2])),
        )


def begin(
    person: Person, *, rest_m: float, press_m: float, gesture: str = SETTLED, tremor: Tremor | None = None
) -> Movement:
    """A hand at rest before the camera."""
    return Movement(
        person=person,
        rest_m=rest_m,
        press_m=press_m,
        shape=Track(_shape(gesture, person)),
        aside=Track(np.zeros(2)),
        depth=Track(np.array([rest_m])),
        away=Track(np.array([0.0])),
        tremor=tremor,
    )


def sign(movement: Movement, gesture: str, now_ns: int) -> Movement:
    """Take another shape, or leave the image. Raises HardwareError for a gesture that doesn't exist."""
    if gesture == AWAY:
        return replace(movement, away=movement.away.towards(np.array([1.0]), now_ns, LEAVE_S))
    absent = float(movement.away.at(now_ns)[0]) >= 1.0
    shape = movement.shape.towards(_shape(gesture, movement.person), now_ns, 0.0 if absent else MORPH_S)
    away = movement.away
    if float(away.goal()[0]) > 0:
        away = away.towards(np.array([0.0]), now_ns, LEAVE_S)
    return replace(movement, shape=shape, away=away)


def push(movement: Movement, pressed: bool, now_ns: int, duration_s: float = PRESS_S) -> Movement:
    """Reach towards the camera, or draw back."""
    goal = movement.press_m if pressed else movement.rest_m
    return replace(movement, depth=movement.depth.towards(np.array([goal]), now_ns, duration_s))


def click(movement: Movement, duration_s: float, now_ns: int) -> Movement:
    """Push and draw back within the given time."""
    there = push(movement, True, now_ns, duration_s / 2)
    turn_ns = now_ns + int(duration_s * 1e9 / 2)
    return push(there, False, turn_ns, duration_s / 2)


def shift(movement: Movement, by_m: tuple[float, float, float], now_ns: int) -> Movement:
    """Move by keys, within reach; moving nearer or farther also moves the place to draw back to."""
    x, y, z = (
        float(np.clip(start + by, *reach))
        for start, by, reach in zip((*movement.aside.goal(), movement.rest_m), by_m, _REACH_M, strict=True)
    )
    moved = replace(movement, aside=movement.aside.towards(np.array([x, y]), now_ns, SHIFT_S))
    if by_m[2] == 0.0:
        return moved
    return push(replace(moved, rest_m=z), False, now_ns, SHIFT_S)


def _shape(gesture: str, person: Person) -> FloatArray:
    """(36,): 30 joint angles, 3 of the turn, and where keypoint 21 is when the hand is centred, metres."""
    pose = find_pose(SETTLED if gesture == AWAY else gesture)
    mirror = -1.0 if person.shape.left else 1.0
    turn = np.asarray(pose.turn_deg) * (1.0, mirror, mirror)
    centring = _centring(pose.angles_deg, turn, person)
    return np.concatenate([pose.angles_deg.ravel(), turn, centring])


def _centring(angles_deg: FloatArray, turn_deg: FloatArray, person: Person) -> FloatArray:
    """People aim and reach with the middle of what they show, not with keypoint 21; (3,) metres."""
    pitch, yaw, roll = np.radians(turn_deg)
    turned = HandPlace(position_m=(0.0, 0.0, 0.0), turn_rad=(pitch, yaw, roll))
    joints = placed_m(joints_m(person.shape, angles_deg), turned)
    middle: FloatArray = np.append((joints.min(axis=0) + joints.max(axis=0))[:2] / 2, joints[:, 2].mean())
    return -middle


BENT_DEG = (45.0, 70.0, 40.0)  # least flexion at MCP, PIP, DIP of a finger that can't be extended
TOGETHER_DEG = (-4.0, 0.0, 4.0, 9.0)  # abduction of fingers that lie beside each other
OPEN_DEG = 45.0  # a finger whose joints are bent by less, together, is open
THUMB_MOST_DEG = 20.0  # azimuth of a thumb that can't be spread
TREMOR_DEG = 8.0  # of every joint
TREMOR_HZ = (4.0, 8.0)  # of Parkinson's and essential tremor, Deuschl et al. 1998
MEAN_HZ = 6.0


class HandLimit(Enum):
    """What the hand can't do."""

    NONE = "none"
    TWO_FINGERS = "two-fingers"  # ring and little finger stay bent
    NO_SPREAD = "no-spread"  # open fingers lie beside each other, the thumb beside the palm
    TREMOR = "tremor"


def limited(limit: HandLimit, angles_deg: FloatArray) -> FloatArray:
    """(5, 6) joint angles as this hand can take them, without its tremor."""
    possible = angles_deg.copy()
    if limit is HandLimit.TWO_FINGERS:
        possible[3:5, 1:4] = np.maximum(possible[3:5, 1:4], BENT_DEG)
    elif limit is HandLimit.NO_SPREAD:
        is_open = possible[1:5, 1:4].sum(axis=1) < OPEN_DEG
        possible[1:5, 0] = np.where(is_open, TOGETHER_DEG, possible[1:5, 0])
        possible[0, 0::2] = np.minimum(possible[0, 0::2], THUMB_MOST_DEG)
    return possible


def tremor_deg(limit: HandLimit, now_s: float, frequency_hz: float = MEAN_HZ, phase_rad: float = 0.0) -> float:
    """How far every joint is from where it is held; 0 for a hand that does not shake."""
    if limit is not HandLimit.TREMOR:
        return 0.0
    return TREMOR_DEG * math.sin(phase_rad + 2 * math.pi * frequency_hz * now_s)
