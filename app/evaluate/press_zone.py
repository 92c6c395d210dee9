"""How near the hand is followed, and whether a push commands: twelve gestures, two lenses, two looks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.evaluate.digital_scenes import GESTURES, HEIGHT_M, Moment, smooth, take
from app.evaluate.trigger import replay_pipeline
from hal.cameras.camera import Intrinsics
from hal.cameras.hand_scene import Person, lens_for, person_of, posed
from kgdfa.distance import UPRIGHT_FACTOR
from kgdfa.hand import Gesture, Hand
from kgdfa.keypoints import HandDetector
from kgdfa.pipeline import Picture
from kgdfa.press_zone import PaddedDetector, PressZone, press_zone

FRAME_NS = 33_333_333
GAP_NS = 1_000_000_000
LENSES_PX = (650.0, 950.0)
APPROACH_M = tuple(float(z) for z in np.round(np.arange(0.40, 0.075, -0.01), 3))
SHOWN_FRAMES = 6
CLICK_FRAMES = 16  # half a second there and back
FAR_OFF = 0.25  # a keypoint distance this far from the truth is no track
FIRST_HAND = 701
LOOKS = ("plain", "border")


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


def steps(hands: int) -> int:
    """How many frames `evaluate_press_zone` looks at."""
    return len(LENSES_PX) * 12 * hands * (2 * SHOWN_FRAMES + len(APPROACH_M) + CLICK_FRAMES + 4)


def zone_of(person: Person, lens: Intrinsics) -> PressZone:
    """What the program would propose for this person and lens."""
    return press_zone(
        focal_px=lens.fx_px, width_px=lens.width_px, height_px=lens.height_px, anchor_m=person.shape.anchor_m
    )


def evaluate_press_zone(
    make_detector: Callable[[], HandDetector], *, hands: int, step: Callable[[], None]
) -> list[ZoneRow]:
    """A row a lens and gesture."""
    with make_detector() as plain, make_detector() as other:
        run = _Run({"plain": plain.detect, "border": PaddedDetector(other).detect}, step)
        return [run.row(focal_px, gesture, hands) for focal_px in LENSES_PX for gesture in GESTURES]


Detect = Callable[[Any, int], tuple[Hand, ...]]


class _Run:
    """Both looks at the same pictures, in one growing time."""

    def __init__(self, looks: dict[str, Detect], step: Callable[[], None]) -> None:
        self._looks, self._step, self._now_ns = looks, step, GAP_NS

    def row(self, focal_px: float, gesture: str, hands: int) -> ZoneRow:
        lens = lens_for(focal_px=focal_px)
        people = [person_of(FIRST_HAND + number) for number in range(hands)]
        followed = [self._followed(gesture, person, lens) for person in people]
        clicked = [self._clicked(gesture, person, lens) for person in people]
        return ZoneRow(
            focal_px=focal_px,
            gesture=gesture,
            followed_cm={look: max(one[look] for one in followed) for look in LOOKS},
            commands={look: float(np.mean([one[look] for one in clicked])) for look in LOOKS},
        )

    def _followed(self, gesture: str, person: Person, lens: Intrinsics) -> dict[str, float]:
        """The nearest distance, cm, to which an approaching hand is followed without a break."""
        nearest = dict.fromkeys(LOOKS, APPROACH_M[0] * 100)
        broken = set[str]()
        distances = (*(APPROACH_M[0],) * SHOWN_FRAMES, *APPROACH_M)
        for number, (z, found) in enumerate(self._watch(gesture, person, lens, distances)):
            for look, hands in found.items():
                right = bool(hands) and abs(_ratio(hands[0], person, lens, z) - 1) < FAR_OFF
                if right and look not in broken:
                    nearest[look] = round(z * 100, 1)
                elif number >= SHOWN_FRAMES and not right:
                    broken.add(look)
        return nearest

    def _clicked(self, gesture: str, person: Person, lens: Intrinsics) -> dict[str, bool]:
        """Whether a push 4 cm past the proposed threshold's true place, and back, commands just this gesture."""
        threshold_m = zone_of(person, lens).threshold_m
        start_m, turn_m = threshold_m * 1.5, threshold_m / UPRIGHT_FACTOR - 0.04
        share = [smooth(1 - abs(2 * frame / CLICK_FRAMES - 1)) for frame in range(1, CLICK_FRAMES + 1)]
        distances = (
            *(start_m,) * SHOWN_FRAMES,
            *(start_m + (turn_m - start_m) * one for one in share),
            *(start_m,) * 4,
        )
        chains = {look: replay_pipeline("robust", person, lens, threshold_m) for look in LOOKS}
        released: dict[str, tuple[int, Gesture | None]] = dict.fromkeys(LOOKS, (0, None))
        for _, found in self._watch(gesture, person, lens, distances):
            for look, hands in found.items():
                replay, pipeline = chains[look]
                replay.hands = hands
                blank = np.zeros((lens.height_px, lens.width_px, 3), np.uint8)
                button = pipeline.process(Picture(image_bgr=blank, captured_ns=self._now_ns)).button
                released[look] = (button.release_count, button.released_gesture)
        return {look: one == (1, Gesture(gesture)) for look, one in released.items()}

    def _watch(
        self, gesture: str, person: Person, lens: Intrinsics, distances: tuple[float, ...]
    ) -> Iterator[tuple[float, dict[str, tuple[Hand, ...]]]]:
        self._now_ns += GAP_NS
        for number, z in enumerate(distances):
            self._now_ns += FRAME_NS
            scene = posed(gesture, person=person, lens=lens, position_m=(0.0, HEIGHT_M, z))
            image, _ = take(Moment(scene=scene), number)
            yield z, {look: detect(image, self._now_ns) for look, detect in self._looks.items()}
            self._step()


def _ratio(hand: Hand, person: Person, lens: Intrinsics, true_m: float) -> float:
    """Eq. 4 against the truth."""
    return lens.fx_px * person.shape.anchor_m / max(hand.anchor_px, 1.0) / true_m
