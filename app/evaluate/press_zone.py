"""How near the hand is followed, and whether a push commands: twelve gestures, two lenses, two looks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.evaluate.digital_hands import centred
from app.evaluate.digital_scenes import GESTURES, Moment, smooth, take
from app.evaluate.trigger import replay_pipeline
from app.evaluate.watcher import FRAME_NS, Watcher, spread
from hal.cameras.camera import ImageArray, Intrinsics
from hal.cameras.digital_hand.render import Person, lens_for, person_of, posed
from kgdfa.button import ButtonState
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.pipeline import Picture
from kgdfa.press_zone import PressZone, SquaredDetector, press_zone
from kgdfa.robust_distance import UPRIGHT_FACTOR

LENSES_PX = (650.0, 950.0)
APPROACH_M = tuple(float(z) for z in np.round(np.arange(0.40, 0.075, -0.01), 3))
SHOWN_FRAMES = 6
CLICK_FRAMES = 16  # half a second there and back
FAR_OFF = 0.25  # a keypoint distance this far from the truth is no track
FIRST_HAND = 701
LOOKS = ("plain", "squared")


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneRow:
    """One gesture before one lens, over the hands: followed_cm worst of them; commands: share of pushes."""

    focal_px: float
    gesture: str
    followed_cm: dict[str, float]
    commands: dict[str, float]

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        return {
            "focal_px": self.focal_px,
            "gesture": self.gesture,
            "followed_from_cm": self.followed_cm,
            "commands": self.commands,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """One hand with one gesture before one lens, in one look."""

    focal_px: float
    gesture: str
    seed: int
    look: str

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
    """How near it was followed without a break, and whether a push commanded just its gesture."""

    followed_cm: float
    commands: bool


def _approaches(hands: int) -> list[Approach]:
    return [
        Approach(focal_px=focal_px, gesture=gesture, seed=FIRST_HAND + number, look=look)
        for focal_px in LENSES_PX
        for gesture in GESTURES
        for look in LOOKS
        for number in range(hands)
    ]


def steps(hands: int) -> int:
    """How many approaches `evaluate_press_zone` looks at."""
    return len(_approaches(hands))


def zone_of(person: Person, lens: Intrinsics) -> PressZone:
    """What the program would propose for this person and lens."""
    return press_zone(
        focal_px=lens.fx_px, width_px=lens.width_px, height_px=lens.height_px, reference_m=person.shape.reference_m
    )


def evaluate_press_zone(pool: ProcessPoolExecutor, *, hands: int, step: Callable[[], None]) -> list[ZoneRow]:
    """A row a lens and gesture."""
    wanted = _approaches(hands)
    found = spread(pool, approach, wanted, step)
    each: dict[tuple[float, str], dict[str, list[Approached]]] = {}
    for one, result in zip(wanted, found, strict=True):
        each.setdefault((one.focal_px, one.gesture), {}).setdefault(one.look, []).append(result)
    return [
        ZoneRow(
            focal_px=focal_px,
            gesture=gesture,
            followed_cm={look: max(one.followed_cm for one in results) for look, results in looks.items()},
            commands={look: float(np.mean([one.commands for one in results])) for look, results in looks.items()},
        )
        for (focal_px, gesture), looks in each.items()
    ]


def approach(watcher: Watcher, wanted: Approach) -> Approached:
    """Bring the hand slowly near, then push with it."""
    followed_cm = _followed(watcher, wanted)
    watcher.forget()
    return Approached(followed_cm=followed_cm, commands=_commands(watcher, wanted))


def _followed(watcher: Watcher, wanted: Approach) -> float:
    """The nearest distance, cm, to which the approaching hand is followed without a break."""
    nearest_m = APPROACH_M[0]
    for number, (z, hands) in enumerate(_watch(watcher, wanted, (*(APPROACH_M[0],) * SHOWN_FRAMES, *APPROACH_M))):
        right = bool(hands) and abs(_ratio(hands[0], wanted, z) - 1) < FAR_OFF
        if number >= SHOWN_FRAMES and not right:
            break
        nearest_m = z if right else nearest_m
    return round(nearest_m * 100, 1)


def _commands(watcher: Watcher, wanted: Approach) -> bool:
    """Whether a push 4 cm past the proposed threshold's true place, and back, commands just this gesture."""
    threshold_m = zone_of(wanted.person, wanted.lens).threshold_m
    start_m, turn_m = threshold_m * 1.5, threshold_m / UPRIGHT_FACTOR - 0.04
    share = [smooth(1 - abs(2 * frame / CLICK_FRAMES - 1)) for frame in range(1, CLICK_FRAMES + 1)]
    distances = (
        *(start_m,) * SHOWN_FRAMES,
        *(start_m + (turn_m - start_m) * one for one in share),
        *(start_m,) * 4,
    )
    replay, pipeline = replay_pipeline("robust", wanted.person, wanted.lens, threshold_m)
    blank = np.zeros((wanted.lens.height_px, wanted.lens.width_px, 3), np.uint8)
    button = ButtonState()
    for _, hands in _watch(watcher, wanted, distances):
        replay.hands = hands
        button = pipeline.process(Picture(image_bgr=blank, captured_ns=watcher.now_ns)).button
    return (button.release_count, button.released_gesture) == (1, Gesture(wanted.gesture))


def _watch(
    watcher: Watcher, wanted: Approach, distances: tuple[float, ...]
) -> Iterator[tuple[float, tuple[Hand, ...]]]:
    """True distance and what is seen, frame by frame; people aim with the middle of what they show."""
    for number, z in enumerate(distances):
        scene = posed(wanted.gesture, person=wanted.person, lens=wanted.lens, position_m=(0.0, 0.0, z))
        image, _ = take(Moment(scene=centred(scene, z)), number)
        yield z, _LOOKS[wanted.look](watcher, image)


def _squared(watcher: Watcher, image: ImageArray) -> tuple[Hand, ...]:
    watcher.now_ns += FRAME_NS
    return SquaredDetector(watcher.detector).detect(image, watcher.now_ns)


_LOOKS: dict[str, Callable[[Watcher, ImageArray], tuple[Hand, ...]]] = {
    "plain": lambda watcher, image: watcher.look(image),
    "squared": _squared,
}


def _ratio(hand: Hand, wanted: Approach, true_m: float) -> float:
    """Eq. 4 against the truth."""
    return wanted.lens.fx_px * wanted.person.shape.reference_m / max(hand.reference_px, 1.0) / true_m
