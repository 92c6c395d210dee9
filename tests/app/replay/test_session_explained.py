"""A session from the hand to the joint commands in simulated time: each decision is explained by its live numbers.

The whole perception but the detector (drawn hands stand for it) and the whole step of control, with the messages that
the console receives as the live values: twelve actions, two cancelled pushes, three refusals, one STOP.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.control.inputs import Inputs
from app.control.loop import limits_record
from app.control.telemetry import LoopStatus, snapshot
from app.demo.scenario import ALL_TWELVE
from app.ipc.messages import ActionReport, ControlSnapshot, Lateness, OperatorKind, RealTime, TriggerReport
from app.ipc.states import Action, GaitState
from app.perception.frames import DecisionRecorder, button_record
from app.perception.reporting import Context, to_message
from hal.minimum_jerk import minimum_jerk
from kgdfa.button import ButtonMode, ButtonPlace
from kgdfa.distance import DistanceChoice
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.pipeline import Pipeline, PipelineInput, Report
from kgdfa.published import PublishedRules
from kgdfa.robust_distance import RobustRange
from logs import records as r
from logs.disk import Disk
from logs.explain.hops import Hop, explain
from logs.journal import Moment
from logs.keys import load_or_make_key
from logs.mirror import CheckpointCopy
from logs.read import records
from logs.records import Body, Entry, Record
from logs.writer import SessionWriter
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
        context = Context(
            incarnation=1, sequence=count, sent_ns=captured_ns, camera="c", threshold_m=PLACE.threshold_m, fps=30.0
        )
        message = to_message(report, context, captured_ns)
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
                status = LoopStatus(
                    incarnation=1, sequence=1, simulated=True, lateness=Lateness(), real_time=RealTime()
                )
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


def lived() -> Live12:
    """Twelve actions, two cancelled pushes, three refusals, one STOP."""
    live = Live12()
    live.rest()
    live.key(K.CONFIRM_PATIENT)
    live.push(Gesture.ZERO)  # refused: not armed
    live.rest()
    live.key(K.ARM)
    live.key(K.ACT, A.SIT_DOWN)  # refused: unpowered
    for step in ALL_TWELVE:
        live.push(step.gesture)
        if step.steps:
            live.rest(40)
        else:
            live.settle()
            assert live.state is step.end, step
    live.sign(Gesture.FIVE)
    live.approach(Gesture.FIVE)
    for _ in range(3):
        live.frame(hand_at(Gesture.FIVE, NEAR_M, aside_px=500.0))  # cancelled: left sideways
    live.rest()
    live.sign(Gesture.ONE)
    live.approach(Gesture.ONE)
    live.rest()  # cancelled: the hand is lost
    live.push(Gesture.ROCK)  # refused: the legs stand
    live.rest()
    live.push(Gesture.ONE)
    live.key(K.STOP)
    live.settle()
    live.entries += [("perception", live.rig.now_ns, body) for body in live.recorder.end()]
    return live


def written(home: Path, entries: list[tuple[str, int, Body]]) -> list[Record]:
    """The session as the audit process writes it, signed with the home's key."""
    (home / "logs").mkdir(parents=True)
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


@pytest.fixture(scope="module")
def live() -> Live12:
    return lived()


