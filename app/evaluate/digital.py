"""Labelled scenes of the digital hand: every pose, shown by people of whom nobody both fits and measures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.evaluate.harness import FRAME_NS, Step
from app.evaluate.readings import GESTURE_NAMES, NONE_PREFIX, DetectedImage, LabelledImage
from hal.cameras.digital_hand.render import Person, Scene, keypoints_m, person_of, posed, render
from hal.cameras.digital_hand.skeleton import POSES
from kgdfa.hand import FloatArray, Hand, Side
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image, Prepare, as_bgr8

SOURCE = "digital hand"
MAX_TILT_RAD = np.radians(30.0)
NEAR_M, FAR_M = 0.20, 0.60
MEASURE_SEEDS = 10_000  # people from here on measure
FIT_SEEDS = 1_000_000  # and people from here on fit: nobody does both
HELD_FRAMES = 4  # a hand found is detected again as often as a vote needs, and once more
MAX_FRAMES = 10  # a third of a second
_KINDS = {"naturally open": "natural_open", "thumb up": "good", "O": "o_shape"}  # as labels.csv calls them
LabelledScene = tuple[LabelledImage, Scene, int]  # with the seed of the image's noise


def label_of(pose: str) -> str:
    """A pose's label as labels.csv has it."""
    return pose if pose in GESTURE_NAMES else NONE_PREFIX + _KINDS.get(pose, pose.replace(" ", "_").replace("-", "_"))


def side_of(person: Person) -> Side:
    """Of a person's hand, in truth."""
    return Side.LEFT if person.shape.left else Side.RIGHT


def digital_scenes(per_pose: int, first_seed: int) -> Iterator[LabelledScene]:
    """`per_pose` people, each showing every pose, tilted and placed anew; with the seed of the image's noise."""
    for person in range(first_seed, first_seed + per_pose):
        for place, pose in enumerate(POSES):
            seed = person * len(POSES) + place
            labelled = LabelledImage(path=f"{pose}/{seed}", label=label_of(pose), source=SOURCE, group=str(person))
            yield labelled, scene_of(pose, person, seed), seed


def scene_of(pose: str, person: int, seed: int) -> Scene:
    """One person showing one pose: tilted by up to 30° about any axis, 20 to 60 cm away, in the image's middle."""
    return tilted_scene(pose, person, np.random.default_rng(seed), MAX_TILT_RAD)


def tilted_scene(
    pose: str, person: int, draw: np.random.Generator, most_tilt_rad: float, angles_deg: FloatArray | None = None
) -> Scene:
    """As `scene_of`, tilted by up to so much; with joint angles (5, 6) of its own, it is turned as that pose is."""
    axis = draw.normal(size=3)
    x, y, z = (axis / np.linalg.norm(axis) * draw.uniform(0, most_tilt_rad)).tolist()
    distance_m = float(draw.uniform(NEAR_M, FAR_M))
    scene = posed(pose, person=person_of(person), position_m=(0.0, 0.0, distance_m), turn_rad=(x, y, z))
    return centred(scene if angles_deg is None else replace(scene, angles_deg=angles_deg), distance_m)


def centred(scene: Scene, distance_m: float) -> Scene:
    """The same hand in the image's middle."""
    points = keypoints_m(scene)
    if points is None or scene.place is None:
        return scene
    middle: FloatArray = (points.min(axis=0) + points.max(axis=0)) / 2
    place = replace(scene.place, position_m=(-float(middle[0]), -float(middle[1]), distance_m))
    return replace(scene, place=place)


def image_of_scene(scene: Scene, seed: int) -> Image:
    """The image of a scene, (720, 1280, 3)."""
    return render(scene, seed).image_bgr


def detect_digital(
    model: Path,
    scenes: Iterable[LabelledScene],
    step: Step = lambda: None,
    prepare: Prepare = as_bgr8,
) -> list[DetectedImage]:
    """Every hand held still until it was detected in as many frames as a vote needs, for a third of a second at most,
    found and tracked as before a camera; the last frame counts.
    """
    detected, now_ns = [], 0
    with HandDetector(model, search=True) as detector:
        for labelled, scene, seed in scenes:
            shown = prepare(image_of_scene(scene, seed))
            hands: tuple[Hand, ...] = ()
            found_frames = 0
            detector.reset(now_ns)
            for _ in range(MAX_FRAMES):
                now_ns += FRAME_NS
                hands = detector.detect(shown, now_ns)
                found_frames += bool(hands)
                if found_frames == HELD_FRAMES:
                    break
            detected.append(DetectedImage(image=labelled, hands=hands))
            step()
    return detected
