"""What a frame of a film shows: values only."""

from __future__ import annotations

from dataclasses import dataclass

from app.ipc.messages import TriggerReport
from app.motion.wearer import Pose
from app.playback.moment import Moment
from app.recording.index import JointSamples
from hal.joints.body import Body
from hal.joints.scene import Scene
from logs.records import Record

WINDOW_S = 6.0  # of the traces


def clock(seconds: float, digits: int = 2) -> str:
    """Minutes and seconds."""
    return f"{int(seconds // 60)}:{seconds % 60:0{3 + digits if digits else 2}.{digits}f}"


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
