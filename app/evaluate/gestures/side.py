"""How surely a hand's side is told: on photos each beside its mirror image, and on digital hands of known side.

A photo is shown to the live tracker for some frames, then its mirror image; a frame counts once a gesture is voted. Of
a photo and its mirror image that give the same side one is wrong: half of their frames count as wrong. Where both are
wrong nobody can tell from a photo without a label of its side; the digital hand can, and so can a source whose people
all show the same hand: its sides are counted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.table import Table

from app.evaluate.detector_pool import GAP_NS
from app.evaluate.digital import MEASURE_SEEDS, image_of_scene, scene_of, side_of
from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, percent, table
from app.evaluate.readings import GESTURE_NAMES, DetectedImage, LabelledImage, read_image
from app.system.errors import AppError
from app.text.catalogue import tr
from hal.cameras.digital_hand.render import person_of
from kgdfa.augmentation import AUGMENTATIONS, Augmentation, augment
from kgdfa.commanding import ARM_LIMIT_RAD, Tracks, update_tracks
from kgdfa.gesture import RuleSet, Vote, update_vote
from kgdfa.hand import Hand, Side
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image
from kgdfa.robust import RobustRules
from kgdfa.track import Enrolment, arm_rad
from logs.reason import Reason

HELD_FRAMES = 8
PLAIN, MIRRORED = Augmentation(), Augmentation(mirrored=True)
MIRRORED_LOOK = AUGMENTATIONS.index(MIRRORED)


@dataclass(slots=True)
class SideFigures:
    """Frames of voted gestures, a gesture; unclear: no side was known yet. interrupted: not all images were shown."""

    frames: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)
    unclear: Counter[str] = field(default_factory=Counter)
    sources: dict[str, Counter[str]] = field(default_factory=dict)  # source and group → sides of the plain look
    images: int = 0
    without: int = 0  # images without a voted gesture
    # Of the plain looks at gestures in stored keypoints, from upright.
    arms_rad: list[float] = field(default_factory=list)
    unreadable: dict[str, Reason] = field(default_factory=dict)  # images' paths → why
    interrupted: bool = False

    @property
    def right(self) -> float | None:
        """Share of the frames with a voted gesture whose side is right; None: there is no such frame."""
        total = self.frames.total()
        return 1 - (self.wrong.total() + self.unclear.total()) / total if total else None

    def count_source(self, image: LabelledImage, side: Side | None) -> None:
        """One photo's side."""
        counted = self.sources.setdefault(f"{image.source} {image.group}".strip(), Counter())
        counted[side.value if side else "unclear"] += 1

    def add(self, label: str, sides: Sequence[Side | None], truth: Side | None) -> None:
        """Frames of one image. truth None: not known."""
        self.frames[label] += len(sides)
        self.unclear[label] += sides.count(None)
        if truth is not None:
            self.wrong[label] += sides.count(truth.other)


class SideMeasure:
    """Shows still images to the live tracker, and follows them as the pipeline does."""

    def __init__(self, detector: HandDetector, rules: RuleSet | None = None) -> None:
        self._detector = detector
        self._rules = rules or RobustRules()
        self._now_ns = GAP_NS

    def sides(self, image: Image) -> list[Side | None]:
        """The side in every frame of a voted gesture; [] where none is voted."""
        tracks, vote, sides = Tracks(), Vote(), []
        self._now_ns += GAP_NS
        self._detector.reset(self._now_ns)
        for _ in range(HELD_FRAMES):
            verdicts = [(hand, self._rules.classify(hand)) for hand in self._detect(image)]
            signing = [verdict.gesture is not None for _, verdict in verdicts]
            hands = tuple(hand for hand, _ in verdicts)
            tracks = update_tracks(tracks, hands, self._now_ns, Enrolment(arm_rad=None), signing)
            now = tracks.commanding.hand if tracks.commanding else None
            gesture = next((verdict.gesture for hand, verdict in verdicts if hand is now), None)
            vote = update_vote(vote, gesture, self._now_ns)
            if vote.gesture is not None and tracks.commanding is not None:
                sides.append(tracks.commanding.side)
        return sides

    def _detect(self, image: Image) -> tuple[Hand, ...]:
        self._now_ns += FRAME_NS
        return self._detector.detect(image, self._now_ns)


