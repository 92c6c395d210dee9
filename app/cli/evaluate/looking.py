"""Pictures looked at with the hand model, with a bar while it lasts, or read from a keypoint file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from app.evaluate.gesture_photos import SeenPhoto
    from kgdfa.preprocess import Prepare

FIT_DIGITAL = 40  # digital hands a pose that a fit sees beside the photos


def hand_model(home: Path | None) -> Path:
    """Where the hand model is, fetched first if it must be. Raises AppError when it can't be had."""
    from app.system.config import load_config
    from app.system.hand_model import set_up_model
    from app.system.paths import find_home

    place = find_home(home)
    return set_up_model(place, load_config(place.config))


def looked_at(
    console: Console,
    directory: Path,
    keypoints: Path | None,
    home: Path | None,
    prepare: Prepare | None = None,
) -> list[SeenPhoto]:
    """The photos of a folder, looked at now or read from the keypoint file."""
    from app.cli.progress import bar
    from app.evaluate.gesture_photos import read_labels, see_all
    from app.evaluate.keypoint_file import load_seen, save_seen
    from kgdfa.preprocess import as_bgr8

    photos = read_labels(directory)
    if keypoints is not None and keypoints.exists():
        return load_seen(keypoints, photos)
    with bar(console, "looking at photos", len(photos)) as tell:
        seen = see_all(photos, directory, hand_model(home), tell, prepare or as_bgr8)
    if keypoints is not None:
        save_seen(seen, keypoints)
    return seen


def looked_at_digital(console: Console, per_pose: int, home: Path | None, prepare: Prepare) -> list[SeenPhoto]:
    """So many digital hands a pose that measure, found and tracked as before a camera."""
    from app.cli.progress import bar
    from app.evaluate.digital_hands import MEASURE_SEEDS, digital_scenes, see_digital
    from hal.cameras.digital_hand.skeleton import POSES

    with bar(console, "looking at digital hands", per_pose * len(POSES)) as tell:
        return see_digital(hand_model(home), digital_scenes(per_pose, MEASURE_SEEDS), tell, prepare)


def looked_at_digital_to_fit(console: Console, keypoints: Path | None, home: Path | None) -> list[SeenPhoto]:
    """The digital hands that every fit sees, kept beside the photos' keypoints."""
    from app.cli.progress import bar
    from app.evaluate.digital_hands import FIT_SEEDS, digital_scenes, see_digital
    from app.evaluate.digital_near import near_scenes
    from app.evaluate.keypoint_file import load_seen, save_seen

    scenes = [*digital_scenes(FIT_DIGITAL, FIT_SEEDS), *near_scenes()]
    photos = [photo for photo, _, _ in scenes]
    file = keypoints.with_stem(keypoints.stem + "-digital") if keypoints is not None else None
    if file is not None and file.exists():
        return load_seen(file, photos)
    with bar(console, "looking at digital hands to fit on", len(photos)) as tell:
        seen = see_digital(hand_model(home), scenes, tell)
    if file is not None:
        save_seen(seen, file)
    return seen
