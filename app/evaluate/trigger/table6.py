"""Table 6 on the digital hand: how often posture changes press the button, for both cameras in both modes.

At each distance a hand comes from 15 cm farther with gesture 5, stops there and changes its posture: it flips,
closes and opens, runs to the image's edge and back, or the background behind it jumps. A change counts as a
press when the button was pressed in any of its frames. Every frame goes through the real pipeline, once a mode.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.table import Table

from app.evaluate.detector_pool import PoolDetector, map_pool
from app.evaluate.distance.frames import STYLES
from app.evaluate.hand_motions import CHANGES, Moment, approach_and_change, take
from app.evaluate.harness import DISTANCES_CM, MODES, Step, decorate, figure, table
from app.evaluate.trigger.chain import CAMERAS, CHOICES, replay_pipeline
from app.text.catalogue import tr
from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.render import Person, lens_for, person_of
from kgdfa.pipeline import PipelineInput

FRAMES = (6, 10, 14)  # showing, approaching, changing
FIRST_HAND = 301

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
CameraRates = dict[int, dict[str, float]]  # distance in cm → camera → frames per second


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerRow:
    """One distance. pressed: share of the changes with a press; commands: how many commands the changes gave."""

    distance_cm: int
    changes: int
    pressed: dict[Key, float]
    commands: dict[Key, int]
    fps: dict[str, float]  # see `frame_rates`; empty where not measured

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One posture change."""

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
                leftwards=self.number // len(CHANGES) % 2 == 1,  # a depth map's edges differ
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeOutcome:
    """Whether one change pressed each button, and how many commands it gave."""

    pressed: frozenset[Key]
    commands: dict[Key, int]


def steps(changes: int) -> int:
    """How many changes `evaluate_trigger` simulates."""
    return len(DISTANCES_CM) * changes


def evaluate_trigger(
    pool: ProcessPoolExecutor, *, changes: int, focal_px: float, rates: CameraRates, step: Step
) -> list[TriggerRow]:
    """A row a distance, of that many posture changes, each by another hand."""
    wanted = [
        Change(distance_cm=cm, number=number, focal_px=focal_px) for cm in DISTANCES_CM for number in range(changes)
    ]
    outcomes = map_pool(pool, run_change, wanted, step)
    return [
        _row(cm, outcomes[place * changes : (place + 1) * changes], rates.get(cm, {}))
        for place, cm in enumerate(DISTANCES_CM)
    ]


def _row(cm: int, outcomes: list[ChangeOutcome], fps: dict[str, float]) -> TriggerRow:
    keys = [(camera, mode) for camera in CAMERAS for mode in MODES]
    return TriggerRow(
        distance_cm=cm,
        changes=len(outcomes),
        pressed={key: sum(key in one.pressed for one in outcomes) / len(outcomes) for key in keys},
        commands={key: sum(one.commands.get(key, 0) for one in outcomes) for key in keys},
        fps=fps,
    )


def run_change(detector: PoolDetector, change: Change) -> ChangeOutcome:
    """One change before both cameras, in both modes."""
    camera = DepthCamera(FIRST_HAND + change.number)
    pipelines = {
        key: replay_pipeline(key[1], change.person, change.lens, choice=choice) for key, choice in CHOICES.items()
    }
    pressed: set[Key] = set()
    commands: dict[Key, int] = {}
    for index, moment in enumerate(change.moments()):
        image, depth_m = take(moment, index, camera)
        hands = detector.detect(image)
        for key, (replay, pipeline) in pipelines.items():
            replay.hands = hands
            source = PipelineInput(image_bgr=image, captured_ns=detector.now_ns, depth_m=depth_m)
            button = pipeline.process(source).button
            commands[key] = button.release_count
            if button.pressed and index >= FRAMES[0]:  # showing is not part of it
                pressed.add(key)
    return ChangeOutcome(pressed=frozenset(pressed), commands=commands)


def table_6(rows: list[TriggerRow]) -> Table:
    """Press probability over distance."""
    cells = []
    for row in rows:
        line = [str(row.distance_cm)]
        for number, camera in enumerate(CAMERAS):
            line.append(str(PAPER_TABLE_6[row.distance_cm][number]))
            line.extend(f"{100 * row.pressed[camera, mode]:.0f}" for mode in MODES)
            fps = f"{row.fps[camera]:.0f}" if camera in row.fps else "–"
            line.append(f"{fps} ({PAPER_FPS[row.distance_cm][number]})")
        cells.append(line)
    columns = "cm " + " ".join(f"{camera}_{what}" for camera in CAMERAS for what in ("paper", *MODES, "fps"))
    return table("trigger.table_6", columns.lower(), cells, left=9, changes=rows[0].changes)


def plot_table_6(rows: list[TriggerRow], path: Path) -> None:
    """Press probability over distance for both cameras and both modes."""
    cm = [row.distance_cm for row in rows]
    with figure(path, 1, 2, share_y=True) as (_, panels):
        for column, (axes, camera) in enumerate(zip(panels, CAMERAS, strict=True)):
            paper = [PAPER_TABLE_6[distance][column] for distance in cm]
            axes.plot(cm, paper, label=tr("evaluate.plot.paper"), **STYLES["paper"])
            for mode in MODES:
                axes.plot(cm, [100 * row.pressed[camera, mode] for row in rows], label=mode, **STYLES[mode])
            axes.axvline(20, color="0.7", linewidth=1)
            decorate(axes, "true_distance_cm", "presses_percent", "camera", camera=camera)
