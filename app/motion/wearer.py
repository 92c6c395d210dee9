"""The wearer as a figure needs it: body, poses, what stands around; and the figure's footing from moment to moment.

Nothing heavy is imported before `load_wearer`: the console's first paint waits for this file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from app.ipc.messages import Quad
from app.ipc.states import Action, GaitState
from app.motion.stance import LEFT, RIGHT, Pose, Stance, pose_of
from app.system.config import JointsConfig, load_device
from hal.joints.device import JointDevice
from hal.joints.scene import LEVEL_FLOOR, Scene
from profiles.schema import Profile

if TYPE_CHECKING:
    from hal.joints.body import Body

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
