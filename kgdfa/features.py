"""The paper's measures made independent of view, scale, mirror and hand: what the `robust` rules look at.

Three families, as in Table 2: how far each finger is bent (angles), where each fingertip lies relative to the
palm (the hulls and their 3-D counterparts), how far tips are apart relative to the palm. Every one is an angle
or a ratio of lengths, so neither distance, rotation in the picture nor left or right changes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from itertools import combinations, pairwise

import numpy as np

from kgdfa.fingers import ANGLE_POINTS
from kgdfa.hand import FloatArray
from kgdfa.hulls import INNER_HULL, OUTER_HULL, TIPS, tip_depths


class Unit(Enum):
    """How a feature is told to people."""

    DEGREES = "°"
    PALMS = " palm lengths"
    SHARE = ""


class Group(Enum):
    """What a feature is about: one finger, tips together, or the view."""

    THUMB = "thumb"
    FORE = "fore"
    MIDDLE = "middle"
    RING = "ring"
    PINKY = "pinky"
    TIPS = "tips"


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """One number about a hand."""

    text: str
    group: Group
    unit: Unit


_PAIRS = tuple(combinations(range(5), 2))
_THUMB_TARGETS = (5, 6, 9, 10, 13, 14, 17, 18)
_GROUPS = tuple(Group)[:5]
_CENTRE = 21  # of the palm's triangle 0, 5, 17: appended to the 21 keypoints


def _per_finger(text: str, unit: Unit) -> list[Feature]:
    return [Feature(text=f"{group.value} {text}", group=group, unit=unit) for group in _GROUPS]


def _between(text: str, pairs: tuple[tuple[int, int], ...], unit: Unit) -> list[Feature]:
    names = [f"{_GROUPS[a].value} and {_GROUPS[b].value} {text}" for a, b in pairs]
    return [Feature(text=name, group=Group.TIPS, unit=unit) for name in names]


_NEIGHBOURS = tuple((finger, finger + 1) for finger in range(4))
FEATURES: tuple[Feature, ...] = (
    *_per_finger("root joint", Unit.DEGREES),
    *_per_finger("middle joint", Unit.DEGREES),
    *_per_finger("end joint", Unit.DEGREES),
    *_per_finger("angle", Unit.DEGREES),
    *_per_finger("straightness", Unit.SHARE),
    *_per_finger("tip to wrist", Unit.PALMS),
    *_per_finger("tip to palm", Unit.PALMS),
    *_per_finger("reach along the palm", Unit.PALMS),
    *_per_finger("reach across the palm", Unit.PALMS),
    *_per_finger("reach off the palm", Unit.PALMS),
    *_per_finger("angle in the picture", Unit.DEGREES),
    *_per_finger("tip beyond the outer hull", Unit.PALMS),
    *_per_finger("tip beyond the inner hull", Unit.PALMS),
    *_per_finger("length in the picture", Unit.PALMS),
    *_between("tips apart", _PAIRS, Unit.PALMS),
    *_between("tips apart in the picture", _PAIRS, Unit.PALMS),
    *_between("splayed", _NEIGHBOURS, Unit.DEGREES),
    *_between("splayed in the picture", _NEIGHBOURS, Unit.DEGREES),
    *(
        Feature(text=f"thumb tip to {_GROUPS[(joint - 1) // 4].value} {where}", group=Group.THUMB, unit=Unit.PALMS)
        for joint, where in zip(_THUMB_TARGETS, ("knuckle", "joint") * 4, strict=True)
    ),
    Feature(text="thumb tip beyond the fingers' joints", group=Group.THUMB, unit=Unit.PALMS),
    Feature(text="thumb tip aside of the forefinger's joint", group=Group.THUMB, unit=Unit.PALMS),
)


_CHAIN = tuple((0, *range(4 * finger + 1, 4 * finger + 5)) for finger in range(5))
_ARMS = tuple((end, vertex) for vertex, first, second in ANGLE_POINTS.values() for end in (first, second))
_REACHES = tuple((tip, chain[1]) for tip, chain in zip(TIPS, _CHAIN, strict=True))
_TIP_PAIRS = tuple((TIPS[a], TIPS[b]) for a, b in _PAIRS)
_PALM = ((5, 0), (9, 0), (17, 0), (5, 17))


class _Segments:
    """Lines between keypoints, named in blocks, so that all their lengths and angles come from one subtraction."""

    def __init__(self, **blocks: tuple[tuple[int, int], ...]) -> None:
        pairs = [pair for block in blocks.values() for pair in block]
        self._ends = np.array([end for end, _ in pairs])
        self._starts = np.array([start for _, start in pairs])
        stops = np.cumsum([len(block) for block in blocks.values()]).tolist()
        self.of = {name: slice(stop - len(blocks[name]), stop) for name, stop in zip(blocks, stops, strict=True)}

    def vectors(self, points: FloatArray) -> FloatArray:
        """(n, d) points to (segments, d)."""
        lines: FloatArray = points[self._ends] - points[self._starts]
        return lines

    def numbers(self, name: str) -> list[int]:
        """Where a block's segments stand."""
        return list(range(self.of[name].start, self.of[name].stop))


