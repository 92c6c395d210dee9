"""What the robust rules accept, in joint angles: on hands from the whole joint space, and joint by joint."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from app.evaluate.gestures.joint_space import LABEL, Errors, joint_hands, scene_about
from app.evaluate.harness import Step, percent, table
from app.evaluate.readings import GESTURE_NAMES
from hal.cameras.digital_hand.skeleton import FINGER_NAMES, POSES
from kgdfa.gesture import Gesture
from kgdfa.hand import FloatArray
from kgdfa.robust import RobustRules

FIRST_PERSON = 6_000_000  # people from here on are only measured
SAMPLES = 24  # people at each step of a joint
STEP_DEG = 10.0
END_OF_MIDDLE = 0.65  # a finger's last joint follows its middle one
MOST_ACCEPTED = 0.5  # a range holds the steps at which at least this share is accepted


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFigures:
    """Hands from the whole joint space. shown, right: of each gesture; wrong: (label, taken for) and how often."""

    hands: int
    shown: dict[str, int]
    right: dict[str, int]
    wrong: dict[str, int]

    @property
    def wrongly_accepted(self) -> float:
        """The share taken for a gesture that their joints certainly don't show."""
        return sum(self.wrong.values()) / max(self.hands, 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointRange:
    """Of one gesture: from where to where a joint may go, the others being as in its pose; None: nowhere."""

    gesture: str
    joint: str
    low_deg: float | None
    high_deg: float | None


def measure_joint_space(
    rules: RobustRules, errors: Errors, hands: int, step: Step = lambda: None, *, seed: int = 0
) -> JointFigures:
    """So many hands from the whole space, one look each; other people with another seed."""
    shown, right, wrong = Counter[str](), Counter[str](), Counter[str]()
    for one in joint_hands(errors, hands, FIRST_PERSON + seed * hands):
        found = rules.classify(one.hand).gesture
        shown[one.label] += 1
        if found is not None and found.value == one.label:
            right[one.label] += 1
        elif found is not None:
            wrong[f"{one.label} > {found.value}"] += 1
        step()
    return JointFigures(hands=hands, shown=dict(shown), right=dict(right), wrong=dict(wrong.most_common()))


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint of the (5, 6) angles, by row and column, and from where to where it is walked, degrees."""

    name: str
    row: int
    column: int
    low_deg: float
    high_deg: float

    @property
    def values_deg(self) -> FloatArray:
        """Every step of the walk."""
        return np.arange(self.low_deg, self.high_deg + 1, STEP_DEG)

    def moved(self, pose_deg: FloatArray, value_deg: float) -> FloatArray:
        """A pose with this joint there, and what moves with it: a finger's last joint, the thumb's middle bone."""
        angles = pose_deg.copy()
        if self.row == 0:
            angles[0, 2] += 0.7 * (value_deg - angles[0, 4])
        elif self.column == MIDDLE:
            angles[self.row, MIDDLE + 1] = END_OF_MIDDLE * value_deg
        angles[self.row, self.column] = value_deg
        return angles


KNUCKLE, MIDDLE, THUMB_TIP = 1, 2, 4
JOINTS = (
    Joint("thumb", 0, THUMB_TIP, -80.0, 80.0),
    *(Joint(f"{name} knuckle", row, KNUCKLE, -10.0, 100.0) for row, name in enumerate(FINGER_NAMES, start=1)),
    *(Joint(f"{name} middle", row, MIDDLE, 0.0, 120.0) for row, name in enumerate(FINGER_NAMES, start=1)),
)
STEPS = len(GESTURE_NAMES) * sum(len(joint.values_deg) for joint in JOINTS)


def joint_ranges(rules: RobustRules, errors: Errors, step: Step = lambda: None) -> list[JointRange]:
    """Every joint of every gesture walked by itself, the others as in the gesture's pose.

    The same people with the same draws at each step, so that steps differ by the joint alone.
    """
    ranges = []
    for gesture in GESTURE_NAMES:
        pose_deg = POSES[gesture].angles_deg
        for joint in JOINTS:
            taken = []
            for value in joint.values_deg:
                taken.append(_accepted(rules, errors, gesture, joint.moved(pose_deg, float(value))) >= MOST_ACCEPTED)
                step()
            low, high = _around(np.array(taken), joint.values_deg, float(pose_deg[joint.row, joint.column]))
            ranges.append(JointRange(gesture=gesture, joint=joint.name, low_deg=low, high_deg=high))
    return ranges


def _around(taken: NDArray[np.bool_], values: FloatArray, pose_deg: float) -> tuple[float | None, float | None]:
    """The ends of the steps in a row that are taken about the pose's own angle; None where that itself isn't."""
    low = high = int(np.abs(values - pose_deg).argmin())
    if not taken[low]:
        return None, None
    while low > 0 and taken[low - 1]:
        low -= 1
    while high + 1 < len(values) and taken[high + 1]:
        high += 1
    return float(values[low]), float(values[high])


def _accepted(rules: RobustRules, errors: Errors, gesture: str, angles_deg: FloatArray) -> float:
    """The share of people whose hand with these angles is taken for the gesture, of those who are in view."""
    random = np.random.default_rng(FIRST_PERSON)
    scenes = [scene_about(angles_deg, FIRST_PERSON + k, random, turned_like=gesture) for k in range(SAMPLES)]
    hands = [hand for scene in scenes if (hand := errors.observe(scene, random)) is not None]
    return sum(rules.classify(hand).gesture is Gesture(gesture) for hand in hands) / max(len(hands), 1)


def joint_space_table(figures: JointFigures) -> Table:
    """A row a label: how many showed it, how many were recognised, and what they were taken for."""
    rows = []
    for label in (*GESTURE_NAMES, LABEL):
        mistaken = {pair.split(" > ")[1]: n for pair, n in figures.wrong.items() if pair.startswith(f"{label} > ")}
        shown = figures.shown.get(label, 0)
        right = "" if label == LABEL else percent(figures.right.get(label, 0) / max(shown, 1))
        rows.append((label, shown, right, ", ".join(f"{name}: {n}" for name, n in mistaken.items())))
    columns = "gesture n gestures_right taken_for"
    return table("joints.space", columns, rows, hands=figures.hands, share=percent(figures.wrongly_accepted, 2))


def joint_range_table(ranges: list[JointRange]) -> Table:
    """A row a gesture, a column a joint."""
    made = table("joints.ranges", "gesture", samples=SAMPLES)
    for joint in JOINTS:
        made.add_column(joint.name, justify="right")
    for gesture in GESTURE_NAMES:
        cells = [_cell(one) for one in ranges if one.gesture == gesture]
        made.add_row(gesture, *cells)
    return made


def _cell(one: JointRange) -> str:
    return "–" if one.low_deg is None else f"{one.low_deg:.0f}…{one.high_deg:.0f}"
