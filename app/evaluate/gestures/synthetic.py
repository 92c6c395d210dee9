"""Data augmentation: synthetic hands, recombined from the fingers of one real hand and the palm of another.

Some gestures are shown by one source of images only, and most of the combinations of open and folded fingers by
none. Recombining makes them: the twelve gestures on every palm and view, and everything near them that must be
refused. Only 3-D landmarks of hands that serve for fitting are used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from app.evaluate.digital import SOURCE, centred, label_of, scene_of
from app.evaluate.readings import LabelledImage
from hal.cameras.digital_hand.render import Scene
from hal.cameras.digital_hand.skeleton import GESTURES, LOOK_ALIKES, POSES
from kgdfa.features import features
from kgdfa.gesture import FINGER_STATES, FingerState
from kgdfa.hand import FloatArray

PINCHED = "7"  # its three tips touch, so thumb, fore and middle are never taken apart
_LETTER = {FingerState.OPEN: "o", FingerState.FOLDED: "f", FingerState.HOOKED: "h", FingerState.PINCHED: "p"}


def _letters(states: tuple[FingerState, ...]) -> str:
    """An open forefinger must be straight."""
    thumb, fore, *others = (_LETTER[state] for state in states)
    return "".join([thumb, fore.replace("o", "s"), *others])


# Each label's fingers, thumb to pinky: o open, f folded, s straight, h hooked, x of no use.
FINGERS_OF: dict[str, str] = {
    **{one.value: _letters(states) for one, states in FINGER_STATES.items() if one.value != PINCHED},
    "none:good": "offff",
    "none:gun": "osoff",
    "none:index_middle_pinky": "fsofo",
    "none:pinky": "ffffo",
    "none:asl7": "xsoxo",
    "none:asl8": "xsxoo",
    "none:ok": "xxooo",
}
GESTURE_OF = {fingers: label for label, fingers in FINGERS_OF.items() if not label.startswith("none:")}
SYNTHETIC_NONE = "none:grafted"  # the name of the class in the shipped model
_ROOTS = np.array([1, 5, 9, 13, 17])
_THUMB_TIP, _MIDDLE_JOINTS = 4, np.array([6, 10, 14, 18])
_CHAINS = np.arange(1, 21).reshape(5, 4)

PER_GESTURE = 150  # hands made of each gesture
PER_OTHER = 50  # of each combination that is none; a third of it with a hooked forefinger
PER_HALFWAY = 50  # of each gesture with its thumb halfway between open and folded: none
BESIDE = 800  # fists with an open thumb laid beside them
# Of such a thumb's tip, in palm lengths beyond the furthest middle joint, and to the side of the forefinger's: from
# where on it stands out, and the hand is a thumb up; up to where it is a fist.
STANDS_OUT, STAYS_IN = 0.12, 0.08
STANDS_ASIDE, STAYS_BESIDE = 0.35, 0.20
MORE_HOOKED, LESS_HOOKED = 0.3, 0.2  # how far a hooked forefinger is drawn to a folded or a straight one
RESPLAYED = 0.5  # share of synthetic hands whose straight fingers are brought together or spread: people do either
VIEW_SD_RAD = 0.2  # random turn of the whole hand
NOISE_PALMS = 0.012  # of each landmark, as a share of the palm's length

# Digital hands near the gestures: joints stray from the poses, a naturally open hand is bent more or less, and hands
# are halfway from one pose to another. Nobody here is measured.
NEAR_SEEDS = 2_000_000  # people from here on are only fitted on
NEAR_PEOPLE = 20
NATURALLY_OPEN = 6  # of each person, from nearly 5 to bent further than the pose
BETWEEN = 6  # of each person, halfway from one pose to another
BETWEEN_LABEL = "none:between"
STRAY_DEG = 4.0  # sd of every joint
_FLEXION = slice(1, 4)  # MCP, PIP, DIP of a finger; for the thumb, angles of its bones
CLEAR_FINGER_DEG = 70.0  # a finger's whole flexion must differ by this from a gesture's, or
CLEAR_THUMB_DEG = 45.0  # the thumb's tip bone in azimuth, for a hand to be certainly no such gesture


class HandSynthesizer:
    """Real hands, separated into palms and fingers. world_m: (n, 21, 3); labels: n."""

    def __init__(self, world_m: FloatArray, right: NDArray[np.bool_], labels: list[str], seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._labels = np.array(labels)
        frames = [_palm_frame(hand, bool(side)) for hand, side in zip(world_m, right, strict=True)]
        self._axes = np.array([axes for axes, _ in frames])
        lengths = np.array([length for _, length in frames])
        centred = world_m - world_m[:, :1]
        self._shapes = np.einsum("nij,nkj->nki", self._axes, centred) / lengths[:, None, None]
        self._of_label = {label: np.flatnonzero(self._labels == label) for label in {*FINGERS_OF, PINCHED}}
        self._pools: dict[tuple[int, str], list[NDArray[np.int64]]] = {}
        for label, states in FINGERS_OF.items():
            for finger, state in enumerate(states):
                if len(self._of_label[label]) and state != "x":
                    self._pools.setdefault((finger, state), []).append(self._of_label[label])

    def make(self, share: float = 1.0) -> tuple[FloatArray, list[str]]:
        """Features of the synthetic hands, (n, F), and their labels; share: of the usual numbers."""
        per_gesture, per_other, per_halfway, beside = (
            max(1, round(share * number)) for number in (PER_GESTURE, PER_OTHER, PER_HALFWAY, BESIDE)
        )
        made: list[tuple[FloatArray, str]] = []
        for states in map("".join, product("of", "shf", "of", "of", "of")):
            label = GESTURE_OF.get(states, SYNTHETIC_NONE)
            often = per_gesture if label in FINGERS_OF else per_other // (3 if states[1] == "h" else 1)
            made += [(self._recombined(states), label) for _ in range(often)] if self._can(states) else []
        for states in filter(self._can, GESTURE_OF):
            made += [(self._halfway(states), SYNTHETIC_NONE) for _ in range(per_halfway)]
        if len(self._of_label[PINCHED]):
            made += [(self._pinched(), PINCHED) for _ in range(per_gesture)]
        if len(self._of_label["0"]):
            made += [self._thumb_beside_fist() for _ in range(beside)]
        return np.array([values for values, _ in made]), [label for _, label in made]

    def _can(self, states: str) -> bool:
        return all((finger, state) in self._pools for finger, state in enumerate(states))

    def _any(self, members: NDArray[np.int64]) -> int:
        return int(members[self._random.integers(len(members))])

    def _donor(self, finger: int, state: str) -> int:
        pools = self._pools[finger, state]
        return self._any(pools[self._random.integers(len(pools))])

    def _recombined(self, states: str) -> FloatArray:
        """A hand with these fingers, mostly grown on one that needs one new finger or none."""
        needs = {
            label: sum(a != b for a, b in zip(own, states, strict=True))
            for label, own in FINGERS_OF.items()
            if len(self._of_label[label])
        }
        near = [label for label in needs if needs[label] <= max(1, min(needs.values()))]
        labels = near if self._random.random() < 0.7 else list(needs)
        label = labels[self._random.integers(len(labels))]
        base = self._any(self._of_label[label])
        shape = self._shapes[base].copy()
        for finger, (own, wanted) in enumerate(zip(FINGERS_OF[label], states, strict=True)):
            if own != wanted or self._random.random() < 0.2:
                self._set(shape, finger, self._segment(finger, wanted))
        if self._random.random() < RESPLAYED:
            self._splay(shape, states, self._random.uniform(0, 1.2))
        return self._observed(shape, base)

    def _splay(self, shape: FloatArray, states: str, share: float) -> None:
        """Bring straight fingers together or spread them: 0 lays them side by side, 1 leaves them as they are."""
        for finger in (1, 2, 3, 4):
            if states[finger] in "so":
                segment = shape[_CHAINS[finger]] - shape[_ROOTS[finger]]
                self._set(shape, finger, _turned(segment, (share - 1) * np.arctan2(segment[3, 1], segment[3, 0])))

    def _halfway(self, states: str) -> FloatArray:
        """One of the gestures with its thumb between open and folded."""
        base = self._any(np.arange(len(self._labels)))
        shape = self._shapes[base].copy()
        for finger, wanted in enumerate(states):
            self._set(shape, finger, self._segment(finger, wanted))
        other = self._segment(0, "f" if states[0] == "o" else "o")
        share = self._random.uniform(0.40, 0.65)
        self._set(shape, 0, (1 - share) * (shape[_CHAINS[0]] - shape[_ROOTS[0]]) + share * other)
        return self._observed(shape, base)

    def _pinched(self) -> FloatArray:
        base = self._any(self._of_label[PINCHED])
        shape = self._shapes[base].copy()
        for finger in (3, 4):
            self._set(shape, finger, self._segment(finger, "f"))
        return self._observed(shape, base)

    def _thumb_beside_fist(self) -> tuple[FloatArray, str]:
        """A real fist with an open thumb laid beside it: a 0 when its tip stays at the fingers' joints, none when it
        stands out. What lies between could be either, and is drawn anew.
        """
        fists = [self._of_label[label] for label in ("0", "none:good") if len(self._of_label[label])]
        while True:
            base = self._any(fists[self._random.integers(len(fists))])
            shape = self._shapes[base].copy()
            self._set(shape, 0, self._thumb_along())
            beyond = shape[_THUMB_TIP, 0] - shape[_MIDDLE_JOINTS, 0].max()
            aside = shape[_THUMB_TIP, 1] - shape[_MIDDLE_JOINTS[0], 1]
            if beyond >= STANDS_OUT or aside >= STANDS_ASIDE:
                return self._observed(shape, base), SYNTHETIC_NONE
            if beyond <= STAYS_IN and aside <= STAYS_BESIDE:
                return self._observed(shape, base), "0"

    def _thumb_along(self) -> FloatArray:
        """An open thumb turned along the fingers, and mostly drawn some way to where a folded one lies."""
        thumb = self._segment(0, "o")
        thumb = _turned(thumb, np.radians(self._random.uniform(-8, 30)) - np.arctan2(thumb[3, 1], thumb[3, 0]))
        share = max(0.0, self._random.uniform(-0.3, 0.7))
        drawn: FloatArray = (1 - share) * thumb + share * self._segment(0, "f")
        return drawn

    def _segment(self, finger: int, state: str) -> FloatArray:
        """A real finger in this state, (4, 3) from its root, in palm lengths along the palm's axes."""
        segment = self._own_segment(finger, state)
        if state == "h":  # people hook it more or less: up to 120° at its joint, from nearly folded
            other, most = ("f", MORE_HOOKED) if self._random.random() < 0.5 else ("s", LESS_HOOKED)
            share = self._random.uniform(0, most)
            return (1 - share) * segment + share * self._own_segment(finger, other)
        return segment

    def _own_segment(self, finger: int, state: str) -> FloatArray:
        donor = self._shapes[self._donor(finger, state)]
        segment: FloatArray = donor[_CHAINS[finger]] - donor[_ROOTS[finger]]
        return segment

    def _set(self, shape: FloatArray, finger: int, segment: FloatArray) -> None:
        shape[_CHAINS[finger]] = shape[_ROOTS[finger]] + segment

    def _observed(self, shape: FloatArray, base: int) -> FloatArray:
        """The features of a synthetic hand before the camera of its base, turned a little and with noise."""
        turn = _rotation(self._random.normal(0, VIEW_SD_RAD, 3))
        world = shape @ self._axes[base] @ turn.T + self._random.normal(0, NOISE_PALMS, shape.shape)
        image_px = world[:, :2] / (1 + 0.25 * world[:, 2:])  # a camera four palm lengths away
        noisy = world + self._random.normal(0, NOISE_PALMS, world.shape)
        return features(image_px * 200, noisy)


