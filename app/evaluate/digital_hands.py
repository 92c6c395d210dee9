"""Pictures of the digital hand with known labels: many people, lamps and rooms, both hands, tilted, near and far."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.evaluate.gesture_photos import NONE_PREFIX, Photo, SeenPhoto
from app.evaluate.sequence import PERIOD_NS
from hal.cameras.digital_hand.render import Scene, keypoints_m, person_of, posed, render
from hal.cameras.digital_hand.skeleton import GESTURES, POSES
from kgdfa.hand import FloatArray, Hand
from kgdfa.preprocess import Image, Prepare, as_bgr8
from kgdfa.redetection import PATIENCE_FRAMES

SOURCE = "digital hand"
MAX_TILT_RAD = np.radians(30.0)
NEAR_M, FAR_M = 0.20, 0.60
MEASURE_SEEDS = 10_000  # people from here on measure
FIT_SEEDS = 1_000_000  # and people from here on fit: nobody does both
HELD_FRAMES = 4  # a hand found is looked at again as often as a vote needs, and once more
MOST_FRAMES = 10  # a third of a second
_GESTURE_NAMES = frozenset(pose.name for pose in GESTURES)
_KINDS = {"naturally open": "natural_open", "thumb up": "good", "O": "o_shape"}  # as labels.csv calls them


def label_of(pose: str) -> str:
    """A pose's label as labels.csv has it."""
    return pose if pose in _GESTURE_NAMES else NONE_PREFIX + _KINDS.get(pose, pose.replace(" ", "_").replace("-", "_"))


def digital_scenes(per_pose: int, first_seed: int) -> Iterator[tuple[Photo, Scene, int]]:
    """`per_pose` people, each showing every pose, tilted and placed anew; with the seed of the picture's noise."""
    for person in range(first_seed, first_seed + per_pose):
        for place, pose in enumerate(POSES):
            seed = person * len(POSES) + place
            photo = Photo(path=f"{pose}/{seed}", label=label_of(pose), source=SOURCE, group=str(person))
            yield photo, scene_of(pose, person, seed), seed


def scene_of(pose: str, person: int, seed: int) -> Scene:
    """One person showing one pose: tilted by up to 30° about any axis, 20 to 60 cm away, in the picture's middle."""
    draw = np.random.default_rng(seed)
    axis = draw.normal(size=3)
    turn = axis / np.linalg.norm(axis) * draw.uniform(0, MAX_TILT_RAD)
    distance_m = float(draw.uniform(NEAR_M, FAR_M))
    scene = posed(
        pose,
        person=person_of(person),
        position_m=(0.0, 0.0, distance_m),
        turn_rad=(float(turn[0]), float(turn[1]), float(turn[2])),
    )
    return centred(scene, distance_m)


def centred(scene: Scene, distance_m: float) -> Scene:
    """The same hand in the picture's middle."""
    points = keypoints_m(scene)
    if points is None or scene.place is None:
        return scene
    middle: FloatArray = (points.min(axis=0) + points.max(axis=0)) / 2
    place = replace(scene.place, position_m=(-float(middle[0]), -float(middle[1]), distance_m))
    return replace(scene, place=place)


def picture(scene: Scene, seed: int) -> Image:
    """The picture of a scene, (720, 1280, 3)."""
    return render(scene, seed).image_bgr


def see_digital(
    model: Path,
    scenes: Iterable[tuple[Photo, Scene, int]],
    tell: Callable[[], None] = lambda: None,
    prepare: Prepare = as_bgr8,
) -> list[SeenPhoto]:
    """Every hand held still until it has been seen for as many frames as a vote needs, for a third of a second at most,
    found and tracked as before a camera; the last frame counts.
    """
    from kgdfa.keypoints import HandDetector

    seen, now_ns = [], 0
    with HandDetector(model, search=True) as detector:
        for photo, scene, seed in scenes:
            shown = prepare(picture(scene, seed))
            hands: tuple[Hand, ...] = ()
            frames_seen = 0
            black = np.zeros_like(shown)  # ends the last hand's track, and what search found it
            for image in (*[black] * PATIENCE_FRAMES, *[shown] * MOST_FRAMES):
                now_ns += PERIOD_NS
                hands = detector.detect(image, now_ns)
                frames_seen += bool(hands)
                if frames_seen == HELD_FRAMES:
                    break
            seen.append(SeenPhoto(photo=photo, hands=hands))
            tell()
    return seen
