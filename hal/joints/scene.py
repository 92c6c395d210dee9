"""What stands around the wearer for the coming action: blocks on the floor, in side view."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class BlockKind(Enum):
    """What a block is for."""

    STEP = "step"  # to stand on
    OBSTACLE = "obstacle"
    CHAIR = "chair"  # to sit on; feet and shanks pass under it


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A box from the floor up; places from the ankles' midpoint and from the floor under the feet, metres."""

    kind: BlockKind
    from_x_m: float
    to_x_m: float
    top_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """The floor's height under everything (0: as under the feet), and what stands on it."""

    floor_m: float = 0.0
    blocks: tuple[Block, ...] = ()


LEVEL_FLOOR = Scene()