def measure_photos(detector: HandDetector, images: Iterable[LabelledImage], directory: Path, step: Step) -> SideFigures:
    """Each photo and its mirror image. Raises AppError where no photo can be read."""
    measure, figures = SideMeasure(detector), SideFigures()
    try:
        for labelled in images:
            image = read_image(labelled, directory)
            if isinstance(image, Reason):
                figures.unreadable[labelled.path] = image
            else:
                plain, mirrored = (measure.sides(augment(image, one)[0]) for one in (PLAIN, MIRRORED))
                _add_pair(figures, labelled, plain, [side and side.other for side in mirrored])
            step()
    except KeyboardInterrupt:
        figures.interrupted = True
    if figures.unreadable and not figures.images and not figures.interrupted:
        raise AppError(EvaluateFault.IMAGE_UNREADABLE, file=next(iter(figures.unreadable)))
    return figures


def measure_looks(detected: Iterable[DetectedImage]) -> SideFigures:
    """From stored keypoints: one look at each photo, and the one at its mirror image where every look is stored."""
    rules, figures = RobustRules(), SideFigures()
    for one in detected:
        if one.image.gesture is None:
            continue
        if one.error:
            figures.unreadable[one.image.path] = one.error
        elif not one.hands:
            _add_pair(figures, one.image, [], [])
        else:
            # Of fewer looks nobody knows which is which.
            mirrored = one.hands[MIRRORED_LOOK] if len(one.hands) == len(AUGMENTATIONS) else None
            looks = ([hand.side] if hand and rules.classify(hand).gesture else [] for hand in (one.hands[0], mirrored))
            _add_pair(figures, one.image, *looks)
            angle = arm_rad(one.hands[0])
            figures.arms_rad.extend([] if angle is None else [abs(angle)])
    return figures


def arms_summary(figures: SideFigures) -> Iterator[str]:
    """How many arms point up within the limit beyond which a hand counts as another person's."""
    if figures.arms_rad:
        within = sum(one <= ARM_LIMIT_RAD for one in figures.arms_rad) / len(figures.arms_rad)
        limit = math.degrees(ARM_LIMIT_RAD)
        yield tr("evaluate.side.arms", share=percent(within, 1), arms=len(figures.arms_rad), limit=f"{limit:.0f}")


def _add_pair(
    figures: SideFigures, image: LabelledImage, plain: Sequence[Side | None], mirrored: Sequence[Side | None]
) -> None:
    figures.images += 1
    figures.without += not (plain and mirrored)
    if plain:
        figures.count_source(image, plain[-1])
    if plain and mirrored:
        contrary = sum(a is not None and b is not None and a is not b for a, b in zip(plain, mirrored, strict=False))
        figures.add(image.label, [*plain, *mirrored], None)
        figures.wrong[image.label] += contrary  # one of the two


def measure_digital(detector: HandDetector, people: int, step: Step) -> SideFigures:
    """Digital hands of known side, every gesture of every person."""
    measure, figures = SideMeasure(detector), SideFigures()
    try:
        for label, person in digital_hands(people):
            seed = person * len(GESTURE_NAMES) + GESTURE_NAMES.index(label)
            sides = measure.sides(image_of_scene(scene_of(label, person, seed), seed))
            figures.images += 1
            figures.without += not sides
            figures.add(label, sides, side_of(person_of(person)))
            step()
    except KeyboardInterrupt:
        figures.interrupted = True
    return figures


def digital_hands(people: int) -> Iterator[tuple[str, int]]:
    """Gesture and person."""
    for person in range(MEASURE_SEEDS, MEASURE_SEEDS + people):
        for label in GESTURE_NAMES:
            yield label, person


def sources_table(figures: SideFigures) -> Table:
    """A row a source: of one that shows one hand only, the rarer side is wrong."""
    rows = [(source, sides["left"], sides["right"], sides["unclear"]) for source, sides in figures.sources.items()]
    return table("side.sources", "source left_hand right_hand unclear", rows)


def side_table(figures: SideFigures) -> Table:
    """A row a gesture."""
    rows = [
        (label, figures.frames[label], figures.wrong[label], figures.unclear[label])
        for label in GESTURE_NAMES
        if figures.frames[label]
    ]
    return table("side", "gesture frames wrong unclear", rows)
