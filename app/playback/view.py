"""What a frame of a film shows, values only, and the wearer's pose at moments of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from app.ipc.messages import TriggerReport
from app.ipc.snapshot import ControlSnapshot, Quad, coming
from app.ipc.states import Action, GaitState
from app.motion.wearer import Footing, Pose, Wearer
from app.playback.moment import Moment, snapshot_at
from app.playback.session import Playback, moment_ns
from app.recording.index import JointSamples
from hal.joints.body import Body
from hal.joints.scene import Scene
from logs.records import Command, Record

WINDOW_S = 6.0  # of the traces
STEP_NS = 50_000_000  # between two poses while the footing is found again
FARTHEST_NS = 10_000_000_000  # before a jump's target; a walk may have begun earlier
GOES_ON_NS = 1_000_000_000  # a next moment within so long follows from the one before


def clock(seconds: float, digits: int = 2) -> str:
    """Minutes and seconds."""
    minutes, rest = divmod(round(seconds, digits), 60)  # rounded first: 59.6 s are a minute
    return f"{int(minutes)}:{rest:0{3 + digits if digits else 2}.{digits}f}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """The wearer's figure."""

    body: Body
    pose: Pose
    scene: Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """What holds for the whole film: the session, its patient, its begin and end, its landmarks."""

    session: str
    patient: str
    begin_ns: int
    end_ns: int
    clock_offset_ns: int  # wall minus monotonic
    marks: tuple[tuple[float, str], ...]  # seconds from the beginning, weight
    speed: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What one frame shows; the windows are WINDOW_S long and end at the moment."""

    moment: Moment
    legs: Figure | None
    measured: JointSamples
    commanded: JointSamples
    reports: tuple[TriggerReport, ...]
    pushes: tuple[tuple[int, Record], ...]  # presses, releases and what gave nothing, each with its moment
    landmarks: tuple[tuple[int, Record], ...]  # the newest last


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
        return self._take(moment.snapshot, coming(moment.snapshot, moment.report))

    def _find_footing(self, moment: Moment) -> None:
        self.footing = Footing()
        snapshot = moment.snapshot
        if snapshot is None or (snapshot.action is None and snapshot.state is not GaitState.BETWEEN):
            return
        began = self._playback.commands.newest(moment.at_ns)
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
