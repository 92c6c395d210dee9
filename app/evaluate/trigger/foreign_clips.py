"""The clips of `rleex evaluate foreign`: who is before the camera and what their hands do, drawn before any is run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.render import Scene, person_of
from hal.minimum_jerk import minimum_jerk
from kgdfa.gesture import Gesture

CLIP_FRAMES = 105
SECOND_NS = 1_000_000_000
IN_NS, SIGN_NS, PUSH_NS, AGAIN_NS = (round(s * SECOND_NS) for s in (0.4, 0.5, 1.2, 2.2))  # of a clip
CLICK_S = 0.6
OUTSIDE_M = 0.55  # along the arm, out of the image
BESIDE_M = 0.19  # the enrolled hand stands aside by it
# How much farther from the camera a hand is whose arm crosses the enrolled one: an arm is 8 cm thick and can't be where
# the hand is, and one before the hand stops its push.
BEHIND_M = 0.11
FIRST_FOREIGN = 700_000  # nobody else's seed
PEOPLE = 100_000  # of whom each hand is drawn
GESTURES = tuple(Gesture)


class ForeignKind(Enum):
    """What the foreign hand does. Sides: of the enrolled hand."""

    OTHER_SIDE = "other side alone"  # from below, as the enrolled hand would come
    SAME_SIDE = "same side alone"  # its arm from the side or from above
    BESIDE = "beside"  # the enrolled hand rests in view; other side
    ACROSS_OTHER = "across, other side"  # before the enrolled hand, which shows a gesture
    ACROSS_SAME = "across, same side"


ACROSS = (ForeignKind.ACROSS_OTHER, ForeignKind.ACROSS_SAME)
SAME = (ForeignKind.SAME_SIDE, ForeignKind.ACROSS_SAME)


class PushKind(Enum):
    """Where the foreign hand is while the enrolled one pushes."""

    ALONE = "alone"  # nowhere
    BESIDE = "beside"  # on the side from which its arm comes
    BEHIND = "behind"  # on the other side, its arm behind the enrolled hand
    CROSSED = "crossed"  # beside, after it reached across the enrolled hand and drew back


def turned(scene: Scene, roll_rad: float, shift_m: tuple[float, float], away: float) -> Scene:
    """The hand turned clockwise about the image's middle, shifted, and away along its arm: 1 is out of the image."""
    if scene.place is None:
        return scene
    (x, y, z), (pitch, yaw, roll) = scene.place.position_m, scene.place.turn_rad
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    y += away * OUTSIDE_M
    position = (float(c * x - s * y + shift_m[0]), float(s * x + c * y + shift_m[1]), z)
    return replace(scene, place=replace(scene.place, position_m=position, turn_rad=(pitch, yaw, roll + roll_rad)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Foreigner:
    """A therapist's hand: it reaches in, signs, pushes, signs another gesture and pushes again."""

    seed: int
    left: bool
    nearer_m: float
    gestures: tuple[Gesture, Gesture]
    roll_rad: float
    shift_m: tuple[float, float]
    crosses: bool = False  # it reaches in to the other side of the image, and draws back to where `shift_m` says

    @property
    def reaches_across(self) -> bool:
        """Whether it comes from one side and stands on the other."""
        return float(np.sin(self.roll_rad)) * self.shift_m[0] > BESIDE_M / 2

    def camera(self) -> DigitalHandCamera:
        """Its hand, whose movements are begun."""
        camera = DigitalHandCamera(seed=self.seed, person=person_of(self.seed, left=self.left), clock_ns=lambda: 0)
        camera.command(move_m=(0.0, 0.0, -self.nearer_m), at_ns=0)
        for sign_ns, gesture in zip((SIGN_NS, AGAIN_NS - SECOND_NS // 5), self.gestures, strict=True):
            camera.command(gesture=gesture.value, at_ns=sign_ns)
        for push_ns in (PUSH_NS, AGAIN_NS + SECOND_NS // 3):
            camera.command(click_s=CLICK_S, at_ns=push_ns)
        return camera

    def scene(self, camera: DigitalHandCamera, clip_ns: int) -> Scene:
        """Its scene at a moment of the clip."""
        away, (x, y) = max(0.0, 1 - clip_ns / IN_NS), self.shift_m
        if self.crosses:
            x *= 2 * minimum_jerk(min(1.0, max(0.0, clip_ns / IN_NS - 1))) - 1
        return turned(camera.scene(clip_ns), self.roll_rad, (x, y), away)


def standing(draw: np.random.Generator, own_left: bool) -> Foreigner:
    """A person whose hand, of the other side, stands on either side of the enrolled one, its arm not in the way."""
    other = _aside(draw, own_left)
    return replace(other, nearer_m=other.nearer_m - BEHIND_M) if other.reaches_across else other


def _aside(draw: np.random.Generator, own_left: bool) -> Foreigner:
    other = foreigner(draw, ForeignKind.OTHER_SIDE, own_left)
    return replace(other, shift_m=(float(draw.choice([-1, 1])) * BESIDE_M, 0.0))


def crossing(draw: np.random.Generator, own_left: bool) -> Foreigner:
    """A person whose hand, of the other side, reaches from its arm's side across the enrolled one, and draws back."""
    aside = float(draw.choice([-1, 1]))
    other = replace(_aside(draw, own_left), shift_m=(aside * BESIDE_M, 0.0), crosses=True)
    return replace(other, roll_rad=-aside * np.pi / 2 + float(draw.normal(0, np.radians(10))))


def foreigner(draw: np.random.Generator, kind: ForeignKind, own_left: bool) -> Foreigner:
    """A person drawn at random, with the side and the arm of that kind."""
    seed = FIRST_FOREIGN + int(draw.integers(PEOPLE))
    nearer_m = float(draw.uniform(0.04, 0.10))
    first, second = draw.choice(len(GESTURES), 2, replace=False)
    # From the left, the right or above (π), each spread by 10°; of the other side also from below.
    roll = float(draw.choice([np.pi / 2, -np.pi / 2, np.pi])) + float(draw.normal(0, np.radians(5)))
    if kind in {ForeignKind.OTHER_SIDE, ForeignKind.BESIDE, ForeignKind.ACROSS_OTHER}:
        roll = float(draw.choice([0.0, roll])) + float(draw.normal(0, np.radians(10)))
    return Foreigner(
        seed=seed,
        left=own_left if kind in SAME else not own_left,
        nearer_m=nearer_m,
        gestures=(GESTURES[first], GESTURES[second]),
        roll_rad=roll,
        shift_m=(BESIDE_M / 2, 0.0) if kind is ForeignKind.BESIDE else (0.0, 0.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Clip:
    """One clip, all of it drawn. kind: None, the enrolled hand's own push, with `other` in view or alone."""

    name: str  # of all clips of every seed its own
    kind: ForeignKind | None
    own_seed: int
    gesture: Gesture | None = None  # of the enrolled hand
    other: Foreigner | None = None

    @property
    def push(self) -> PushKind:
        """Of the enrolled hand's own push."""
        if self.other is None:
            return PushKind.ALONE
        if self.other.crosses:
            return PushKind.CROSSED
        return PushKind.BEHIND if self.other.reaches_across else PushKind.BESIDE


def clips(*, frames: int, pushes: int, seed: int) -> list[Clip]:
    """Clips of at least so many frames in all; so many pushes of the enrolled hand alone, beside one and crossed."""
    return list(_clips(frames, pushes, seed))


def _own(seed: int) -> np.random.Generator:
    """Of the enrolled people; a generator of its own, so that a clip is the same however many there are of others."""
    return np.random.default_rng([seed, 0x006F_776E])


def _clips(frames: int, pushes: int, seed: int) -> Iterator[Clip]:
    draw, own, kinds = np.random.default_rng([seed, 0x666F_7265]), _own(seed), tuple(ForeignKind)
    for number in range(-(-frames // CLIP_FRAMES)):
        kind, own_seed = kinds[number % len(kinds)], FIRST_FOREIGN - 1 - int(own.integers(PEOPLE))
        other = foreigner(draw, kind, person_of(own_seed).shape.left)
        gesture = GESTURES[int(draw.integers(len(GESTURES)))] if kind in ACROSS else None
        yield Clip(name=f"{seed}-{number}", kind=kind, own_seed=own_seed, gesture=gesture, other=other)
    draw, own = np.random.default_rng([seed, 0x7075_7368]), _own(seed)
    for number in range(pushes):
        own_seed, gesture = FIRST_FOREIGN // 2 + int(own.integers(PEOPLE)), GESTURES[number % len(GESTURES)]
        left = person_of(own_seed).shape.left
        others = {"alone": None, "beside": standing(draw, left), "crossed": crossing(draw, left)}
        for name, one in others.items():
            yield Clip(name=f"{seed}-{name}-{number}", kind=None, own_seed=own_seed, gesture=gesture, other=one)
