"""A session from the hand to the joint commands in simulated time, for what tests ask of its trail.

The whole perception but the detector (drawn hands stand for it) and the whole step of control, with the messages that
the console receives as the live values.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from app.control.inputs import Inputs
from app.control.loop import limits_record
from app.control.telemetry import LoopStatus, snapshot
from app.ipc.messages import OperatorKind, TriggerReport
from app.ipc.snapshot import ControlSnapshot, Lateness, RealTime
from app.ipc.states import Action, GaitState
from app.perception.frames import DecisionRecorder, button_record
from app.perception.reporting import with_report
from hal.minimum_jerk import minimum_jerk
from kgdfa.button_state import ButtonMode, ButtonPlace
from kgdfa.distance import DistanceChoice
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.pipeline import Pipeline, PipelineInput, Report
from kgdfa.published import PublishedRules
from kgdfa.robust_distance import RobustRange
from logs import records as r
from logs.disk import Disk
from logs.journal import Moment
from logs.keys import load_or_make_key
from logs.mirror import CheckpointCopy
from logs.read import records
from logs.records import Body, Entry, Record
from logs.writer import SessionWriter
from testing.messages import without_hand
from tests.app.control.rig import SETTINGS, Rig
from tests.app.perception.test_reporting import SCALE
from tests.kgdfa.hands import STATES, drawn_hand
from tests.support.audit_trails import START

FRAME_NS, FRAME_TICKS = 34_000_000, 17
BLACK = np.zeros((720, 1280, 3), np.uint8)
MIDDLE_PX = np.array([640.0, 360.0])
FOCAL_PX, REFERENCE_M, REFERENCE_PX = 650.0, 0.065, 151.3
PLACE = ButtonPlace.in_the_middle(1280, 720, 0.20)
REST_M, NEAR_M = 0.36, 0.165
PUSH_FRAMES = 10  # a third of a second there, and as long back
K, A = OperatorKind, Action
Live = tuple[Report, TriggerReport]


def hand_at(gesture: Gesture, distance_m: float, aside_px: float = 0.0) -> Hand:
    """A drawn hand with its points' middle over the button."""
    scale = FOCAL_PX * REFERENCE_M / REFERENCE_PX / distance_m
    box = drawn_hand(STATES[gesture], scale=scale).bounding_box
    middle_px = np.array([box.left_px + box.right_px, box.top_px + box.bottom_px]) / 2
    x_px, y_px = MIDDLE_PX - middle_px + (aside_px, 0.0)
    return drawn_hand(STATES[gesture], scale=scale, at_px=(float(x_px), float(y_px)))


@dataclass
class Shown:
    """The detector: whatever hand is shown."""

    hands: tuple[Hand, ...] = ()

    def detect(self, image_bgr: object, captured_ns: int) -> tuple[Hand, ...]:
        return self.hands


