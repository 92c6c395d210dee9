"""Table 6 on the digital hand: how often posture changes press the button, for both cameras in both modes.

At each distance a hand comes from 15 cm farther with gesture 5, stops there and changes its posture: it flips,
closes and opens, runs to the picture's edge and back, or the background behind it jumps. A change counts as a
press when the button was pressed in any of its frames. Every frame goes through the real pipeline, once a mode.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from app.evaluate.digital_scenes import CHANGES, approach_and_change, take
from hal.cameras.camera import Intrinsics
from hal.cameras.hand_depth import DepthCamera
from hal.cameras.hand_scene import Person, lens_for, person_of
from kgdfa.button import ButtonMode, ButtonPlace
from kgdfa.depth import DepthRange
from kgdfa.distance import PublishedRange, RobustRange
from kgdfa.hand import Hand
from kgdfa.images import Image
from kgdfa.keypoints import HandDetector
from kgdfa.pipeline import Picture, Pipeline, Report
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustRules

FRAME_NS = 33_333_333
GAP_NS = 1_000_000_000
DISTANCES_CM = tuple(range(10, 75, 5))
FRAMES = (6, 10, 14)  # showing, approaching, changing
FIRST_HAND = 301
THRESHOLD_M = 0.20
MODES = ("published", "robust")
CAMERAS = ("monocular", "D435i")

# The paper's Table 6: distance in cm → press probability in %, monocular and D435i; and frames per second.
PAPER_TABLE_6: dict[int, tuple[int, int]] = {
    10: (100, 100), 15: (100, 100), 20: (80, 100), 25: (0, 90), 30: (0, 30), 35: (0, 20), 40: (0, 20), 45: (0, 10),
    50: (0, 10), 55: (0, 5), 60: (0, 5), 65: (0, 0), 70: (0, 0),
}  # fmt: skip
PAPER_FPS: dict[int, tuple[int, int]] = {
    10: (32, 19), 15: (31, 15), 20: (38, 12), 25: (32, 11), 30: (33, 10), 35: (31, 17), 40: (33, 16), 45: (37, 11),
    50: (33, 18), 55: (34, 11), 60: (32, 9), 65: (35, 11), 70: (34, 10),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerRow:
    """One distance. pressed: share of the changes with a press; commands: how many commands the changes gave.

    fps: frames a second that one core makes of pictures already taken (detector and pipeline), a camera.
    """

    distance_cm: int
    changes: int
    pressed: dict[tuple[str, str], float]
    commands: dict[tuple[str, str], int]
    fps: dict[str, float]

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        paper, paper_fps = PAPER_TABLE_6[self.distance_cm], PAPER_FPS[self.distance_cm]
        row: dict[str, Any] = {"distance_cm": self.distance_cm, "changes": self.changes}
        for number, camera in enumerate(CAMERAS):
            row[camera.lower()] = {
                **{mode: round(self.pressed[camera, mode], 3) for mode in MODES},
                "fps": round(self.fps[camera], 1),
                "commands": {mode: self.commands[camera, mode] for mode in MODES},
                "paper": paper[number] / 100,
                "paper_fps": paper_fps[number],
            }
        return row


class Replay:
    """A detector that gives what another one has found, so that both modes judge the same hands."""

    def __init__(self) -> None:
        self.hands: tuple[Hand, ...] = ()

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:  # noqa: ARG002 - the protocol's
        """The hands put in before."""
        return self.hands


@dataclass(slots=True)
class _Tally:
    """Counts over the changes at one distance."""

    pressed: dict[tuple[str, str], int] = field(default_factory=dict)
    commands: dict[tuple[str, str], int] = field(default_factory=dict)
    frames: int = 0
    detect_s: float = 0.0
    judge_s: dict[str, float] = field(default_factory=dict)


def steps(changes: int) -> int:
    """How many frames `evaluate_trigger` looks at."""
    return len(DISTANCES_CM) * changes * sum(FRAMES)


def evaluate_trigger(
    detector: HandDetector, *, changes: int, focal_px: float, step: Callable[[], None]
) -> list[TriggerRow]:
    """A row a distance, of that many posture changes, each by another hand."""
    lens = lens_for(focal_px=focal_px)
    run = _Run(detector, lens, step)
    return [run.row(cm, changes) for cm in DISTANCES_CM]


class _Run:
    """Walks through the changes, in one growing time."""

    def __init__(self, detector: HandDetector, lens: Intrinsics, step: Callable[[], None]) -> None:
        self._detector, self._lens, self._step = detector, lens, step
        self._now_ns = GAP_NS

    def row(self, cm: int, changes: int) -> TriggerRow:
        tally = _Tally()
        for number in range(changes):
            self._change(cm, number, tally)
        both = [(camera, mode) for camera in CAMERAS for mode in MODES]
        mono_s = tally.detect_s + tally.judge_s["monocular"]
        return TriggerRow(
            distance_cm=cm,
            changes=changes,
            pressed={key: tally.pressed.get(key, 0) / changes for key in both},
            commands={key: tally.commands.get(key, 0) for key in both},
            fps={
                "monocular": tally.frames / mono_s,
                "D435i": tally.frames / (tally.detect_s + tally.judge_s["D435i"]),
            },
        )

    def _change(self, cm: int, number: int, tally: _Tally) -> None:
        seed = FIRST_HAND + number
        person = person_of(seed)
        pipelines = {mode: replay_pipeline(mode, person, self._lens) for mode in MODES}
        camera, pressed = DepthCamera(seed), set[tuple[str, str]]()
        reports: dict[str, Report] = {}
        self._now_ns += GAP_NS
        moments = approach_and_change(
            CHANGES[number % len(CHANGES)], person=person, lens=self._lens, distance_m=cm / 100, frames=FRAMES
        )
        for index, moment in enumerate(moments):
            self._now_ns += FRAME_NS
            image, depth_m = take(moment, index, camera)
            began = time.perf_counter()
            hands = self._detector.detect(image, self._now_ns)
            tally.detect_s += time.perf_counter() - began
            tally.frames += 1
            counts = index >= FRAMES[0]  # showing is not part of it
            for mode, (replay, pipeline) in pipelines.items():
                replay.hands = hands
                picture = Picture(image_bgr=image, captured_ns=self._now_ns, depth_m=depth_m)
                began = time.perf_counter()
                report = reports[mode] = pipeline.process(picture)
                if mode == "robust":
                    _add_time(tally, time.perf_counter() - began)
                if counts:
                    pressed |= {("monocular", mode)} if report.button.pressed else set()
                    depth_button = report.depth_button
                    pressed |= {("D435i", mode)} if depth_button and depth_button.pressed else set()
            self._step()
        for key in pressed:
            tally.pressed[key] = tally.pressed.get(key, 0) + 1
        for mode, last in reports.items():
            _add_commands(tally, mode, last)


def _add_time(tally: _Tally, spent_s: float) -> None:
    """Both distances are measured in one pass, the map's neighbourhood being the cheaper: count it to both."""
    for camera in CAMERAS:
        tally.judge_s[camera] = tally.judge_s.get(camera, 0.0) + spent_s


def _add_commands(tally: _Tally, mode: str, last: Report) -> None:
    for camera, button in (("monocular", last.button), ("D435i", last.depth_button)):
        if button is not None:
            key = (camera, mode)
            tally.commands[key] = tally.commands.get(key, 0) + button.release_count


def replay_pipeline(
    mode: str, person: Person, lens: Intrinsics, threshold_m: float = THRESHOLD_M
) -> tuple[Replay, Pipeline]:
    """The mode's whole chain for a person whose palm is known by ruler."""
    replay = Replay()
    anchor_m, centre_px = person.shape.anchor_m, (lens.cx_px, lens.cy_px)
    finder = PublishedRange if mode == "published" else RobustRange
    pipeline = Pipeline(
        detector=replay,
        rules=PublishedRules() if mode == "published" else RobustRules(),
        range_finder=finder(focal_px=lens.fx_px, anchor_m=anchor_m, centre_px=centre_px),
        place=ButtonPlace(x_px=lens.cx_px, y_px=lens.cy_px, radius_px=0.06 * lens.width_px, threshold_m=threshold_m),
        mode=ButtonMode(mode),
        depth_finder=DepthRange(mode=mode),
    )
    return replay, pipeline