_SPACE = _Segments(
    bones=tuple((chain[k + 1], chain[k]) for chain in _CHAIN for k in range(4)),
    arms=_ARMS,
    reaches=_REACHES,
    to_wrist=tuple((tip, 0) for tip in TIPS),
    to_palm=tuple((tip, _CENTRE) for tip in TIPS),
    tips=_TIP_PAIRS,
    thumb=tuple((4, target) for target in _THUMB_TARGETS),
    palm=_PALM,
)
_FLAT = _Segments(arms=_ARMS, reaches=_REACHES, tips=_TIP_PAIRS, palm=_PALM)


def _angle_pairs(segments: _Segments, *, joints: bool) -> tuple[list[int], list[int]]:
    """Which segments meet in an angle: joints (root, middle, end of every finger), the paper's, splay."""
    arms, reaches = segments.numbers("arms"), segments.numbers("reaches")
    pairs = [*zip(arms[0::2], arms[1::2], strict=True), *pairwise(reaches)]
    if joints:
        bones = np.array(segments.numbers("bones")).reshape(5, 4)
        pairs = [(int(finger[k]), int(finger[k + 1])) for k in range(3) for finger in bones] + pairs
    return [first for first, _ in pairs], [second for _, second in pairs]


_SPACE_ANGLES = _angle_pairs(_SPACE, joints=True)
_FLAT_ANGLES = _angle_pairs(_FLAT, joints=False)


def features(image_px: FloatArray, world_m: FloatArray) -> FloatArray:
    """Everything the rules look at: (21, 2) pixels and (21, 3) metres to (len(FEATURES),)."""
    fingers, tips, splay, thumb = _in_space(world_m)
    flat_fingers, flat_tips, flat_splay = _in_picture(image_px)
    values: FloatArray = np.concatenate([*fingers, *flat_fingers, tips, flat_tips, splay, flat_splay, thumb])
    return values


def _in_space(world: FloatArray) -> tuple[list[FloatArray], FloatArray, FloatArray, FloatArray]:
    """From the 3-D landmarks: measures of each finger (10 of (5,)), tips apart (10,), splay (4,), thumb (10,)."""
    points = np.empty((22, 3))
    points[:21] = world
    points[_CENTRE] = (world[0] + world[5] + world[17]) / 3
    lines = _SPACE.vectors(points)
    lengths = np.sqrt((lines * lines).sum(axis=1))
    of = _SPACE.of
    palm = _palm_length(lengths[of["palm"]])
    angles = _angles(lines, lengths, _SPACE_ANGLES)
    joints = 180.0 - angles[:15]  # bones point outwards: straight on is 0° between them
    reaches, finger_lengths = lines[of["reaches"]], lengths[of["bones"]].reshape(5, 4)[:, 1:].sum(axis=1)
    axes = _palm_axes(lines[of["palm"]])
    along_across_off = reaches @ axes / palm
    from_joints = lines[of["thumb"]][1::2] @ axes / palm
    along_across_off[:, 2] = np.abs(along_across_off[:, 2])
    straight = lengths[of["reaches"]] / np.maximum(finger_lengths, 1e-9)
    scaled = lengths / palm
    fingers = [
        joints,
        angles[15:20],
        straight,
        scaled[of["to_wrist"]],
        scaled[of["to_palm"]],
        along_across_off.T.ravel(),
    ]
    thumb = np.concatenate([scaled[of["thumb"]], [from_joints[:, 0].min(), from_joints[0, 1]]])
    return fingers, scaled[of["tips"]], angles[20:], thumb


def _in_picture(points: FloatArray) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """The paper's own measures, on the picture: of each finger (4 of (5,)), tips apart (10,), splay (4,)."""
    lines = _FLAT.vectors(points)
    lengths = np.sqrt((lines * lines).sum(axis=1))
    of = _FLAT.of
    palm = _palm_length(lengths[of["palm"]])
    angles = _angles(lines, lengths, _FLAT_ANGLES)
    outer, inner = tip_depths(points, OUTER_HULL), tip_depths(points, INNER_HULL)
    fingers = [angles[:5], -outer / palm, -inner / palm, lengths[of["reaches"]] / palm]
    return fingers, lengths[of["tips"]] / palm, angles[5:]


def _angles(lines: FloatArray, lengths: FloatArray, pairs: tuple[list[int], list[int]]) -> FloatArray:
    """Degrees between pairs of segments; 0 where one has no length, as in `fingers.angles_deg`."""
    first, second = pairs
    dots = (lines[first] * lines[second]).sum(axis=1)
    product = lengths[first] * lengths[second]
    cosines = np.divide(dots, product, out=np.ones_like(dots), where=product > 0)
    angles: FloatArray = np.degrees(np.arccos(np.minimum(np.maximum(cosines, -1.0), 1.0)))
    return angles


def _palm_length(palm: FloatArray) -> float:
    """The palm's size from its four segments: the longest way over it, which a tilt shortens least."""
    return max(float(palm.max()), 1e-9)


def _palm_axes(palm: FloatArray) -> FloatArray:
    """(3, 3) columns: along the palm to the middle finger, across it to the thumb's side, off it."""
    along = _unit(palm[1].tolist())
    across = palm[3].tolist()
    shared = sum(a * b for a, b in zip(across, along, strict=True))
    across = _unit([a - shared * b for a, b in zip(across, along, strict=True)])
    (a, b, c), (d, e, f) = along, across
    off = [b * f - c * e, c * d - a * f, a * e - b * d]
    return np.array([along, across, off]).T


def _unit(vector: list[float]) -> list[float]:
    length = max(math.hypot(*vector), 1e-9)
    return [part / length for part in vector]
