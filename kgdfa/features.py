"""The paper's measures made independent of view, scale, mirror and hand: what the `robust` rules look at.

Three families, as in Table 2: how far each finger is bent (angles), where each fingertip lies relative to the
palm (the hulls and their 3-D counterparts), how far tips are apart relative to the palm. Every one is an angle
or a ratio of lengths, so neither distance, rotation in the picture nor left or right changes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import combinations

import numpy as np

from kgdfa.fingers import ANGLE_POINTS, angles_deg
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


_CHAINS = np.arange(1, 21).reshape(5, 4)  # thumb to pinky: four joints each, root to tip
_ROOTS, _TIPS = _CHAINS[:, 0], np.array(TIPS)
_PAIRS = tuple(combinations(range(5), 2))
_FIRST, _SECOND = (np.array(column) for column in zip(*_PAIRS, strict=True))
_ADJACENT = np.arange(4)
_THUMB_TARGETS = np.array([5, 6, 9, 10, 13, 14, 17, 18])
_VERTEX, _END_A, _END_B = (np.array(column) for column in zip(*ANGLE_POINTS.values(), strict=True))
_GROUPS = tuple(Group)[:5]


def _per_finger(text: str, unit: Unit) -> list[Feature]:
    return [Feature(text=f"{group.value} {text}", group=group, unit=unit) for group in _GROUPS]


def _between(text: str, pairs: tuple[tuple[int, int], ...], unit: Unit) -> list[Feature]:
    names = [f"{_GROUPS[a].value} and {_GROUPS[b].value} {text}" for a, b in pairs]
    return [Feature(text=name, group=Group.TIPS, unit=unit) for name in names]


_NEIGHBOURS = tuple((int(finger), int(finger) + 1) for finger in _ADJACENT)
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
)


def features(image_px: FloatArray, world_m: FloatArray) -> FloatArray:
    """Everything the rules look at: (21, 2) pixels and (21, 3) metres to (len(FEATURES),)."""
    values: FloatArray = np.concatenate([_in_space(world_m), _in_picture(image_px), _together(image_px, world_m)])
    return values


def _in_space(world: FloatArray) -> FloatArray:
    """Joint angles and reaches of each finger from the 3-D landmarks, (50,)."""
    palm = _palm_length(world)
    chains = np.concatenate([np.broadcast_to(world[0], (5, 1, 3)), world[_CHAINS]], axis=1)
    bones = np.diff(chains, axis=1)
    joints = angles_deg(-bones[:, :3], bones[:, 1:]).T.ravel()
    paper = angles_deg(world[_END_A] - world[_VERTEX], world[_END_B] - world[_VERTEX])
    lengths = np.linalg.norm(bones[:, 1:], axis=2).sum(axis=1)
    reach = world[_TIPS] - world[_ROOTS]
    straight = np.linalg.norm(reach, axis=1) / np.maximum(lengths, 1e-9)
    centre = (world[0] + world[5] + world[17]) / 3
    to_wrist = np.linalg.norm(world[_TIPS] - world[0], axis=1) / palm
    to_palm = np.linalg.norm(world[_TIPS] - centre, axis=1) / palm
    along, across, off = (reach @ _palm_axes(world).T / palm).T
    return np.concatenate([joints, paper, straight, to_wrist, to_palm, along, across, np.abs(off)])


def _in_picture(points: FloatArray) -> FloatArray:
    """The paper's own measures, on the picture, (20,)."""
    palm = _palm_length(points)
    paper = angles_deg(points[_END_A] - points[_VERTEX], points[_END_B] - points[_VERTEX])
    outer, inner = tip_depths(points, OUTER_HULL), tip_depths(points, INNER_HULL)
    length = np.linalg.norm(points[_TIPS] - points[_ROOTS], axis=1)
    return np.concatenate([paper, -outer / palm, -inner / palm, length / palm])


def _together(points: FloatArray, world: FloatArray) -> FloatArray:
    """Tips relative to one another, and the thumb's relative to the other fingers' joints, (36,)."""
    palm, flat_palm = _palm_length(world), _palm_length(points)
    tips, flat_tips = world[_TIPS], points[_TIPS]
    reach, flat_reach = tips - world[_ROOTS], flat_tips - points[_ROOTS]
    return np.concatenate(
        [
            np.linalg.norm(tips[_FIRST] - tips[_SECOND], axis=1) / palm,
            np.linalg.norm(flat_tips[_FIRST] - flat_tips[_SECOND], axis=1) / flat_palm,
            angles_deg(reach[_ADJACENT], reach[_ADJACENT + 1]),
            angles_deg(flat_reach[_ADJACENT], flat_reach[_ADJACENT + 1]),
            np.linalg.norm(world[_THUMB_TARGETS] - tips[0], axis=1) / palm,
        ]
    )


def _palm_length(points: FloatArray) -> float:
    """The palm's size, in the points' unit: the longest way over it, which a tilt shortens least."""
    ends = points[[5, 9, 17, 5]] - points[[0, 0, 0, 17]]
    return max(float(np.sqrt((ends * ends).sum(axis=1).max())), 1e-9)


def _palm_axes(world: FloatArray) -> FloatArray:
    """(3, 3) rows: along the palm to the middle finger, across it to the thumb's side, off it."""
    along = world[9] - world[0]
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    across = world[5] - world[17]
    across = across - (across @ along) * along
    across = across / max(float(np.linalg.norm(across)), 1e-9)
    return np.stack([along, across, np.cross(along, across)])