def _palm_frame(world_m: FloatArray, right: bool) -> tuple[FloatArray, float]:
    """Rows along the palm, across it to the thumb, and off it on the side to which fingers fold; its length."""
    along = world_m[9] - world_m[0]
    length = max(float(np.linalg.norm(world_m[joint] - world_m[0])) for joint in (5, 9, 13))
    along = along / np.linalg.norm(along)
    across = world_m[5] - world_m[17]
    across = across - (across @ along) * along
    across = across / np.linalg.norm(across)
    off = np.cross(along, across)
    curl = sum(float((world_m[tip] - world_m[tip - 3]) @ off) for tip in (8, 12, 16, 20)) / length
    folded = abs(curl) > 0.25  # then the curl itself tells the palm's side, better than the detector's guess
    sign = np.sign(curl) if folded else (1.0 if right else -1.0)
    return np.stack([along, across, sign * off]), length


def _turned(segment: FloatArray, angle_rad: float) -> FloatArray:
    """A finger turned in the palm's plane."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    turned: FloatArray = segment @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    return turned


def _rotation(vector_rad: FloatArray) -> FloatArray:
    """Rodrigues' formula, (3,) to (3, 3)."""
    angle = float(np.linalg.norm(vector_rad)) or 1e-12
    x, y, z = vector_rad / angle
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: FloatArray = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    return rotation


