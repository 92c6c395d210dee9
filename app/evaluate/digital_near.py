"""Digital hands near the gestures, to fit on: look-alikes in many variants, and hands between two poses.

The digital hand's poses are one hand shape each; people's are not. Here joints stray from them, a naturally open hand
is bent more or less, and hands are caught halfway from one pose to another. Nobody here is measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from app.evaluate.digital_hands import SOURCE, centred, label_of, scene_of
from app.evaluate.gesture_photos import Photo
from hal.cameras.digital_hand.render import Scene
from hal.cameras.digital_hand.skeleton import GESTURES, LOOK_ALIKES, POSES
from kgdfa.hand import FloatArray

NEAR_SEEDS = 2_000_000  # people from here on are only fitted on
NEAR_PEOPLE = 20
NATURALLY_OPEN = 6  # of each person, from nearly 5 to bent further than the pose
BETWEEN = 6  # of each person, halfway from one pose to another
BETWEEN_LABEL = "none:between"
STRAY_DEG = 4.0  # sd of every joint
_FLEXION = slice(1, 4)  # MCP, PIP, DIP of a finger; for the thumb, angles of its bones
CLEAR_FINGER_DEG = 70.0  # a finger's whole flexion must differ by this from a gesture's, or
CLEAR_THUMB_DEG = 45.0  # the thumb's tip bone in azimuth, for a hand to be certainly no such gesture


def near_scenes(people: int = NEAR_PEOPLE, first_seed: int = NEAR_SEEDS) -> Iterator[tuple[Photo, Scene, int]]:
    """Each person's hands, labelled, with the seed of the picture's noise."""
    for person in range(first_seed, first_seed + people):
        random = np.random.default_rng(person)
        for place, (label, pose, angles) in enumerate(_hands(random)):
            seed = person * 100 + place
            scene = replace(scene_of(pose, person, seed), angles_deg=angles + random.normal(0, STRAY_DEG, angles.shape))
            distance_m = scene.place.position_m[2] if scene.place else 0.0
            photo = Photo(path=f"near/{pose}/{seed}", label=label, source=SOURCE, group=str(person))
            yield photo, centred(scene, distance_m), seed


def _hands(random: Generator) -> Iterator[tuple[str, str, FloatArray]]:
    """Label, the pose whose usual turn it has, and joint angles (5, 6)."""
    for pose in (*GESTURES, *LOOK_ALIKES):
        yield label_of(pose.name), pose.name, pose.angles_deg
    for _ in range(NATURALLY_OPEN):
        share = random.uniform(0.7, 1.4)
        yield label_of("naturally open"), "naturally open", _between("5", "naturally open", share)
    for _ in range(BETWEEN):
        start, angles = _halfway(random)
        yield BETWEEN_LABEL, start, angles


def _halfway(random: Generator) -> tuple[str, FloatArray]:
    """A hand between two poses that is certainly none of the gestures: drawn until one is."""
    names = sorted(POSES)
    while True:
        start, end = random.choice(names, 2, replace=False)
        angles = _between(str(start), str(end), random.uniform(0.35, 0.65))
        if all(_clearly_not(angles, gesture.angles_deg) for gesture in GESTURES):
            return str(start), angles


def _between(start: str, end: str, share: float) -> FloatArray:
    a, b = POSES[start].angles_deg, POSES[end].angles_deg
    mixed: FloatArray = a + share * (b - a)
    return mixed


def _clearly_not(angles: FloatArray, gesture: FloatArray) -> bool:
    flexion = np.abs((angles - gesture)[1:, _FLEXION].sum(axis=1))
    return bool(flexion.max() >= CLEAR_FINGER_DEG or abs(angles[0, 4] - gesture[0, 4]) >= CLEAR_THUMB_DEG)
