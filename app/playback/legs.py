"""The wearer's pose at moments of a recording, from frame to frame or after a jump."""

from __future__ import annotations

from math import isfinite

from app.ipc.messages import ControlSnapshot, Quad
from app.ipc.states import ACTION_OF, Action, GaitState
from app.motion.wearer import Footing, Pose, Wearer
from app.playback.moment import Moment, snapshot_at
from app.playback.session import Playback, moment_ns
from logs.records import Command

STEP_NS = 50_000_000  # between two poses while the footing is found again
FARTHEST_NS = 10_000_000_000  # before a jump's target; a walk may have begun earlier
GOES_ON_NS = 1_000_000_000  # a next moment within so long follows from the one before


class Legs:
    """Follows the foot that carries; a jump goes back to where the running action began."""

    def __init__(self, playback: Playback, wearer: Wearer) -> None:
        self._playback = playback
        self.wearer = wearer
        self.footing = Footing()
        self._newest_ns: int | None = None

    def at(self, moment: Moment) -> Pose | None:
        """The pose now; None: no drive has ever answered."""
        if self._newest_ns is None or not 0 <= moment.at_ns - self._newest_ns <= GOES_ON_NS:
            self._find_footing(moment)
        self._newest_ns = moment.at_ns
        return self._take(moment.snapshot, coming(moment))

    def _find_footing(self, moment: Moment) -> None:
        self.footing = Footing()
        snapshot = moment.snapshot
        if snapshot is None or (snapshot.action is None and snapshot.state is not GaitState.BETWEEN):
            return
        began = self._playback.newest_command(moment.at_ns)
        begin_ns = max(moment_ns(began) if began is not None else 0, moment.at_ns - FARTHEST_NS)
        before = snapshot_at(self._playback, begin_ns)
        if before is not None and began is not None and isinstance(began.body, Command):
            action = next((one for one in Action if one.value == began.body.action), None)
            self.footing.see(self.wearer, before.state, None, action)
        for at_ns in range(begin_ns, moment.at_ns, STEP_NS):
            self._take(snapshot_at(self._playback, at_ns), None)

    def _take(self, snapshot: ControlSnapshot | None, wanted: Action | None) -> Pose | None:
        if snapshot is None:
            return None
        first, second, third, fourth = (joint.angle_rad for joint in snapshot.joints)
        angles_rad: Quad = (first, second, third, fourth)
        if not all(map(isfinite, angles_rad)):
            return None
        self.footing.see(self.wearer, snapshot.state, snapshot.action, snapshot.action or wanted)
        return self.footing.move(self.wearer, angles_rad)


def coming(moment: Moment) -> Action | None:
    """What runs, or what a push would begin now."""
    snapshot, report = moment.snapshot, moment.report
    if snapshot is None or snapshot.action is not None:
        return snapshot.action if snapshot is not None else None
    action = ACTION_OF.get(report.gesture) if report is not None and report.gesture else None
    return action if action in snapshot.allowed else None
