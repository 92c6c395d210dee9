"""How near the hand is tracked, and whether a push commands: twelve gestures, two lenses, plain and squared images."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np
from rich.table import Table

from app.evaluate.detector_pool import PoolDetector, map_pool
from app.evaluate.digital import centred
from app.evaluate.hand_motions import Moment, smooth, take
from app.evaluate.harness import FRAME_NS, Step, percent, table
from app.evaluate.readings import GESTURE_NAMES
from app.evaluate.trigger.chain import replay_pipeline
from app.text.catalogue import render
from hal.cameras.camera import ImageArray, Intrinsics
from hal.cameras.digital_hand.render import Person, lens_for, person_of, posed
from kgdfa.button_state import ButtonState
from kgdfa.distance import CEILING_OF_EQUATION
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.pipeline import PipelineInput
from kgdfa.press_zone import PressZone, press_zone

LENSES_PX = (650.0, 950.0)
APPROACH_M = tuple(float(z) for z in np.round(np.arange(0.40, 0.075, -0.01), 3))
SHOWN_FRAMES = 6
CLICK_FRAMES = 16  # half a second there and back
FAR_OFF = 0.25  # a keypoint distance this far from the truth is no track
FIRST_HAND = 701
VIEWS = ("plain", "squared")


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneRow:
    """One gesture before one lens, over the hands: followed_from_cm worst of them; commands: share of pushes.

    followed_from_cm None: one of them was never found.
    """

    focal_px: float
    gesture: str
    followed_from_cm: dict[str, float | None]
    commands: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """One hand with one gesture before one lens, in one way of detection."""

    focal_px: float
    gesture: str
    seed: int
    view: str

    @property
    def person(self) -> Person:
        """Whose hand."""
        return person_of(self.seed)

    @property
    def lens(self) -> Intrinsics:
        """Of the digital camera."""
        return lens_for(focal_px=self.focal_px)


@dataclass(frozen=True, slots=True, kw_only=True)
class Approached:
    """How near it was tracked without a break, and whether a push commanded just its gesture. None: never found."""

    followed_cm: float | None
    commands: bool


def _approaches(hands: int) -> list[Approach]:
    return [
        Approach(focal_px=focal_px, gesture=gesture, seed=FIRST_HAND + number, view=view)
        for focal_px in LENSES_PX
        for gesture in GESTURE_NAMES
        for view in VIEWS
        for number in range(hands)
    ]


def steps(hands: int) -> int:
    """How many approaches `evaluate_press_zone` simulates."""
    return len(_approaches(hands))


def zone_of(person: Person, lens: Intrinsics) -> PressZone:
    """What the program would propose for this person and lens."""
    return press_zone(
        focal_px=lens.fx_px,
        width_px=lens.width_px,
        height_px=lens.height_px,
        reference_m=person.shape.reference_m,
        palm_width_m=person.shape.palm_width_m,
    )


def evaluate_press_zone(pool: ProcessPoolExecutor, *, hands: int, step: Step) -> list[ZoneRow]:
    """A row a lens and gesture."""
    wanted = _approaches(hands)
    found = map_pool(pool, approach, wanted, step)
    each: dict[tuple[float, str], dict[str, list[Approached]]] = {}
    for one, result in zip(wanted, found, strict=True):
        each.setdefault((one.focal_px, one.gesture), {}).setdefault(one.view, []).append(result)
    return [
        ZoneRow(
            focal_px=focal_px,
            gesture=gesture,
            followed_from_cm={view: _worst([one.followed_cm for one in results]) for view, results in by_view.items()},
            commands={view: float(np.mean([one.commands for one in results])) for view, results in by_view.items()},
        )
        for (focal_px, gesture), by_view in each.items()
    ]


def _worst(followed_cm: list[float | None]) -> float | None:
    found = [cm for cm in followed_cm if cm is not None]
    return max(found) if len(found) == len(followed_cm) else None


def approach(detector: PoolDetector, wanted: Approach) -> Approached:
    """Bring the hand slowly near, then push with it."""
    followed_cm = _followed(detector, wanted)
    detector.reset()
    return Approached(followed_cm=followed_cm, commands=_commands(detector, wanted))


def _followed(detector: PoolDetector, wanted: Approach) -> float | None:
    """The nearest distance, cm, to which the approaching hand is tracked without a break; None where it never is."""
    nearest_m: float | None = None
    for number, (z, hands) in enumerate(_detected(detector, wanted, (*(APPROACH_M[0],) * SHOWN_FRAMES, *APPROACH_M))):
        right = bool(hands) and abs(_ratio(hands[0], wanted, z) - 1) < FAR_OFF
        if number >= SHOWN_FRAMES and not right:
            break
        nearest_m = z if right else nearest_m
    return None if nearest_m is None else round(nearest_m * 100, 1)


def _commands(detector: PoolDetector, wanted: Approach) -> bool:
    """Whether a push 4 cm past the proposed threshold's true place, and back, commands just this gesture."""
    threshold_m = zone_of(wanted.person, wanted.lens).threshold_m
    start_m, turn_m = threshold_m * 1.5, threshold_m / CEILING_OF_EQUATION - 0.04
    share = [smooth(1 - abs(2 * frame / CLICK_FRAMES - 1)) for frame in range(1, CLICK_FRAMES + 1)]
    distances = (
        *(start_m,) * SHOWN_FRAMES,
        *(start_m + (turn_m - start_m) * one for one in share),
        *(start_m,) * 4,
    )
    replay, pipeline = replay_pipeline("robust", wanted.person, wanted.lens, threshold_m)
    blank = np.zeros((wanted.lens.height_px, wanted.lens.width_px, 3), np.uint8)
    button = ButtonState()
    for _, hands in _detected(detector, wanted, distances):
        replay.hands = hands
        button = pipeline.process(PipelineInput(image_bgr=blank, captured_ns=detector.now_ns)).button
    return (button.release_count, button.released_gesture) == (1, Gesture(wanted.gesture))


