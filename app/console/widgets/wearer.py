"""The panels that follow the legs: the figure, and at large sizes each joint's curve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from app.console.state import SessionState
from app.console.widgets.curves import Curves, draw_joints, joint_fault
from app.console.widgets.figure import LEFT, RIGHT, Pose, Stance, View, draw, pose_of
from app.console.widgets.gait import LEADS_TO
from app.console.widgets.panel import DrawnPanel, Lines, plain
from app.ipc.messages import ControlSnapshot, Quad
from app.ipc.states import ACTION_OF, Action, GaitState
from app.system.config import SessionSetup, load_device
from app.text.catalogue import tr
from hal.joints.device import JointDevice
from hal.joints.scene import LEVEL_FLOOR, Scene

if TYPE_CHECKING:
    from hal.joints.body import Body

ROUND = 2  # digits of an angle in radians: smaller changes move no dot
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


def load_wearer(setup: SessionSetup) -> Wearer:
    """Takes some tenths of a second, most of it for loading numpy. Raises AppError or HardwareError."""
    from app.motion.plan import Phase, patient_of, quad
    from app.motion.trajectory import nominal_pose, path_of, scene_of
    from app.system.errors import AppError
    from hal.joints.body import trunk_lean_of

    device = load_device(setup.config.joints)
    patient = patient_of(setup.profile, device)
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


def coming(state: SessionState) -> Action | None:
    """What runs, or what a push would start now."""
    snapshot, report = state.snapshot, state.report
    if snapshot is None:
        return None
    if snapshot.action is not None:
        return snapshot.action
    action = ACTION_OF.get(report.gesture) if report is not None and report.gesture and state.report_fresh else None
    return action if action in snapshot.allowed else None


def goal_of(wearer: Wearer, action: Action | None, snapshot: ControlSnapshot) -> Quad | None:
    """The joints where this action leads next."""
    if action is None:
        return None
    if action in wearer.mid_crossing:
        first = snapshot.action is not action or snapshot.progress < MID_CROSSING
        return wearer.mid_crossing[action] if first else wearer.poses.get(GaitState.STANDING)
    goal = LEADS_TO[action]
    if action is Action.WALK and snapshot.state is GaitState.LEFT_FORWARD:
        goal = GaitState.RIGHT_FORWARD
    return wearer.poses.get(goal)


def _waiting() -> Lines:
    return (plain(tr("joints.waiting"), "$foreground-muted"),)


class _WearerPanel(DrawnPanel):
    """Draws nothing before the screen has brought the wearer."""

    wearer: Wearer | None = None

    def show(self, state: SessionState) -> None:
        """Draw the newest snapshot."""
        if state.snapshot is None or self.wearer is None:
            self.lines = _waiting()
        elif self.content_size.area:
            self.follow(state, state.snapshot, self.wearer)

    def follow(self, state: SessionState, snapshot: ControlSnapshot, wearer: Wearer) -> None:
        """Draw this snapshot."""


class FigurePanel(_WearerPanel):
    """The wearer, drawn again when a joint has visibly moved."""

    DRAWN_HZ = 15.0
    _stance = Stance()
    _scene = LEVEL_FLOOR
    _drawn: object = None
    _laid_for: Action | None = None

    def follow(self, state: SessionState, snapshot: ControlSnapshot, wearer: Wearer) -> None:
        """Draw this snapshot."""
        if not all(isfinite(joint.angle_rad) for joint in snapshot.joints):  # drives that have never answered
            self.lines, self._drawn = _waiting(), None
            return
        action = coming(state)
        if snapshot.action is None and snapshot.state is not GaitState.BETWEEN:  # stopped half way: all stays
            self._stance = Stance(side=LEFT if action in RIGHT_SWINGS else RIGHT)
            self._scene = _around(wearer, action, snapshot)
        elif snapshot.action is not None and snapshot.action not in {self._laid_for, Action.INITIALISE}:
            self._scene = wearer.scenes[snapshot.action]
        self._laid_for = snapshot.action
        goal = goal_of(wearer, action, snapshot)
        alarm = tuple(bool(joint_fault(joint)) for joint in snapshot.joints)
        if not self.due(state.now_ns, (goal, alarm, self._scene)):
            return
        first, second, third, fourth = (round(joint.angle_rad, ROUND) for joint in snapshot.joints)
        angles: Quad = (first, second, third, fourth)
        torque = tuple(
            round(abs(joint.torque_nm) / device.max_torque_nm, 1)
            for joint, device in zip(snapshot.joints, wearer.joints, strict=True)
        )
        drawn = (goal, alarm, self._scene, self.content_size, angles, torque)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        pose, self._stance = self._pose(wearer, angles)
        view = View(
            body=wearer.body,
            pose=pose,
            ghost=self._pose(wearer, goal)[0] if goal is not None else None,
            scene=self._scene,
            torque=torque,
            alarm=alarm,
            sides=(tr("figure.left"), tr("figure.right")),
        )
        self.lines = draw(view, *self.content_size)

    def _pose(self, wearer: Wearer, angles_rad: Quad) -> tuple[Pose, Stance]:
        lean_rad = wearer.lean_rad(angles_rad[1], angles_rad[3])
        return pose_of(wearer.body, angles_rad, lean_rad, self._stance, self._scene)


def _around(wearer: Wearer, action: Action | None, snapshot: ControlSnapshot) -> Scene:
    if snapshot.state is GaitState.SITTING:
        return wearer.scenes[Action.STAND_UP]
    return LEVEL_FLOOR if action is None else wearer.scenes[action]


class JointsPanel(_WearerPanel):
    """Each joint's curve of the last step, and its figures."""

    DRAWN_HZ = 4.0  # figures that change faster are not read

    def __init__(self, id: str | None = None, title: str = "") -> None:  # noqa: A002 - Textual's own name
        super().__init__(id, title)
        self._curves = Curves()

    def follow(self, state: SessionState, snapshot: ControlSnapshot, wearer: Wearer) -> None:
        """Draw this snapshot."""
        self._curves.take(snapshot)
        if self.due(state.now_ns, tuple(map(joint_fault, snapshot.joints))):
            self.lines = draw_joints(snapshot, self._curves, wearer.joints, *self.content_size)
