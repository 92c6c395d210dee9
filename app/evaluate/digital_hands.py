"""Pictures of the digital hand with known labels: many people, lamps and rooms, both hands, tilted, near and far."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.evaluate.gesture_photos import NONE_PREFIX, Photo, SeenPhoto
from hal.cameras.hand_poses import GESTURES, POSES
from hal.cameras.hand_scene import Scene, keypoints_m, person_of, posed, render
from kgdfa.hand import FloatArray
from kgdfa.images import Image
from kgdfa.looks import SECOND_THRESHOLD, Look, see_photo

SOURCE = "digital hand"
MAX_TILT_RAD = np.radians(30.0)
NEAR_M, FAR_M = 0.20, 0.60
MEASURE_SEEDS = 0  # people from here on measure
FIT_SEEDS = 1_000_000  # and people from here on fit: nobody does both
WHOLE_FRAME = Look(border=0.0, size_px=1280)
_GESTURE_NAMES = frozenset(pose.name for pose in GESTURES)


def label_of(pose: str) -> str:
    """A pose's label as labels.csv has it."""
    return pose if pose in _GESTURE_NAMES else NONE_PREFIX + pose.replace(" ", "_")


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
    return _centred(scene, distance_m)


def _centred(scene: Scene, distance_m: float) -> Scene:
    points = keypoints_m(scene)
    if points is None or scene.place is None:
        return scene
    middle: FloatArray = (points.min(axis=0) + points.max(axis=0)) / 2
    place = replace(scene.place, position_m=(-float(middle[0]), -float(middle[1]), distance_m))
    return replace(scene, place=place)


def picture(scene: Scene, seed: int) -> Image:
    """The picture of a scene, (720, 1280, 3)."""
    return render(scene, seed).image_bgr


def see_to_fit(model: Path, per_pose: int, first_seed: int, tell: Callable[[], None] = lambda: None) -> list[SeenPhoto]:
    """Every picture looked at once, as a camera's frame is; what the detector misses, no fit learns from."""
    from kgdfa.keypoints import HandDetector

    seen = []
    with HandDetector(model, still=True) as detector:
        for photo, scene, seed in digital_scenes(per_pose, first_seed):
            seen.append(SeenPhoto(photo=photo, hands=detector.detect(picture(scene, seed))))
            tell()
    return seen


def see_to_measure(
    model: Path, per_pose: int, first_seed: int, tell: Callable[[], None] = lambda: None
) -> list[SeenPhoto]:
    """Every picture looked at once, and where that finds no hand, again as a photo without one is."""
    from kgdfa.keypoints import HandDetector

    seen = []
    low = SECOND_THRESHOLD
    with (
        HandDetector(model, still=True) as detector,
        HandDetector(model, still=True, min_detection=low, min_presence=low) as eager,
    ):
        for photo, scene, seed in digital_scenes(per_pose, first_seed):
            hands = see_photo(detector, eager, picture(scene, seed), looks=(WHOLE_FRAME,))
            seen.append(SeenPhoto(photo=photo, hands=hands))
            tell()
    return seen
