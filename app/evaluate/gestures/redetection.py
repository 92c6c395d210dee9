"""What re-detection wins on images, and what it costs: time, false hands.

Each of its views, on digital hands that the plain view missed; and the views of a near hand just lost, on hands as
near as a push brings them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.table import Table

from app.evaluate.digital import digital_scenes, image_of_scene
from app.evaluate.gestures.ablation import cost_ms
from app.evaluate.harness import Step, table
from app.evaluate.readings import GESTURE_NAMES, NO_HAND, LabelledImage, read_images
from app.text.catalogue import tr
from hal.cameras.digital_hand.raycast import project_px
from hal.cameras.digital_hand.render import keypoints_m
from kgdfa.augmentation import StillDetector, to_image
from kgdfa.hand import FloatArray, Hand, Keypoint
from kgdfa.preprocess import Image
from kgdfa.redetection import SOUGHT_PALM
from kgdfa.views import BRIGHTER, FULL_VIEW, NEAR_VIEWS, REDETECTION_VIEWS, View, render_view
from logs.reason import Reason

EDGE_ON = 0.6  # a palm seen edge on is taken to be this share of its length wide
RIGHT_SEGMENTS = 0.35  # keypoints off by more than this on average, in reference segments, are not of that hand
NEAR_M = (0.145, 0.19)  # from the nearest of a push to where it is pressed


@dataclass(frozen=True, slots=True, kw_only=True)
class RedetectionFigures:
    """One view: right and wrong hands in the images that the plain view missed, hands in those that show none."""

    view: View
    right: int
    wrong: int
    false_hands: int
    empty: int  # images that show none
    cost_ms: float


def missed_hands(detector: StillDetector, per_pose: int, first_seed: int, step: Step) -> list[tuple[Image, FloatArray]]:
    """Images of digital hands that the plain view misses, with their true keypoints, (21, 2) px."""
    missed = []
    for _, scene, seed in digital_scenes(per_pose, first_seed):
        image, joints = image_of_scene(scene, seed), keypoints_m(scene)
        if joints is not None and not detector.detect(image):
            missed.append((image, project_px(joints, scene.lens)))
        step()
    return missed


def empty_rooms(count: int, first_seed: int) -> list[Image]:
    """Digital rooms without the hand."""
    scenes = (scene for _, scene, _ in digital_scenes(count, first_seed))
    by_room = {scene.person.room_seed: scene for scene in scenes}
    return [image_of_scene(replace(scene, place=None), 0) for scene in by_room.values()]


def images_without_hand(
    images: Iterable[LabelledImage], directory: Path, unreadable: dict[str, Reason]
) -> Iterator[Image]:
    """The images labelled as showing none, those that can be read; the others are added to `unreadable`."""
    without = (one for one in images if one.label == NO_HAND)
    return (image for _, image in read_images(without, directory, unreadable))


def measure_redetection(
    detector: StillDetector, missed: list[tuple[Image, FloatArray]], empty: Iterable[Image]
) -> list[RedetectionFigures]:
    """Each view of re-detection, in its order; the plain one, which is among them, finds none of the missed."""
    return _measured(detector, REDETECTION_VIEWS, missed, empty)


def near_hands(per_pose: int, first_seed: int) -> list[tuple[Image, FloatArray]]:
    """Images of people's gestures as near as a push brings them, with their true keypoints, (21, 2) px."""
    near = []
    for labelled, scene, seed in digital_scenes(per_pose, first_seed):
        if labelled.label not in GESTURE_NAMES or scene.place is None:
            continue
        x, y, _ = scene.place.position_m
        distance_m = float(np.random.default_rng(seed).uniform(*NEAR_M))
        placed = replace(scene, place=replace(scene.place, position_m=(x, y, distance_m)))
        joints = keypoints_m(placed)
        if joints is not None:
            near.append((image_of_scene(placed, seed), project_px(joints, placed.lens)))
    return near


def measure_near(
    detector: StillDetector, near: list[tuple[Image, FloatArray]], empty: Iterable[Image]
) -> list[RedetectionFigures]:
    """The views of a near hand just lost, and what they are made of, in the size in which it is sought."""
    parts = (FULL_VIEW, View(turn_deg=25), View(turn_deg=25, gamma=BRIGHTER))
    return _measured(detector, (*parts, *NEAR_VIEWS), near, empty, sought=True)


def redetection_table(key: str, measured: Sequence[RedetectionFigures], *, total: int, missed: int = 0) -> Table:
    """A row a view. key: of its title."""
    rows = [
        (
            f"{one.view.scale:g}",
            f"{one.view.turn_deg:g}°",
            f"{one.view.gamma:g}",
            tr("evaluate.surround.black" if one.view.black else "evaluate.surround.edge"),
            one.right,
            one.wrong,
            one.false_hands,
            f"{one.cost_ms:.1f}",
        )
        for one in measured
    ]
    columns = "scale turned gamma surround found elsewhere false_hands ms"
    return table(key, columns, rows, left=0, total=total, missed=missed, empty=measured[0].empty)


def _measured(
    detector: StillDetector,
    views: Sequence[View],
    shown: list[tuple[Image, FloatArray]],
    empty: Iterable[Image],
    *,
    sought: bool = False,
) -> list[RedetectionFigures]:
    """A row a view. sought: in the size in which a near hand is, by its true palm. empty: one is held at a time."""
    without, false_hands = 0, Counter[View]()
    for image in empty:
        without += 1
        false_hands.update(view for view in views if _detected_in(detector, image, view) is not None)
    found = {view: _errors(detector, view, shown, sought=sought) for view in views}
    return [
        RedetectionFigures(
            view=view,
            right=sum(error < RIGHT_SEGMENTS for error in errors),
            wrong=sum(error >= RIGHT_SEGMENTS for error in errors),
            false_hands=false_hands[view],
            empty=without,
            cost_ms=cost_ms(partial(render_view, view=view)),
        )
        for view, errors in found.items()
    ]


def _errors(detector: StillDetector, view: View, shown: list[tuple[Image, FloatArray]], *, sought: bool) -> list[float]:
    errors = []
    for image, truth in shown:
        palm_px = float(np.linalg.norm(truth[Keypoint.MIDDLE_MCP] - truth[Keypoint.WRIST]))
        scale = min(1.0, SOUGHT_PALM * image.shape[0] / palm_px) if sought else view.scale
        if hand := _detected_in(detector, image, replace(view, scale=scale)):
            errors.append(_error(hand, truth))
    return errors


def _detected_in(detector: StillDetector, image: Image, view: View) -> Hand | None:
    shown, transform = render_view(image, view)
    hands = detector.detect(shown)
    return to_image(hands[0], transform) if hands else None


def _error(hand: Hand, truth_px: FloatArray) -> float:
    """Mean distance of the keypoints from where they are, in reference segments."""
    across, along = (float(np.linalg.norm(truth_px[a] - truth_px[b])) for a, b in ((5, 17), (0, 9)))
    return float(np.linalg.norm(hand.image_px - truth_px, axis=1).mean()) / max(across, EDGE_ON * along)
