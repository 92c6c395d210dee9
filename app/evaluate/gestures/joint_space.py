"""Hands drawn from the space of joint angles, labelled by those angles, seen with MediaPipe's own errors.

Photos show few hands; between those lies everything else that a hand can do. Here a hand is its joint angles, so that
what it shows is known, and what MediaPipe would make of it is its true keypoints with the error that MediaPipe made
on a rendered hand of nearly the same angles. Which angles are open or folded stands in the limits below; what lies
between them could be either, and gets no label.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from app.evaluate.digital import tilted_scene
from app.evaluate.noise import residual, with_noise
from app.evaluate.readings import DetectedImage
from hal.cameras.digital_hand.render import Scene
from hal.cameras.digital_hand.skeleton import POSES, HandShape, joints_m
from kgdfa.gesture import FINGER_STATES, Finger, FingerState, Gesture
from kgdfa.hand import TIPS, FloatArray, Hand, Keypoint

LABEL = "none:joints"
# Of a finger, degrees: flexion is the sum over its three joints. Certainly in a state, certainly not in it.
OPEN_TO, NOT_OPEN_FROM = 45.0, 80.0
FOLDED_FROM, NOT_FOLDED_TO = 200.0, 165.0
HOOKED_MCP_TO, NOT_HOOKED_MCP_FROM = 35.0, 60.0  # a hook is straight at the knuckle, bent at the middle joint
HOOKED_PIP_FROM, NOT_HOOKED_PIP_TO = 60.0, 35.0
# Of the thumb's tip bone, degrees from the fingers' direction towards the thumb's own side.
THUMB_OPEN_FROM, THUMB_NOT_OPEN_TO = 38.0, 8.0
THUMB_FOLDED_TO, THUMB_NOT_FOLDED_FROM = -25.0, 12.0
# Of the thumb's tip from those of fore and middle finger, in palm lengths (0-9).
PINCHED_TO, NOT_PINCHED_FROM = 0.30, 0.60

MOST_TILT_RAD = np.radians(40.0)
STRAY_DEG = 5.0  # sd of every joint
NEIGHBOURS = 8  # an error is that of one of so many rendered hands with the nearest joint angles
_THUMBS = np.array([pose.angles_deg[Finger.THUMB] for pose in POSES.values()])
_POSES = sorted(POSES)
_WRONG_FINGERS = (0.2, 0.3, 0.25, 0.15, 0.1)  # chances of 0 to 4 fingers drawn anew


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """What MediaPipe was off by on n rendered hands: `noise.residual`, (n, 21, 2) and (n, 21, 3), and the hands'
    joint angles, (n, 5, 6).
    """

    angles_deg: FloatArray
    image: FloatArray
    world: FloatArray

    def observe(self, scene: Scene, random: Generator) -> Hand | None:
        """A scene's hand with the error of a hand like it; None when it is out of view."""
        apart = np.abs(self.angles_deg - scene.angles_deg).sum(axis=(1, 2))
        nearest = np.argsort(apart)[:NEIGHBOURS]
        one = int(nearest[random.integers(len(nearest))])
        return with_noise(scene, self.image[one], self.world[one])


def errors_of(scenes: Iterable[Scene], detected: Sequence[DetectedImage]) -> Errors:
    """The errors on those of these rendered hands that were found."""
    found = [(scene, one.hands[-1]) for scene, one in zip(scenes, detected, strict=True) if one.hands]
    rows = [residual(hand, scene) for scene, hand in found]
    return Errors(
        angles_deg=np.array([scene.angles_deg for scene, _ in found]),
        image=np.array([image for image, _ in rows]),
        world=np.array([world for _, world in rows]),
    )


def any_hand(random: Generator) -> FloatArray:
    """Joint angles (5, 6) from the whole space: every finger by itself, the thumb between those that people make."""
    angles = np.zeros((5, 6))
    for finger in range(1, 5):
        angles[finger] = _any_finger(random)
    angles[0] = _any_thumb(random)
    return angles


def hand_about(random: Generator, pose: str) -> FloatArray:
    """Joint angles about a pose, some of its fingers drawn anew from the whole space."""
    angles = POSES[pose].angles_deg + random.normal(0, STRAY_DEG, (5, 6))
    wrong = random.choice(5, random.choice(len(_WRONG_FINGERS), p=_WRONG_FINGERS), replace=False)
    for finger in wrong:
        angles[finger] = _any_thumb(random) if finger == 0 else _any_finger(random)
    return angles


