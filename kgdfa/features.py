"""The paper's measures made independent of view, scale, mirror and hand: the input of the `robust` rules.

Three families, as in Table 2: how far each finger is bent (angles), where each fingertip lies relative to the
palm (the hulls and their 3-D counterparts), how far tips are apart relative to the palm. Every one is an angle
or a ratio of lengths, so neither distance, rotation in the image nor left or right changes it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import accumulate, combinations, pairwise
from operator import itemgetter

import numpy as np

from kgdfa.gesture import Explanation, Finger
from kgdfa.hand import ANGLE_POINTS, INNER_HULL, OUTER_HULL, TIPS, FloatArray, tip_depths


class Unit(Enum):
    """What a feature is measured in."""

    DEGREES = "degrees"
    PALMS = "palm lengths"
    SHARE = "share"


class Measure(Enum):
    """What a feature measures, of the fingers named with it."""

    ROOT_JOINT = "root joint"
    MIDDLE_JOINT = "middle joint"
    END_JOINT = "end joint"
    ANGLE = "angle"  # Eq. 1
    SPLAY = "splay"  # between two fingers
    STRAIGHTNESS = "straightness"
    LENGTH = "length"
    TIP_TO_WRIST = "tip to wrist"
    TIP_TO_PALM = "tip to palm"
    TIPS_APART = "tips apart"
    TIP_TO_KNUCKLE = "tip to knuckle"  # of another finger
    TIP_TO_JOINT = "tip to joint"
    REACH_ALONG = "reach along"  # the palm, towards the middle finger
    REACH_ACROSS = "reach across"  # the palm, towards the thumb's side
    REACH_OFF = "reach off"  # the palm's plane
    TIP_BEYOND_JOINTS = "tip beyond joints"
    TIP_ASIDE = "tip aside"  # of the forefinger's joint
    MIDDLE_BONE_ALONG = "middle bone along"
    MIDDLE_BONE_ACROSS = "middle bone across"
    MIDDLE_BONE_OFF = "middle bone off"
    END_BONE_ALONG = "end bone along"
    END_BONE_ACROSS = "end bone across"
    END_BONE_OFF = "end bone off"
    TIP_BEYOND_OUTER_HULL = "tip beyond outer hull"
    TIP_BEYOND_INNER_HULL = "tip beyond inner hull"
    ON_IMAGE = "on image"  # another measure, without depth


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """One number about a hand. group: the finger that it is about; None: tips together."""

    measure: Measure
    fingers: tuple[Finger, ...]
    group: Finger | None
    unit: Unit
    on_image: bool = False

    @property
    def name(self) -> str:
        """For engineers' tables: "fore angle on image"."""
        fingers = "-".join(finger.name.lower() for finger in self.fingers)
        return f"{fingers} {self.measure.value}" + (f" {Measure.ON_IMAGE.value}" if self.on_image else "")

    def explain(self) -> Explanation:
        """What it measures, with its fingers."""
        what = Explanation(self.measure, dict(zip(("finger", "other"), self.fingers, strict=False)))
        return Explanation(Measure.ON_IMAGE, {"measure": what}) if self.on_image else what


_CHAINS = tuple((0, *range(4 * finger + 1, 4 * finger + 5)) for finger in range(5))
_NEIGHBOURS = tuple(pairwise(range(5)))
_PAIRS = tuple(combinations(range(5), 2))
_THUMB_TARGETS = (5, 6, 9, 10, 13, 14, 17, 18)


def _per_finger(measure: Measure, unit: Unit, *, on_image: bool = False) -> list[Feature]:
    return [Feature(measure=measure, fingers=(one,), group=one, unit=unit, on_image=on_image) for one in Finger]


def _between(
    measure: Measure, pairs: tuple[tuple[int, int], ...], unit: Unit, *, on_image: bool = False
) -> list[Feature]:
    return [
        Feature(measure=measure, fingers=(Finger(a), Finger(b)), group=None, unit=unit, on_image=on_image)
        for a, b in pairs
    ]


def _of_thumb(measure: Measure, unit: Unit, *others: Finger) -> Feature:
    return Feature(measure=measure, fingers=(Finger.THUMB, *others), group=Finger.THUMB, unit=unit)


def _angles_of(*, on_image: bool) -> list[Feature]:
    joints = (Measure.ROOT_JOINT, Measure.MIDDLE_JOINT, Measure.END_JOINT, Measure.ANGLE)
    each = [feature for joint in joints for feature in _per_finger(joint, Unit.DEGREES, on_image=on_image)]
    return [*each, *_between(Measure.SPLAY, _NEIGHBOURS, Unit.DEGREES, on_image=on_image)]