@pytest.fixture(scope="module")
def home(live: Live12, tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("home")
    written(home, live.entries)
    return home


@pytest.fixture(scope="module")
def found(home: Path) -> list[Record]:
    return records(home / "logs" / "s.jsonl")


def of(found: list[Record], kind: type[Body]) -> Iterator[Record]:
    return (record for record in found if isinstance(record.body, kind))


def test_the_session_is_what_it_is_to_be(found: list[Record]) -> None:
    ends = [record.body for record in of(found, r.ActionEnd) if isinstance(record.body, r.ActionEnd)]
    assert len({end.action for end in ends if end.outcome == "completed"}) == 12
    assert len([*of(found, r.Cancel)]) == 2
    assert len([*of(found, r.Refusal)]) == 3
    assert len([*of(found, r.Stop)]) == 1


def test_each_press_release_cancel_and_hint_is_explained_with_the_numbers_of_its_message(
    live: Live12, found: list[Record]
) -> None:
    kept = {r.Press: True, r.Release: True}  # of these each limit is kept, of the others one at least is not
    decided = [*of(found, r.Press), *of(found, r.Release), *of(found, r.Cancel), *of(found, r.Hint)]
    assert len(decided) >= 34
    for record in decided:
        assert isinstance(record.body, r.Press | r.Release | r.Cancel | r.Hint)
        report, message = live.reports[record.body.captured_ns]
        compared = report.button.compared
        assert compared is not None
        (step,) = (step for step in explain(found, record.sequence).steps if step.record is record)
        told = {check.name: (check.value, check.limit) for check in step.checks}
        released = isinstance(record.body, r.Release | r.Cancel)
        limit_m = compared.release_m if released else message.threshold_m
        wanted: dict[str, tuple[float | None, float | None]] = {
            "safe_distance_m": (message.safe_distance_m, limit_m),
            "distance_m": (message.distance_m, None),
            "previous_m": (compared.previous_m, None),
            "nearer_m": (compared.nearer_m, compared.nearer_limit_m),
            "beside_px": (compared.beside_px, compared.beside_limit_px),
            "elapsed_ns": (compared.elapsed_ns, compared.elapsed_limit_ns),
            "gap_frames": (compared.gap_frames, compared.gap_limit_frames),
            "anchor_m": (SCALE.anchor_m, None),
            "focal_px": (SCALE.focal_px, None),
        }
        if not released:
            wanted["approached_m"] = (compared.approached_m, compared.approach_limit_m)
        if released:
            wanted["held_ns"] = (compared.held_ns, compared.held_limit_ns)
        assert told == wanted
        margins = [check.margin for check in step.checks if check.margin is not None]
        assert not kept.get(type(record.body)) or min(margins) >= 0, (record, step.checks)


def test_each_onset_is_explained_with_the_numbers_of_its_message(live: Live12, found: list[Record]) -> None:
    for record in of(found, r.GestureOnset):
        assert isinstance(record.body, r.GestureOnset)
        report, message = live.reports[record.body.captured_ns]
        assert record.body.vote_ns == report.vote_ns
        step = next(step for step in explain(found, record.sequence).steps if step.record is record)
        told = {check.name: check.value for check in step.checks}
        assert told == {"confidence": message.confidence, "votes": message.votes}


def test_each_action_is_explained_with_the_moments_that_control_published(live: Live12, found: list[Record]) -> None:
    published: dict[int, ActionReport] = {one.number: one for each in live.snapshots for one in each.reports}
    for record in of(found, r.ActionEnd):
        assert isinstance(record.body, r.ActionEnd)
        explanation = explain(found, record.sequence)
        at = {step.hop: step.at_ns for step in explanation.steps}
        wanted = published[record.body.number]
        assert at[Hop.RELEASED] == wanted.released_ns
        assert at[Hop.ACCEPTED] == wanted.accepted_ns
        assert at.get(Hop.COMMANDED) == (wanted.first_command_ns or None)
        assert at.get(Hop.MOVED) == (wanted.first_motion_ns or None)
        assert (Hop.CLOSING in at) is (record.body.action == Action.WALK_END.value)
        assert at[Hop.ENDED] == wanted.ended_ns
        _, recognised = live.reports[wanted.recognised_ns]
        assert at[Hop.RECOGNISED] == recognised.recognised_ns
        moments = [step.at_ns for step in explanation.steps if step.at_ns is not None]
        assert moments == sorted(moments)


def test_each_refusal_and_the_stop_is_explained_as_the_screen_showed_it(live: Live12, found: list[Record]) -> None:
    shown = [one.refusal for one in live.snapshots]
    for record in of(found, r.Refusal):
        assert isinstance(record.body, r.Refusal)
        assert record.body.reason in shown
        assert explain(found, record.sequence).steps[-1].at_ns == record.body.refused_ns
    (stop,) = of(found, r.Stop)
    at = {step.hop: step.at_ns for step in explain(found, stop.sequence).steps}
    state = live.rig.state
    assert state is not None
    assert (at[Hop.SENT], at[Hop.RECEIVED]) == (state.stop_ns, state.stop_received_ns)
    assert at[Hop.COMMANDED] == state.stop_command_ns > state.stop_received_ns


def run_replay(home: Path, *options: str) -> tuple[int, str]:
    ran = CliRunner().invoke(cli, ["audit", "replay", "s", "--home", str(home), *options])
    return ran.exit_code, ran.output


def test_the_replay_is_equal(home: Path, found: list[Record]) -> None:
    status, text = run_replay(home)
    assert (status, "0 differ" in text) == (0, True), text
    told = json.loads(run_replay(home, "--json")[1])
    assert (told["differences"], told["not_recorded"]) == ([], 0)
    assert told["replayed"] > 150
    assert told["writer"]["is"] == "not-recorded"
    assert "WARNING" in text
    assert "keypoints are not recorded" in text


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (r.Press, "safe_distance_m", 0.21),
        (r.Release, "held_ns", 1),
        (r.Cancel, "beside_px", 0.5),
        (r.Refusal, "in_force", ("stop",)),
        (r.Command, "action", Action.WALK.value),
        (r.EffectChanged, "to_effect", "damp"),
        (r.Stop, "effect", "damp"),
    ],
)
def test_one_value_changed_in_a_copy_that_is_signed_again_is_told(
    live: Live12, tmp_path: Path, kind: type[Body], field: str, value: object
) -> None:
    place = next(at for at, (_, _, body) in enumerate(live.entries) if isinstance(body, kind))
    process, at_ns, body = live.entries[place]
    forged = [*live.entries]
    forged[place] = (process, at_ns, msgspec.structs.replace(body, **{field: value}))
    home = tmp_path / "copy"
    found = written(home, forged)
    assert CliRunner().invoke(cli, ["audit", "verify", "--home", str(home)]).exit_code == 0
    status, text = run_replay(home)
    assert status == 1
    assert f"#{next(of(found, kind)).sequence} " in text