def _any_finger(random: Generator) -> FloatArray:
    """Abduction and flexion at MCP, PIP and DIP; the last joint follows the one before it, as tendons make it."""
    middle = random.uniform(0, 110)
    end = max(0.0, 0.65 * middle + random.normal(0, 10))
    return np.array([random.uniform(-14, 14), random.uniform(-5, 92), middle, end, 0.0, 0.0])


def _any_thumb(random: Generator) -> FloatArray:
    """Between two of the thumbs of all poses."""
    start, end = _THUMBS[random.choice(len(_THUMBS), 2)]
    between: FloatArray = start + random.random() * (end - start) + random.normal(0, STRAY_DEG, 6)
    return between


def scene_about(angles_deg: FloatArray, person: int, random: Generator, turned_like: str = "5") -> Scene:
    """A person's hand with these angles, turned as people turn that pose and by up to 40° more, 20 to 60 cm away."""
    return tilted_scene(turned_like, person, random, MOST_TILT_RAD, angles_deg)


def label_by_joints(angles_deg: FloatArray) -> str | None:
    """The gesture that these joint angles show, `LABEL` when it is certainly none, None when it could be either."""
    certain = LABEL
    for gesture in Gesture:
        sure = _shows(gesture, angles_deg)
        if sure:
            return gesture.value
        certain = certain if sure is False else ""
    return certain or None


def _shows(gesture: Gesture, angles_deg: FloatArray) -> bool | None:
    """True when every finger is in its state, False when one is certainly not, else None."""
    shown: bool | None = True
    for finger in reversed(Finger):  # the pinch, which takes longest, last
        sure = _is(FINGER_STATES[gesture][finger], finger, angles_deg)
        if sure is False:
            return False
        shown = shown and sure
    return shown


def _is(state: FingerState, finger: Finger, angles_deg: FloatArray) -> bool | None:
    if state is FingerState.PINCHED:
        return _pinched(finger, angles_deg)
    if finger is Finger.THUMB:
        azimuth = float(angles_deg[0, 4])
        if state is FingerState.OPEN:
            return _sure(azimuth >= THUMB_OPEN_FROM, azimuth <= THUMB_NOT_OPEN_TO)
        return _sure(azimuth <= THUMB_FOLDED_TO, azimuth >= THUMB_NOT_FOLDED_FROM)
    knuckle, middle, end = angles_deg[finger, 1:4].tolist()
    flexion = knuckle + middle + end
    if state is FingerState.OPEN:
        return _sure(flexion <= OPEN_TO, flexion >= NOT_OPEN_FROM)
    if state is FingerState.FOLDED:
        return _sure(flexion >= FOLDED_FROM, flexion <= NOT_FOLDED_TO)
    return _sure(
        knuckle <= HOOKED_MCP_TO and middle >= HOOKED_PIP_FROM,
        knuckle >= NOT_HOOKED_MCP_FROM or middle <= NOT_HOOKED_PIP_TO,
    )


def _pinched(finger: Finger, angles_deg: FloatArray) -> bool | None:
    """By where the tips are, and fore and middle finger straight beyond their knuckles."""
    joints = joints_m(HandShape(), angles_deg)
    palm = np.linalg.norm(joints[Keypoint.MIDDLE_MCP] - joints[Keypoint.WRIST])
    others = (Finger.FORE, Finger.MIDDLE) if finger is Finger.THUMB else (finger,)
    apart = max(float(np.linalg.norm(joints[TIPS[0]] - joints[TIPS[other]]) / palm) for other in others)
    bent = max(float(angles_deg[other, 2:4].sum()) for other in others)
    return _sure(apart <= PINCHED_TO and bent <= OPEN_TO, apart >= NOT_PINCHED_FROM or bent >= NOT_OPEN_FROM)


def _sure(certainly: bool, certainly_not: bool) -> bool | None:
    return True if certainly else False if certainly_not else None


@dataclass(frozen=True, slots=True, kw_only=True)
class JointHand:
    """A hand, its label by joint angles, and these, (5, 6)."""

    label: str
    angles_deg: FloatArray
    hand: Hand


def joint_hands(errors: Errors, count: int, first_person: int, poses: Sequence[str] = ()) -> Iterator[JointHand]:
    """So many hands of different people that have a label: about these poses in turn, or from the whole space."""
    random, made = np.random.default_rng(first_person), 0
    while made < count:
        pose = poses[made % len(poses)] if poses else _POSES[random.integers(len(_POSES))]
        angles = hand_about(random, pose) if poses else any_hand(random)
        label = label_by_joints(angles)
        if label is None:
            continue
        hand = errors.observe(scene_about(angles, first_person + made, random, turned_like=pose), random)
        if hand is not None:
            made += 1
            yield JointHand(label=label, angles_deg=angles, hand=hand)
