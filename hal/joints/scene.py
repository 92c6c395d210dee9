"""What stands around the wearer for the coming action: blocks on the floor, in side view."""

from __future__ import annotations

from dataclasses import dataclass, replace
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """The floor's height and what stands on it; places in the world, metres."""

    floor_m: float = 0.0
    blocks: tuple[Block, ...] = ()


def next_surroundings(now: Surroundings, scene: Scene, ankles_x_m: tuple[float, float], hip_x_m: float) -> Surroundings:
    """What is around the wearer as an action with this scene begins.

    Its scene is laid from where both feet stand. A wearer in the midst of something was interrupted there and finds
    it as it is: nothing is moved under a foot or away from under the hip.
    """
    if any(_amid(block, ankles_x_m, hip_x_m) for block in now.blocks):
        return now
    here = sum(ankles_x_m) / 2
    ground = max([now.floor_m, *(block.top_m for block in now.blocks if _carries(block, ankles_x_m))])
    blocks = (
        replace(block, from_x_m=here + block.from_x_m, to_x_m=here + block.to_x_m, top_m=ground + block.top_m)
        for block in scene.blocks
    )
    return Surroundings(floor_m=ground + scene.floor_m, blocks=tuple(blocks))


def _amid(block: Block, ankles_x_m: tuple[float, float], hip_x_m: float) -> bool:
    """Whether the wearer stands over an obstacle, with one foot on a step, or has a chair under the hip."""
    if block.kind is BlockKind.CHAIR:
        return block.from_x_m <= hip_x_m <= block.to_x_m
    reached = block.from_x_m <= max(ankles_x_m) and min(ankles_x_m) <= block.to_x_m
    return reached and not _carries(block, ankles_x_m)


def _carries(block: Block, ankles_x_m: tuple[float, float]) -> bool:
    """Whether both feet stand on it."""
    spans = block.from_x_m <= min(ankles_x_m) and max(ankles_x_m) <= block.to_x_m
    return block.kind is BlockKind.STEP and spans
