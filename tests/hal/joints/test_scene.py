"""Where the next scene is laid, and that nothing is moved under a wearer who is in the midst of something."""

from __future__ import annotations

import pytest

from hal.joints.scene import LEVEL_FLOOR, Block, BlockKind, Scene, Surroundings, next_surroundings

FEET = (2.0, 2.0)


def block(kind: BlockKind, from_x: float, to_x: float, top: float = 0.2) -> Block:
    return Block(kind=kind, from_x_m=from_x, to_x_m=to_x, top_m=top)


def amid(*blocks: Block, floor: float = 0.0) -> Surroundings:
    return Surroundings(floor_m=floor, blocks=blocks)


STAIR = Scene(floor_m=-0.1, blocks=(block(BlockKind.STEP, -5.0, 0.1, 0.0),))


def test_a_scene_is_laid_from_the_feet_and_from_what_they_stand_on() -> None:
    laid = next_surroundings(amid(floor=0.3), STAIR, (1.9, 2.1), 2.0)
    assert laid.floor_m == pytest.approx(0.2)
    assert laid.blocks == (block(BlockKind.STEP, -3.0, 2.1, 0.3),)


def test_who_stands_on_a_step_with_both_feet_has_its_top_for_a_floor() -> None:
    now = amid(block(BlockKind.STEP, 1.5, 6.0))
    assert next_surroundings(now, LEVEL_FLOOR, FEET, 2.0) == Surroundings(floor_m=0.2)


@pytest.mark.parametrize(
    ("there", "ankles", "hip"),
    [
        (block(BlockKind.STEP, 1.9, 6.0), (1.8, 2.1), 2.0),  # the right foot up
        (block(BlockKind.STEP, -3.0, 1.9), (1.8, 2.1), 2.0),  # the right foot down
        (block(BlockKind.OBSTACLE, 1.9, 2.0), (1.8, 2.1), 2.0),  # between the feet
        (block(BlockKind.OBSTACLE, 1.9, 2.2), (1.8, 2.1), 2.0),  # under a foot
        (block(BlockKind.OBSTACLE, 1.9, 2.2), (2.0, 2.1), 2.0),  # under both
        (block(BlockKind.CHAIR, 1.4, 1.85), (2.0, 2.0), 1.6),  # under the hip
    ],
)
def test_in_the_midst_of_something_everything_stays(there: Block, ankles: tuple[float, float], hip: float) -> None:
    assert next_surroundings(amid(there, floor=-0.1), STAIR, ankles, hip) == amid(there, floor=-0.1)
    mirrored = (ankles[1], ankles[0])
    assert next_surroundings(amid(there, floor=-0.1), STAIR, mirrored, hip) == amid(there, floor=-0.1)


@pytest.mark.parametrize(
    ("there", "hip"),
    [
        (block(BlockKind.STEP, 2.1, 6.0), 2.0),  # before the feet
        (block(BlockKind.STEP, -3.0, 1.9), 2.0),  # behind them
        (block(BlockKind.OBSTACLE, 2.1, 2.2), 2.0),
        (block(BlockKind.CHAIR, 1.4, 1.85), 1.9),
    ],
)
def test_what_is_only_near_goes(there: Block, hip: float) -> None:
    assert next_surroundings(amid(there), LEVEL_FLOOR, FEET, hip) == Surroundings()