def near_scenes(people: int = NEAR_PEOPLE, first_seed: int = NEAR_SEEDS) -> Iterator[tuple[LabelledImage, Scene, int]]:
    """Each person's hands, labelled, with the seed of the image's noise."""
    for person in range(first_seed, first_seed + people):
        random = np.random.default_rng(person)
        for place, (label, pose, angles) in enumerate(_hands(random)):
            seed = person * 100 + place
            scene = replace(scene_of(pose, person, seed), angles_deg=angles + random.normal(0, STRAY_DEG, angles.shape))
            distance_m = scene.place.position_m[2] if scene.place else 0.0
            labelled = LabelledImage(path=f"near/{pose}/{seed}", label=label, source=SOURCE, group=str(person))
            yield labelled, centred(scene, distance_m), seed


def _hands(random: Generator) -> Iterator[tuple[str, str, FloatArray]]:
    """Label, the pose whose usual turn it has, and joint angles (5, 6)."""
    for pose in (*GESTURES, *LOOK_ALIKES):
        yield label_of(pose.name), pose.name, pose.angles_deg
    for _ in range(NATURALLY_OPEN):
        share = random.uniform(0.7, 1.4)
        yield label_of("naturally open"), "naturally open", _between("5", "naturally open", share)
    for _ in range(BETWEEN):
        start, angles = _halfway(random)
        yield BETWEEN_LABEL, start, angles


def _halfway(random: Generator) -> tuple[str, FloatArray]:
    """A hand between two poses that is certainly none of the gestures: drawn until one is."""
    names = sorted(POSES)
    while True:
        start, end = random.choice(names, 2, replace=False)
        angles = _between(str(start), str(end), random.uniform(0.35, 0.65))
        if all(_clearly_not(angles, gesture.angles_deg) for gesture in GESTURES):
            return str(start), angles


def _between(start: str, end: str, share: float) -> FloatArray:
    a, b = POSES[start].angles_deg, POSES[end].angles_deg
    mixed: FloatArray = a + share * (b - a)
    return mixed


def _clearly_not(angles: FloatArray, gesture: FloatArray) -> bool:
    flexion = np.abs((angles - gesture)[1:, _FLEXION].sum(axis=1))
    return bool(flexion.max() >= CLEAR_FINGER_DEG or abs(angles[0, 4] - gesture[0, 4]) >= CLEAR_THUMB_DEG)