FEATURES: tuple[Feature, ...] = (
    *_angles_of(on_image=False),
    *_angles_of(on_image=True),
    *_per_finger(Measure.STRAIGHTNESS, Unit.SHARE),
    *_per_finger(Measure.TIP_TO_WRIST, Unit.PALMS),
    *_per_finger(Measure.TIP_TO_PALM, Unit.PALMS),
    *_between(Measure.TIPS_APART, _PAIRS, Unit.PALMS),
    *(
        _of_thumb(measure, Unit.PALMS, Finger((joint - 1) // 4))
        for joint, measure in zip(_THUMB_TARGETS, (Measure.TIP_TO_KNUCKLE, Measure.TIP_TO_JOINT) * 4, strict=True)
    ),
    *_per_finger(Measure.LENGTH, Unit.PALMS, on_image=True),
    *_between(Measure.TIPS_APART, _PAIRS, Unit.PALMS, on_image=True),
    *_per_finger(Measure.REACH_ALONG, Unit.PALMS),
    *_per_finger(Measure.REACH_ACROSS, Unit.PALMS),
    *_per_finger(Measure.REACH_OFF, Unit.PALMS),
    _of_thumb(Measure.TIP_BEYOND_JOINTS, Unit.PALMS),
    _of_thumb(Measure.TIP_ASIDE, Unit.PALMS),
    *(
        _of_thumb(measure, Unit.SHARE)
        for measure in (
            *(Measure.MIDDLE_BONE_ALONG, Measure.MIDDLE_BONE_ACROSS, Measure.MIDDLE_BONE_OFF),
            *(Measure.END_BONE_ALONG, Measure.END_BONE_ACROSS, Measure.END_BONE_OFF),
        )
    ),
    *_per_finger(Measure.TIP_BEYOND_OUTER_HULL, Unit.PALMS),
    *_per_finger(Measure.TIP_BEYOND_INNER_HULL, Unit.PALMS),
)


_Vector = tuple[float, float, float]
_Lines = tuple[tuple[int, int], ...]  # each between two points, by number: (end, start)

# All points of a hand in one array: 21 keypoints in space, the middle of the palm's triangle 0, 5, 17, and the 21 on
# the image. All lines between them, in named blocks, so that every length and angle comes from one subtraction.
_CENTRE, _PICTURE = 21, 22
_ARMS: _Lines = tuple((end, vertex) for vertex, *ends in ANGLE_POINTS.values() for end in ends)
_REACHES: _Lines = tuple((chain[4], chain[1]) for chain in _CHAINS)
_TIPS_APART: _Lines = tuple((TIPS[a], TIPS[b]) for a, b in _PAIRS)
_BONES: _Lines = tuple((end, start) for chain in _CHAINS for start, end in pairwise(chain))
_PALM: _Lines = ((5, 0), (9, 0), (17, 0), (5, 17))  # the longest is the palm's size: a tilt shortens it least


def _on_picture(lines: _Lines) -> _Lines:
    return tuple((end + _PICTURE, start + _PICTURE) for end, start in lines)


_BLOCKS: dict[str, _Lines] = {
    "palm": _PALM,
    "bones": _BONES,
    "arms": _ARMS,
    "reaches": _REACHES,
    "to wrist": tuple((tip, 0) for tip in TIPS),
    "to centre": tuple((tip, _CENTRE) for tip in TIPS),
    "tips": _TIPS_APART,
    "thumb": tuple((4, target) for target in _THUMB_TARGETS),
    "seen palm": _on_picture(_PALM),  # from here on, on the image
    "seen bones": _on_picture(_BONES),
    "seen arms": _on_picture(_ARMS),
    "seen reaches": _on_picture(_REACHES),
    "seen tips": _on_picture(_TIPS_APART),
}
_LINES = np.array([line for block in _BLOCKS.values() for line in block]).T  # (2, lines)
_TRIANGLE = np.array([0, 5, 17])
_STOPS = dict(zip(_BLOCKS, accumulate(map(len, _BLOCKS.values())), strict=True))
_OF = {name: slice(_STOPS[name] - len(block), _STOPS[name]) for name, block in _BLOCKS.items()}


def _numbers(*names: str) -> list[int]:
    """Where the lines of these blocks stand."""
    return [number for name in names for number in range(_OF[name].start, _OF[name].stop)]


def _bones_of_fingers(name: str) -> list[list[int]]:
    """Of each finger its four bones, from the wrist outwards."""
    return [list(bones) for bones in zip(*[iter(_numbers(name))] * 4, strict=True)]


def _joints(name: str) -> list[tuple[int, int]]:
    """The bones that meet at each root joint, then at each middle joint, then at each end joint."""
    return [(bones[k], bones[k + 1]) for k in range(3) for bones in _bones_of_fingers(name)]


def _arm_pairs(name: str) -> list[tuple[int, int]]:
    arms = _numbers(name)
    return list(zip(arms[0::2], arms[1::2], strict=True))


_NO_LENGTH = 1e-300  # changes no quotient but 0 / 0, which is to be 1
_MEETING = np.array(
    [
        *_joints("bones"),
        *_arm_pairs("arms"),
        *pairwise(_numbers("reaches")),
        *_joints("seen bones"),
        *_arm_pairs("seen arms"),
        *pairwise(_numbers("seen reaches")),
    ]
).T  # (2, angles)
# Where two bones meet, 180° is straight on: bones point outwards, with 0° between them
_IS_JOINT = np.isin(_MEETING[0], [*_numbers("bones"), *_numbers("seen bones")])
_FROM_DEG, _TURN = np.where(_IS_JOINT, 180.0, 0.0), np.where(_IS_JOINT, -1.0, 1.0)
_BONES_OF_FINGERS = _bones_of_fingers("bones")
_OUTER_BONES = [(reach, *bones[1:]) for reach, bones in zip(_numbers("reaches"), _BONES_OF_FINGERS, strict=True)]
_THUMB_BONES = _BONES_OF_FINGERS[0][2:]
# The palm, and what is measured along its axes.
_PLACED = np.array([*_numbers("palm"), *_numbers("reaches"), *_numbers("thumb")[1::2], *_THUMB_BONES])
_in_palms = itemgetter(*_numbers("to wrist", "to centre", "tips", "thumb"))
_in_observed_palms = itemgetter(*_numbers("seen reaches", "seen tips"))


def features(image_px: FloatArray, world_m: FloatArray) -> FloatArray:
    """All features of a hand: (21, 2) pixels and (21, 3) metres to (len(FEATURES),).

    Lists where only a few numbers are handled: numpy takes longer to get started than they take.
    """
    lines = _lines(image_px, world_m)
    lengths_of = np.sqrt(np.vecdot(lines, lines))
    lengths = lengths_of.tolist()
    palm, observed_palm = (max(*lengths[_OF[name]], 1e-9) for name in ("palm", "seen palm"))
    _, to_middle, _, to_thumb_side, *placed = lines.take(_PLACED, axis=0).tolist()
    along, across, off = (
        [x * a + y * b + z * c for x, y, z in placed] for a, b, c in _palm_axes(to_middle, to_thumb_side)
    )
    values: FloatArray = np.array(
        [
            *_angles(lines, lengths_of).tolist(),
            *[lengths[reach] / max(lengths[a] + lengths[b] + lengths[c], 1e-9) for reach, a, b, c in _OUTER_BONES],
            *[length / palm for length in _in_palms(lengths)],
            *[length / observed_palm for length in _in_observed_palms(lengths)],
            *[length / palm for length in (*along[:5], *across[:5], *map(abs, off[:5]), min(along[5:9]), across[5])],
            *_directions(zip(along[9:], across[9:], off[9:], strict=True)),
            *(tip_depths(image_px, OUTER_HULL, INNER_HULL) / -observed_palm).ravel().tolist(),
        ]
    )
    return values


def _lines(image_px: FloatArray, world_m: FloatArray) -> FloatArray:
    """Every line of `_BLOCKS`, (lines, 3); those on the image have no depth."""
    points = np.zeros((_PICTURE + 21, 3))
    points[:_CENTRE] = world_m
    points[_CENTRE] = np.add.reduce(world_m[_TRIANGLE]) / 3
    points[_PICTURE:, :2] = image_px
    ends, starts = points.take(_LINES, axis=0)
    lines: FloatArray = ends - starts
    return lines


def _angles(lines: FloatArray, lengths: FloatArray) -> FloatArray:
    """Degrees between all pairs of lines that meet; 0 where one has no length, as in `fingers.angles_deg`."""
    first, second = lines.take(_MEETING, axis=0)
    first_length, second_length = lengths.take(_MEETING)
    cosines = (np.vecdot(first, second) + _NO_LENGTH) / (first_length * second_length + _NO_LENGTH)
    between = np.degrees(np.arccos(np.minimum(np.maximum(cosines, -1.0), 1.0)))
    angles: FloatArray = _FROM_DEG + _TURN * between
    return angles


def _directions(bones: Iterable[_Vector]) -> Iterator[float]:
    """Of each bone its shares along, across and off the palm; off it without the sign, which a mirror turns."""
    for bone in bones:
        along, across, off = _unit(*bone)
        yield from (along, across, abs(off))


def _palm_axes(to_middle: _Vector, to_thumb_side: _Vector) -> tuple[_Vector, _Vector, _Vector]:
    """Unit vectors along the palm to the middle finger, across it to the thumb's side, off it."""
    x, y, z = to_thumb_side
    a, b, c = along = _unit(*to_middle)
    shared = x * a + y * b + z * c
    d, e, f = across = _unit(x - shared * a, y - shared * b, z - shared * c)
    return along, across, (b * f - c * e, c * d - a * f, a * e - b * d)


def _unit(x: float, y: float, z: float) -> _Vector:
    length = max(math.hypot(x, y, z), 1e-9)
    return x / length, y / length, z / length
