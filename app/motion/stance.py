"""Where the wearer stands in the world, from measured joints alone: the foot that carries stays where it stood.

Metres, x forward, z up from the floor under the feet where the action began. Nothing here knows where the wearer is:
the hip follows from the foot that carries. Pure, and without numpy: the console's first paint waits for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import TYPE_CHECKING

from hal.joints.device import Joint
from hal.joints.scene import Block, BlockKind, Scene

if TYPE_CHECKING:
    from app.ipc.messages import Quad
    from hal.joints.body import Body

Point = tuple[float, float]
LEFT, RIGHT = 0, 1
HIPS = (Joint.LEFT_HIP, Joint.RIGHT_HIP)

CARRIES_M = 0.012  # a sole that is no higher than this over the other one carries too
SWITCH_M = 0.004
FOOT_PITCH_RAD = (radians(-50), radians(25))


@dataclass(frozen=True, slots=True, kw_only=True)
class Stance:
    """Which foot carries, and where its ankle stands."""

    side: int = RIGHT
    x_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where everything is, in world coordinates."""

    hip: Point
    knees: tuple[Point, Point]
    ankles: tuple[Point, Point]
    pitch_rad: tuple[float, float]  # of each foot, toe up positive
    carries: tuple[bool, bool]
    lean_rad: float


def surface_m(scene: Scene, x_m: float) -> float:
    """The height of what a foot would stand on there."""
    tops = (block.top_m for block in scene.blocks if block.kind is not BlockKind.CHAIR and _spans(block, x_m))
    return max((scene.floor_m, *tops))


def _spans(block: Block, x_m: float) -> bool:
    return block.from_x_m <= x_m <= block.to_x_m


def pose_of(body: Body, angles_rad: Quad, lean_rad: float, stance: Stance, scene: Scene) -> tuple[Pose, Stance]:
    """The pose in the world, and the stance after it."""
    knees, ankles, shanks = [], [], []
    for hip_joint in HIPS:
        thigh = angles_rad[hip_joint] - lean_rad
        shank = thigh - angles_rad[hip_joint + 1]
        knee = (body.thigh_m * sin(thigh), -body.thigh_m * cos(thigh))
        knees.append(knee)
        ankles.append((knee[0] + body.shank_m * sin(shank), knee[1] - body.shank_m * cos(shank)))
        shanks.append(shank)
    hip_x = stance.x_m - ankles[stance.side][0]
    heights = [surface_m(scene, hip_x + ankle[0]) - ankle[1] for ankle in ankles]
    other = 1 - stance.side
    side = other if heights[other] > heights[stance.side] + SWITCH_M else stance.side
    hip = (hip_x, max(heights) + body.ankle_height_m)
    carries = (heights[LEFT] >= max(heights) - CARRIES_M, heights[RIGHT] >= max(heights) - CARRIES_M)

    def world(point: Point) -> Point:
        return (hip[0] + point[0], hip[1] + point[1])

    pitch = tuple(
        0.0 if carries[foot] else min(max(shanks[foot], FOOT_PITCH_RAD[0]), FOOT_PITCH_RAD[1]) for foot in (LEFT, RIGHT)
    )
    pose = Pose(
        hip=hip,
        knees=(world(knees[LEFT]), world(knees[RIGHT])),
        ankles=(world(ankles[LEFT]), world(ankles[RIGHT])),
        pitch_rad=(pitch[LEFT], pitch[RIGHT]),
        carries=carries,
        lean_rad=lean_rad,
    )
    return pose, Stance(side=side, x_m=pose.ankles[side][0])


def sole_point(ankle: Point, along_m: float, down_m: float, pitch_rad: float) -> Point:
    """A point of the sole, as app.motion.kinematics.sole has it."""
    sine, cosine = sin(pitch_rad), cos(pitch_rad)
    return (ankle[0] + along_m * cosine + down_m * sine, ankle[1] + along_m * sine - down_m * cosine)