@dataclass
class Live12:
    """The session, and what the console was told in it."""

    rig: Rig = field(default_factory=lambda: Rig(watching=False))
    shown: Shown = field(default_factory=Shown)
    entries: list[tuple[str, int, Body]] = field(default_factory=list)
    reports: dict[int, Live] = field(default_factory=dict)  # by capture
    snapshots: list[ControlSnapshot] = field(default_factory=list)
    refusals: list[tuple[int, object]] = field(default_factory=list)

    def __post_init__(self) -> None:
        finder = RobustRange(focal_px=FOCAL_PX, reference_m=REFERENCE_M)
        self.pipeline = Pipeline(detector=self.shown, rules=PublishedRules(), range_finder=finder, place=PLACE)
        self.recorder = DecisionRecorder(SCALE)
        palm = r.Calibration(
            method=SCALE.anchor_method,
            anchor_m=SCALE.anchor_m,
            focal_px=SCALE.focal_px,
            focal_source=SCALE.focal_source,
        )
        for body in (palm, button_record(PLACE, ButtonMode.ROBUST, DistanceChoice.MONOCULAR)):
            self.entries.append(("perception", self.rig.now_ns, body))
        self.entries.append(("control", self.rig.now_ns, limits_record(SETTINGS)))

    def frame(self, *hands: Hand) -> Report:
        """One frame, and control's ticks until the next."""
        captured_ns = self.rig.now_ns
        self.shown.hands = hands
        report = self.pipeline.process(PipelineInput(image_bgr=BLACK, captured_ns=captured_ns))
        for body in self.recorder.take(report):
            self.entries.append(("perception", captured_ns, body))
        count = len(self.reports) + 1
        message = with_report(without_hand(captured_ns, count, PLACE.threshold_m), report)
        self.reports[captured_ns] = (report, message)
        self.rig.spoil["report"] = message
        self.ticks(FRAME_TICKS)
        return report

    def ticks(self, count: int) -> None:
        """Control goes on; what it publishes and records is kept."""
        for _ in range(count):
            before = len(self.rig.audit)
            state = self.rig.tick()
            self.entries += [("control", self.rig.now_ns, body) for body in self.rig.audit[before:]]
            if len(self.rig.audit) > before:
                now_ns = self.rig.now_ns
                inputs = Inputs(now_ns=now_ns, wall_ns=0, boot_ns=0, feedback=self.rig.joints.feedback(now_ns))
                status = LoopStatus(incarnation=1, sequence=1, lateness=Lateness(), real_time=RealTime())
                self.snapshots.append(snapshot(state, inputs, status))

    def key(self, kind: OperatorKind, action: Action | None = None) -> None:
        """A key, and a frame's time."""
        self.rig.send(kind, action)
        self.ticks(2)

    def sign(self, gesture: Gesture) -> None:
        """At rest until it is recognised."""
        for _ in range(8):
            self.frame(hand_at(gesture, REST_M))

    def approach(self, gesture: Gesture) -> None:
        for count in range(1, PUSH_FRAMES + 1):
            share = float(minimum_jerk(np.array(count / PUSH_FRAMES)))
            self.frame(hand_at(gesture, REST_M + (NEAR_M - REST_M) * share))

    def push(self, gesture: Gesture) -> None:
        """There and back."""
        self.sign(gesture)
        self.approach(gesture)
        for count in range(1, PUSH_FRAMES + 1):
            share = float(minimum_jerk(np.array(count / PUSH_FRAMES)))
            self.frame(hand_at(gesture, NEAR_M + (REST_M - NEAR_M) * share))

    def rest(self, frames: int = 8) -> None:
        for _ in range(frames):
            self.frame()

    def settle(self) -> None:
        """Without a hand, until the legs rest."""
        for _ in range(300):
            self.frame()
            state = self.rig.state
            assert state is not None
            if state.running is None and state.motion.settled:
                return
        raise AssertionError("the legs never came to rest")

    @property
    def state(self) -> GaitState:
        assert self.rig.state is not None
        return self.rig.state.gait.state


def written(home: Path, entries: list[tuple[str, int, Body]]) -> list[Record]:
    """The session as the audit process writes it, signed with the home's key."""
    (home / "logs").mkdir(parents=True, exist_ok=True)
    writer = SessionWriter(home / "logs", "s", load_or_make_key(home / "keys"), Disk(), CheckpointCopy(""))
    first = Moment(wall_ns=1_790_000_000_000_000_000, monotonic_ns=1, operator="ann")
    writer.begin(START, first)
    now = first
    for process, at_ns, body in entries:
        now = Moment(wall_ns=first.wall_ns + at_ns, monotonic_ns=at_ns, operator="ann")
        writer.take(
            Entry(process=process, operator="ann", wall_ns=now.wall_ns, monotonic_ns=now.monotonic_ns, body=body)
        )
    writer.end("test", now)
    assert writer.finish(now)
    writer.close()
    return records(writer.path)
