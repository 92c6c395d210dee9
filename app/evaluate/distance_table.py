"""Table 5 on the digital hand: error over distance, monocular and D435i, and what tilt and movement do to it.

Each hand is calibrated once, at 35 cm, as a patient is; `published` takes the true palm as measured by a ruler.
None of these hands served to fit the palm's shape or the safe factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from app.evaluate.digital_scenes import GESTURES, Moment, held, take, tilted, walk
from app.evaluate.distance_measures import DistanceFigures, FloatArray, figures
from hal.cameras.camera import Intrinsics
from hal.cameras.hand_depth import DepthCamera
from hal.cameras.hand_scene import Person, lens_for, person_of
from kgdfa.depth import DepthRange
from kgdfa.distance import Distance, PublishedRange, RangeFinder, RobustRange
from kgdfa.keypoints import HandDetector
from profiles.calibration import calibrate
from profiles.palm import ANCHOR_OF_PALM
from profiles.schema import Profile, Sex

FRAME_NS = 33_333_333
GAP_NS = 1_000_000_000
DISTANCES_CM = tuple(range(10, 75, 5))
CALIBRATED_AT_M = 0.35
PROVISIONAL_PALM_M = 0.080
TILT_RAD = math.radians(40)
TILT_DIRECTIONS = 8
TILT_DISTANCES_CM = (20, 30, 45, 60)
HELD_FRAMES = 8
CALIBRATION_FRAMES = 24
WALK_FRAMES = 30
FIRST_HAND = 101  # seeds below served in development
FIRST_WALK = 20_001

# The paper's Table 5: distance in cm → error in %, monocular and D435i (None: no measurement).
PAPER_TABLE_5: dict[int, tuple[float, float | None]] = {
    10: (-7.0, None), 15: (-4.0, None), 20: (-3.0, None), 25: (-2.8, 1.6), 30: (-1.6, 0.3), 35: (-1.4, -0.3),
    40: (-2.25, 0.0), 45: (0.6, 0.0), 50: (3.2, 0.0), 55: (4.5, -0.2), 60: (4.8, -0.3), 65: (5.1, -0.4),
    70: (12.4, -0.6),
}  # fmt: skip

Step = Callable[[], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Table5Row:
    """One distance, hands facing the camera: mean error in %, NaN where nothing was measured.

    worst_percent: of the single hand that is furthest off, robust monocular.
    """

    distance_cm: int
    mono_percent: dict[str, float]
    worst_percent: float
    depth_percent: dict[str, float]
    depth_zero: float  # share of frames in which the depth map says 0 at keypoint 21

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it; None where nothing was measured."""
        paper, paper_depth = PAPER_TABLE_5[self.distance_cm]
        return {
            "distance_cm": self.distance_cm,
            "monocular": {name: _number(value) for name, value in self.mono_percent.items()},
            "monocular_worst_hand": _number(self.worst_percent),
            "d435i": {name: _number(value) for name, value in self.depth_percent.items()},
            "d435i_zero_share": round(self.depth_zero, 3),
            "paper": {"monocular": paper, "d435i": paper_depth},
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltRow:
    """Hands tilted by 40° towards one direction: robust errors in % of the shown distance; near share of the safe."""

    direction_deg: int
    median_percent: float
    p95_percent: float
    near_3: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Table5:
    """Everything the digital hand says about distance."""

    hands: int
    focal_px: float
    rows: tuple[Table5Row, ...]
    tilts: tuple[TiltRow, ...]
    walk: dict[str, DistanceFigures]

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        return {
            "hands": self.hands,
            "focal_px": self.focal_px,
            "table_5": [row.as_json() for row in self.rows],
            "tilted_40": [
                {
                    "direction_deg": row.direction_deg,
                    "median_abs_percent": _number(row.median_percent),
                    "p95_abs_percent": _number(row.p95_percent),
                    "near_3": round(row.near_3, 4),
                }
                for row in self.tilts
            ],
            "frames": self.walk["robust"].frames,
            **{name: one.as_json() for name, one in self.walk.items()},
        }


@dataclass(slots=True)
class Watcher:
    """Looks at moments through the detector, in one growing time."""

    detector: HandDetector
    step: Step
    now_ns: int = GAP_NS

    def measure(self, finders: Iterable[RangeFinder], moments: Iterable[Moment]) -> list[list[Distance | None]]:
        """Each finder's distance in each moment: a list a finder, after a pause that forgets the past."""
        finders = list(finders)
        measured: list[list[Distance | None]] = [[] for _ in finders]
        self.now_ns += GAP_NS
        for index, moment in enumerate(moments):
            self.now_ns += FRAME_NS
            hands = self.detector.detect(take(moment, index)[0], self.now_ns)
            for row, finder in zip(measured, finders, strict=True):
                row.append(finder.measure(hands[0], self.now_ns) if hands else None)
            self.step()
        return measured


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """One digital person before the camera, calibrated."""

    person: Person
    lens: Intrinsics
    seed: int
    anchor_m: float  # as calibrated

    def finders(self) -> tuple[PublishedRange, RobustRange]:
        """Published with the palm as a ruler tells it, robust with the calibrated anchor."""
        focal_px, centre_px = self.lens.fx_px, (self.lens.cx_px, self.lens.cy_px)
        return (
            PublishedRange(focal_px=focal_px, anchor_m=self.person.shape.anchor_m),
            RobustRange(focal_px=focal_px, anchor_m=self.anchor_m, centre_px=centre_px),
        )


def steps(hands: int, walks: int) -> int:
    """How many frames `evaluate_table_5` looks at."""
    facing = CALIBRATION_FRAMES + 2 * len(DISTANCES_CM) * HELD_FRAMES
    return hands * (facing + len(TILT_DISTANCES_CM) * TILT_DIRECTIONS * HELD_FRAMES) + walks * WALK_FRAMES


def evaluate_table_5(detector: HandDetector, *, hands: int, walks: int, focal_px: float, step: Step) -> Table5:
    """Look at that many hands, and that many seconds of random walk."""
    lens, watcher = lens_for(focal_px=focal_px), Watcher(detector, step)
    subjects = [_subject(watcher, lens, FIRST_HAND + number) for number in range(hands)]
    facing = [_facing(watcher, subject) for subject in subjects]
    tilts = [_tilt_errors(watcher, subject) for subject in subjects]
    return Table5(
        hands=hands,
        focal_px=focal_px,
        rows=tuple(_row(cm, [one[cm] for one in facing]) for cm in DISTANCES_CM),
        tilts=tuple(_tilt_row(number, [one[number] for one in tilts]) for number in range(TILT_DIRECTIONS)),
        walk=_walks(watcher, lens, walks),
    )


def _subject(watcher: Watcher, lens: Intrinsics, seed: int) -> Subject:
    """A person, calibrated as `rleex profile calibrate` does it."""
    person = person_of(seed)
    patient = Profile(identifier="digital", sex=Sex.MALE, stature_m=1.7, mass_kg=70.0)
    provisional_m = ANCHOR_OF_PALM * PROVISIONAL_PALM_M
    finder = RobustRange(focal_px=lens.fx_px, anchor_m=provisional_m, centre_px=(lens.cx_px, lens.cy_px))
    shown = held("5", person=person, lens=lens, distance_m=CALIBRATED_AT_M, turn_rad=(0, 0), seed=seed,
                 frames=CALIBRATION_FRAMES)  # fmt: skip
    (measured,) = watcher.measure([finder], shown)
    made = calibrate(
        patient, camera="digital hand", focal_px=lens.fx_px, width_px=lens.width_px, distance_m=CALIBRATED_AT_M,
        measured_m=[one.shown_m for one in measured if one], provisional_anchor_m=provisional_m,
        at=datetime(2026, 1, 1, tzinfo=UTC),
    )  # fmt: skip
    return Subject(person=person, lens=lens, seed=seed, anchor_m=made.anchor_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Held:
    """Relative errors of one hand held at one distance."""

    mono: dict[str, FloatArray]
    depth: dict[str, FloatArray]
    zero: float


def _facing(watcher: Watcher, subject: Subject) -> dict[int, _Held]:
    """From far to near, so that the track is kept as long as it can be."""
    found = {}
    for cm in reversed(DISTANCES_CM):
        moments = list(held("5", person=subject.person, lens=subject.lens, distance_m=cm / 100, turn_rad=(0, 0),
                            seed=subject.seed, frames=HELD_FRAMES))  # fmt: skip
        rows = watcher.measure(subject.finders(), moments)
        mono = {name: _errors(row, moments) for name, row in zip(("published", "robust"), rows, strict=True)}
        depth, zero = _depth_errors(watcher, subject, moments)
        found[cm] = _Held(mono=mono, depth=depth, zero=zero)
    return found


def _depth_errors(watcher: Watcher, subject: Subject, moments: list[Moment]) -> tuple[dict[str, FloatArray], float]:
    """The D435i alone: without the monocular fallback, so that its own reach is seen."""
    camera = DepthCamera(subject.seed)
    readers = {name: DepthRange(mode=name) for name in ("published", "robust")}
    measured: dict[str, list[Distance | None]] = {name: [] for name in readers}
    watcher.now_ns += GAP_NS
    for index, moment in enumerate(moments):
        watcher.now_ns += FRAME_NS
        image, depth_m = take(moment, index, camera)
        hands = watcher.detector.detect(image, watcher.now_ns)
        assert depth_m is not None
        for name, reader in readers.items():
            measured[name].append(reader.measure(depth_m, hands[0], None, watcher.now_ns) if hands else None)
        watcher.step()
    zeros = [one.shown_m == 0 for one in measured["published"] if one]
    return {name: _errors(row, moments) for name, row in measured.items()}, float(np.mean(zeros)) if zeros else 0.0


def _tilt_errors(watcher: Watcher, subject: Subject) -> list[tuple[FloatArray, FloatArray]]:
    """Shown and safe errors of the robust finder, a pair a direction, over the distances."""
    pairs = []
    for direction in range(TILT_DIRECTIONS):
        turn = tilted(TILT_RAD, direction * 2 * math.pi / TILT_DIRECTIONS)
        shown, safe = [], []
        for cm in TILT_DISTANCES_CM:
            moments = list(held("5", person=subject.person, lens=subject.lens, distance_m=cm / 100, turn_rad=turn,
                                seed=subject.seed, frames=HELD_FRAMES))  # fmt: skip
            (row,) = watcher.measure([subject.finders()[1]], moments)
            shown.append(_errors(row, moments))
            safe.append(_errors(row, moments, safe=True))
        pairs.append((np.concatenate(shown), np.concatenate(safe)))
    return pairs


def _walks(watcher: Watcher, lens: Intrinsics, walks: int) -> dict[str, DistanceFigures]:
    """Random walks of new people with all gestures, the palm known by ruler: the safety property."""
    true: list[float] = []
    rows: tuple[list[Distance | None], list[Distance | None]] = ([], [])
    for number in range(walks):
        seed = FIRST_WALK + number
        person = person_of(seed)
        subject = Subject(person=person, lens=lens, seed=seed, anchor_m=person.shape.anchor_m)
        moments = list(walk(GESTURES[number % 12], person=person, lens=lens, seed=seed, frames=WALK_FRAMES))
        for kept, row in zip(rows, watcher.measure(subject.finders(), moments), strict=True):
            kept.extend(row)
        true.extend(moment.true_m for moment in moments)
    return {
        name: figures(np.array(true), _values(row, "shown_m"), _values(row, "safe_m"))
        for name, row in zip(("published", "robust"), rows, strict=True)
    }


def _row(cm: int, hands: list[_Held]) -> Table5Row:
    names = ("published", "robust")
    each = [_mean(one.mono["robust"]) for one in hands]
    return Table5Row(
        distance_cm=cm,
        mono_percent={name: _mean(np.concatenate([one.mono[name] for one in hands])) for name in names},
        worst_percent=max(each, key=lambda percent: -1.0 if math.isnan(percent) else abs(percent)),
        depth_percent={name: _mean(np.concatenate([one.depth[name] for one in hands])) for name in names},
        depth_zero=float(np.mean([one.zero for one in hands])),
    )


def _tilt_row(number: int, pairs: list[tuple[FloatArray, FloatArray]]) -> TiltRow:
    shown = np.concatenate([pair[0] for pair in pairs])
    safe = np.concatenate([pair[1] for pair in pairs])
    seen = np.isfinite(shown)
    return TiltRow(
        direction_deg=number * 360 // TILT_DIRECTIONS,
        median_percent=100 * float(np.median(np.abs(shown[seen]))) if seen.any() else math.nan,
        p95_percent=100 * float(np.percentile(np.abs(shown[seen]), 95)) if seen.any() else math.nan,
        near_3=float(np.mean(safe[seen] < -0.03)) if seen.any() else 0.0,
    )


def _errors(row: list[Distance | None], moments: list[Moment], *, safe: bool = False) -> FloatArray:
    true_m = np.array([moment.true_m for moment in moments])
    errors: FloatArray = _values(row, "safe_m" if safe else "shown_m") / true_m - 1
    return errors


def _values(row: list[Distance | None], field: str) -> FloatArray:
    return np.array([getattr(one, field) if one else np.nan for one in row], dtype=np.float64)


def _mean(errors: FloatArray) -> float:
    seen = errors[np.isfinite(errors)]
    return 100 * float(seen.mean()) if len(seen) else math.nan


def _number(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 2)