def _detected(
    detector: PoolDetector, wanted: Approach, distances: tuple[float, ...]
) -> Iterator[tuple[float, tuple[Hand, ...]]]:
    """True distance and detected hands, frame by frame; people aim with the middle of what they show."""
    for number, z in enumerate(distances):
        scene = posed(wanted.gesture, person=wanted.person, lens=wanted.lens, position_m=(0.0, 0.0, z))
        image, _ = take(Moment(scene=centred(scene, z)), number)
        yield z, _VIEWS[wanted.view](detector, image)


def squared(image: ImageArray) -> tuple[ImageArray, tuple[int, int]]:
    """The image with bars that make it square, and what they add to x and y, pixels: a hand may outgrow the image.

    MediaPipe's palm detector works on a square all the same, so the bars take nothing from its resolution.
    """
    height, width = image.shape[:2]
    side = max(height, width)
    top, left = (side - height) // 2, (side - width) // 2
    bars = (top, side - height - top, left, side - width - left)
    return np.asarray(cv2.copyMakeBorder(image, *bars, cv2.BORDER_CONSTANT), np.uint8), (left, top)


def _squared(detector: PoolDetector, image: ImageArray) -> tuple[Hand, ...]:
    detector.now_ns += FRAME_NS
    shown, moved = squared(image)
    return tuple(
        replace(hand, image_px=hand.image_px - moved) for hand in detector.inner.detect(shown, detector.now_ns)
    )


_VIEWS: dict[str, Callable[[PoolDetector, ImageArray], tuple[Hand, ...]]] = {
    "plain": lambda detector, image: detector.detect(image),
    "squared": _squared,
}


def _ratio(hand: Hand, wanted: Approach, true_m: float) -> float:
    """Eq. 4 against the truth."""
    return wanted.lens.fx_px * wanted.person.shape.reference_m / max(hand.reference_px, 1.0) / true_m


def zone_lines() -> list[str]:
    """The proposed press zone before each lens."""
    zones = {focal_px: zone_of(Person(), lens_for(focal_px=focal_px)) for focal_px in LENSES_PX}
    return [f"{focal_px:.0f} px: {render(zone.explain())}" for focal_px, zone in zones.items()]


def _distance(cm: float | None) -> str:
    return "–" if cm is None else f"{cm:.0f} cm"


def zone_table(rows: list[ZoneRow]) -> Table:
    """How near the hand is tracked, and whether a push with the proposed threshold commands."""
    columns = " ".join(["lens", "gesture", *(f"{view}_{what}" for view in VIEWS for what in ("tracked", "commands"))])
    made = table("press_zone", columns, left=6)
    for row in rows:
        pairs = ((_distance(row.followed_from_cm[view]), percent(row.commands[view], 0)) for view in VIEWS)
        cells = [cell for pair in pairs for cell in pair]
        made.add_row(f"{row.focal_px:.0f} px", row.gesture, *cells, end_section=row.gesture == GESTURE_NAMES[-1])
    return made
