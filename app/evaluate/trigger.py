"""Table 6 on the digital hand: how often posture changes press the button, for both cameras in both modes.

At each distance a hand comes from 15 cm farther with gesture 5, stops there and changes its posture: it flips,
closes and opens, runs to the picture's edge and back, or the background behind it jumps. A change counts as a
press when the button was pressed in any of its frames. Every frame goes through the real pipeline, once a mode.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

from app.evaluate.camera_rates import FRAME_NS, CameraRates, depth_fps, monocular_fps
from app.evaluate.digital_scenes import CHANGES, Moment, approach_and_change, take
from app.evaluate.watcher import Watcher, spread
from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.render import Person, lens_for, person_of
from kgdfa.button import ButtonMode, ButtonPlace
from kgdfa.depth import DepthRange
from kgdfa.distance import PublishedRange
from kgdfa.hand import Hand
from kgdfa.pipeline import Detector, Picture, Pipeline, Report
from kgdfa.preprocess import Image
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustRules
from kgdfa.robust_distance import RobustRange

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


Key = tuple[str, str]  # camera, mode


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerRow:
    """One distance. pressed: share of the changes with a press; commands: how many commands the changes gave."""

    distance_cm: int
    changes: int
    pressed: dict[Key, float]
    commands: dict[Key, int]
    fps: dict[str, float]  # see `camera_rates`; empty where not measured

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        paper, paper_fps = PAPER_TABLE_6[self.distance_cm], PAPER_FPS[self.distance_cm]
        row: dict[str, Any] = {"distance_cm": self.distance_cm, "changes": self.changes}
        for number, camera in enumerate(CAMERAS):
            row[camera.lower()] = {
                **{mode: round(self.pressed[camera, mode], 3) for mode in MODES},
                "fps": round(self.fps[camera], 1) if camera in self.fps else None,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One posture change to look at."""

    distance_cm: int
    number: int
    focal_px: float

    @property
    def person(self) -> Person:
        """Another hand for each change, the same at every distance."""
        return person_of(FIRST_HAND + self.number)

    @property
    def lens(self) -> Intrinsics:
        """Of the digital camera."""
        return lens_for(focal_px=self.focal_px)

    def moments(self) -> list[Moment]:
        """Showing, approaching, changing."""
        return list(
            approach_and_change(
                CHANGES[self.number % len(CHANGES)],
                person=self.person,
                lens=self.lens,
                distance_m=self.distance_cm / 100,
                frames=FRAMES,
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one change did to each button: whether it was pressed, and how many commands it gave."""

    pressed: frozenset[Key]
    commands: dict[Key, int]


def steps(changes: int) -> int:
    """How many changes `evaluate_trigger` looks at."""
    return len(DISTANCES_CM) * changes


def evaluate_trigger(
    pool: ProcessPoolExecutor, *, changes: int, focal_px: float, rates: CameraRates, step: Callable[[], None]
) -> list[TriggerRow]:
    """A row a distance, of that many posture changes, each by another hand."""
    wanted = [
        Change(distance_cm=cm, number=number, focal_px=focal_px) for cm in DISTANCES_CM for number in range(changes)
    ]
    outcomes = spread(pool, look_at, wanted, step)
    return [
        _row(cm, outcomes[place * changes : (place + 1) * changes], rates.get(cm, {}))
        for place, cm in enumerate(DISTANCES_CM)
    ]


def _row(cm: int, outcomes: list[Outcome], fps: dict[str, float]) -> TriggerRow:
    keys = [(camera, mode) for camera in CAMERAS for mode in MODES]
    return TriggerRow(
        distance_cm=cm,
        changes=len(outcomes),
        pressed={key: sum(key in one.pressed for one in outcomes) / len(outcomes) for key in keys},
        commands={key: sum(one.commands.get(key, 0) for one in outcomes) for key in keys},
        fps=fps,
    )


def look_at(watcher: Watcher, change: Change) -> Outcome:
    """One change, seen by both cameras and judged in both modes."""
    camera = DepthCamera(FIRST_HAND + change.number)
    pipelines = {mode: replay_pipeline(mode, change.person, change.lens) for mode in MODES}
    pressed: set[Key] = set()
    commands: dict[Key, int] = {}
    for index, moment in enumerate(change.moments()):
        image, depth_m = take(moment, index, camera)
        hands = watcher.look(image)
        for mode, (replay, pipeline) in pipelines.items():
            replay.hands = hands
            report = pipeline.process(Picture(image_bgr=image, captured_ns=watcher.now_ns, depth_m=depth_m))
            now_pressed, commands_now = _buttons(mode, report)
            commands.update(commands_now)
            pressed |= now_pressed if index >= FRAMES[0] else set()  # showing is not part of it
    return Outcome(pressed=frozenset(pressed), commands=commands)


def _buttons(mode: str, report: Report) -> tuple[set[Key], dict[Key, int]]:
    """Which buttons are down, and the commands that each has given so far."""
    both = {("monocular", mode): report.button, ("D435i", mode): report.depth_button}
    known = {key: button for key, button in both.items() if button is not None}
    return (
        {key for key, button in known.items() if button.pressed},
        {key: button.release_count for key, button in known.items()},
    )


def measure_rates(detector: Detector, *, focal_px: float, step: Callable[[], None]) -> CameraRates:
    """Each camera's frames a second at each distance, in robust mode, over one change of each kind."""
    rates: CameraRates = {}
    start_ns = 0
    for cm in DISTANCES_CM:
        moments = [
            moment
            for number in range(len(CHANGES))
            for moment in Change(distance_cm=cm, number=number, focal_px=focal_px).moments()[-FRAMES[2] :]
        ]
        pipelines = [chain("robust", person_of(FIRST_HAND), lens_for(focal_px=focal_px), detector) for _ in CAMERAS]
        start_ns += 1_000_000_000 + 2 * len(moments) * FRAME_NS
        rates[cm] = {
            "monocular": monocular_fps(pipelines[0], moments, start_ns),
            "D435i": depth_fps(pipelines[1], moments, start_ns + len(moments) * FRAME_NS, FIRST_HAND),
        }
        step()
    return rates


def replay_pipeline(
    mode: str, person: Person, lens: Intrinsics, threshold_m: float = THRESHOLD_M
) -> tuple[Replay, Pipeline]:
    """The mode's whole chain behind a detector that repeats what another one found."""
    replay = Replay()
    return replay, chain(mode, person, lens, replay, threshold_m)


def chain(
    mode: str, person: Person, lens: Intrinsics, detector: Detector, threshold_m: float = THRESHOLD_M
) -> Pipeline:
    """The mode's whole chain for a person whose palm is known by ruler."""
    reference_m, centre_px = person.shape.reference_m, (lens.cx_px, lens.cy_px)
    finder = PublishedRange if mode == "published" else RobustRange
    return Pipeline(
        detector=detector,
        rules=PublishedRules() if mode == "published" else RobustRules(),
        range_finder=finder(focal_px=lens.fx_px, reference_m=reference_m, centre_px=centre_px),
        place=ButtonPlace.in_the_middle(lens.width_px, lens.height_px, threshold_m),
        mode=ButtonMode(mode),
        depth_finder=DepthRange(mode=mode),
    )
