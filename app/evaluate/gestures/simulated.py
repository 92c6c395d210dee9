"""Simulated hands that a fit gets beside photos: drawn from the joint space, most of them none of the gestures.

Photos show the gestures and a few look-alikes; a hand does everything between as well. What these hands show is known
from their joint angles (`joint_space.label_by_joints`); those that could be either are left out. Their keypoints have
the errors that MediaPipe made on the rendered hands that a fit gets, so no photo and no hand that is measured enters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.evaluate.gestures.joint_space import (
    Errors,
    any_hand,
    errors_of,
    hand_about,
    label_by_joints,
    scene_about,
)
from app.evaluate.gestures.synthetic import near_scenes
from app.evaluate.readings import DetectedImage
from hal.cameras.digital_hand.skeleton import POSES
from kgdfa.features import FEATURES, features
from kgdfa.hand import FloatArray

SIMULATED = 40_000
FIRST_PERSON = 4_000_000  # people from here on are only fitted on
ABOUT_A_POSE = 0.6  # share drawn about a pose; the others from the whole space
_NAMES = sorted(POSES)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedHands:
    """values (n, F): features; labels (n,): a gesture or `joint_space.LABEL`."""

    values: FloatArray
    labels: NDArray[np.str_]


def simulate(digital: Sequence[DetectedImage], count: int = SIMULATED, seed: int = 0) -> SimulatedHands:
    """So many hands, less those out of view and those that could be either. Another seed draws other hands.

    digital: the rendered hands of a fit, of which those of `near_scenes` are used; without them there is none.
    """
    errors = _errors(digital)
    hands = [*_hands(errors, count, seed)] if len(errors.angles_deg) else []
    return SimulatedHands(
        values=np.array([one for one, _ in hands]).reshape(-1, len(FEATURES)),
        labels=np.array([label for _, label in hands], dtype=str),
    )


def _errors(digital: Sequence[DetectedImage]) -> Errors:
    by_path = {one.image.path: one for one in digital}
    here = [(scene, by_path[one.path]) for one, scene, _ in near_scenes() if one.path in by_path]
    return errors_of([scene for scene, _ in here], [one for _, one in here])


def _hands(errors: Errors, count: int, seed: int) -> Iterator[tuple[FloatArray, str]]:
    """Features and labels."""
    random = np.random.default_rng(FIRST_PERSON + seed)
    for person in range(FIRST_PERSON, FIRST_PERSON + count):
        pose = str(random.choice(_NAMES))
        angles_deg = hand_about(random, pose) if random.random() < ABOUT_A_POSE else any_hand(random)
        label = label_by_joints(angles_deg)
        hand = errors.observe(scene_about(angles_deg, person, random, turned_like=pose), random)
        if hand is not None and label is not None:
            yield features(hand.image_px, hand.world_m), label
