"""The wearer as a figure needs it: body, poses, what stands around; and where the figure stands from moment to moment.

The foot that carries stays where it stood, and the hip follows from it: nothing here knows where the wearer is. Metres,
x forward, z up from the floor under the feet where the action began.

Nothing heavy is imported before `load_wearer`: the console's first paint waits for this file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, isfinite, radians, sin
from typing import TYPE_CHECKING

from app.ipc.snapshot import Quad
from app.ipc.states import Action, GaitState
from app.system.config import JointsConfig, load_device
from hal.joints.device import Joint, JointDevice
from hal.joints.scene import LEVEL_FLOOR, Block, BlockKind, Scene
from profiles.schema import Profile

if TYPE_CHECKING:
    from hal.joints.body import Body

Point = tuple[float, float]
LEFT, RIGHT = 0, 1
HIPS = (Joint.LEFT_HIP, Joint.RIGHT_HIP)

CARRIES_M = 0.012  # a sole that is no higher than this over the other one carries too
SWITCH_M = 0.004
FOOT_PITCH_RAD = (radians(-50), radians(25))

CROSSINGS = (Action.STAIR_UP, Action.STAIR_DOWN, Action.OBSTACLE)
RIGHT_SWINGS = (Action.STEP_RIGHT_FIRST, Action.STEP_RIGHT, *CROSSINGS)  # first; the left foot stays
MID_CROSSING = 0.5  # of a crossing: from here on its goal is standing


@dataclass(frozen=True, slots=True, kw_only=True)
class Wearer:
    """What the figure needs to know of patient and device, solved once."""

    body: Body
    poses: dict[GaitState, Quad]  # where the joints are in a state
    mid_crossing: dict[Action, Quad]  # both feet on different levels
    scenes: dict[Action, Scene]
    joints: tuple[JointDevice, ...]
    lean_rad: Callable[[float, float], float]  # the trunk's, from both knees


def load_wearer(profile: Profile, joints: JointsConfig) -> Wearer:
    """Takes some tenths of a second, most of it for loading numpy. Raises AppError or HardwareError."""
    from app.motion.plan import Phase, patient_of, quad
    from app.motion.trajectory import nominal_pose, path_of, scene_of
    from app.system.errors import AppError
    from hal.joints.body import trunk_lean_of

    device = load_device(joints)
    patient = patient_of(profile, device)
    mid_crossing: dict[Action, Quad] = {}
    for action in CROSSINGS:
        try:
            joints_rad = path_of(action, Phase.WHOLE, patient).joints_rad
        except AppError:  # it can't be made, and so never runs
            continue
        mid_crossing[action] = quad(joints_rad[round(MID_CROSSING * (len(joints_rad) - 1))])
    poses = {state: quad(nominal_pose(state, patient)) for state in GaitState}
    return Wearer(
        body=patient.body,
        poses={state: pose for state, pose in poses.items() if all(map(isfinite, pose))},
        mid_crossing=mid_crossing,
        scenes={action: scene_of(action, patient) for action in Action},
        joints=device.joints,
        lean_rad=trunk_lean_of,
    )


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


class Footing:
    """Which foot stands where, and what stands around, through moments in the order of time."""

    def __init__(self) -> None:
        self.scene = LEVEL_FLOOR
        self._stance = Stance()
        self._laid_for: Action | None = None

    def see(self, wearer: Wearer, state: GaitState, running: Action | None, coming: Action | None) -> None:
        """A moment's state; coming: what runs, or would begin now."""
        if running is None and state is not GaitState.BETWEEN:  # stopped half way: all stays
            self._stance = Stance(side=LEFT if coming in RIGHT_SWINGS else RIGHT)
            self.scene = _around(wearer, coming, state)
        elif running is not None and running not in {self._laid_for, Action.INITIALISE}:
            self.scene = wearer.scenes[running]
        self._laid_for = running

    def move(self, wearer: Wearer, angles_rad: Quad) -> Pose:
        """The pose with these joints; the next one stands where this one does."""
        pose, self._stance = self._posed(wearer, angles_rad)
        return pose

    def pose(self, wearer: Wearer, angles_rad: Quad) -> Pose:
        """How it would stand with these joints."""
        return self._posed(wearer, angles_rad)[0]

    def _posed(self, wearer: Wearer, angles_rad: Quad) -> tuple[Pose, Stance]:
        lean_rad = wearer.lean_rad(angles_rad[1], angles_rad[3])
        return pose_of(wearer.body, angles_rad, lean_rad, self._stance, self.scene)


def _around(wearer: Wearer, action: Action | None, state: GaitState) -> Scene:
    if state is GaitState.SITTING:
        return wearer.scenes[Action.STAND_UP]
    return LEVEL_FLOOR if action is None else wearer.scenes[action]
