"""The panels that follow the legs: the figure, and at large sizes each joint's curve."""

from __future__ import annotations

from math import isfinite

from app.console.state import SessionState
from app.console.widgets.curves import Curves, draw_joints, joint_fault
from app.console.widgets.figure import View, draw
from app.console.widgets.gait import LEADS_TO
from app.console.widgets.panel import DrawnPanel, Lines, plain
from app.ipc.snapshot import ControlSnapshot, Quad, coming
from app.ipc.states import Action, GaitState
from app.motion.wearer import MID_CROSSING, Footing, Wearer
from app.text.catalogue import tr

ROUND = 2  # digits of an angle in radians: smaller changes move no dot


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
    _drawn: object = None

    def __init__(self, id: str | None = None, title: str = "") -> None:  # noqa: A002 - Textual's own name
        super().__init__(id, title)
        self._footing = Footing()

    def follow(self, state: SessionState, snapshot: ControlSnapshot, wearer: Wearer) -> None:
        """Draw this snapshot."""
        if not all(isfinite(joint.angle_rad) for joint in snapshot.joints):  # drives that have never answered
            self.lines, self._drawn = _waiting(), None
            return
        action = coming(state.snapshot, state.report if state.report_fresh else None)
        self._footing.see(wearer, snapshot.state, snapshot.action, action)
        scene = self._footing.scene
        goal = goal_of(wearer, action, snapshot)
        alarm = tuple(bool(joint_fault(joint)) for joint in snapshot.joints)
        if not self.due(state.now_ns, (goal, alarm, scene)):
            return
        first, second, third, fourth = (round(joint.angle_rad, ROUND) for joint in snapshot.joints)
        angles: Quad = (first, second, third, fourth)
        torque = tuple(
            round(abs(joint.torque_nm) / device.max_torque_nm, 1)
            for joint, device in zip(snapshot.joints, wearer.joints, strict=True)
        )
        drawn = (goal, alarm, scene, self.content_size, angles, torque)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        view = View(
            body=wearer.body,
            pose=self._footing.move(wearer, angles),
            ghost=self._footing.pose(wearer, goal) if goal is not None else None,
            scene=scene,
            torque=torque,
            alarm=alarm,
        )
        self.lines = draw(view, *self.content_size)


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
