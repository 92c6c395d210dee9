"""Table 5 on the digital hand: error over distance, monocular and D435i, and what tilt and movement do to it.

Each hand is calibrated once, at 35 cm, as a patient is; `published` takes the true palm as measured by a ruler.
None of these hands served to fit the palm's shape or the safe factor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from app.evaluate.detector_pool import PoolDetector, map_pool
from app.evaluate.distance.frames import DistanceFigures, figures, values
from app.evaluate.distance.table5_results import Table5, Table5Row, TiltRow
from app.evaluate.hand_motions import Moment, held, take, tilted, walk
from app.evaluate.harness import DISTANCES_CM, MODES, Step, mean
from app.evaluate.readings import GESTURE_NAMES
from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.render import Person, lens_for, person_of
from kgdfa.depth import DepthRange
from kgdfa.distance import HALF_PALM_M, Distance, PublishedRange, RangeFinder
from kgdfa.hand import FloatArray
from kgdfa.robust_distance import RobustRange
from profiles.palm import REFERENCE_OF_PALM, calibrate
from profiles.schema import Profile, Sex

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """One digital person before the camera, calibrated."""

    person: Person
    lens: Intrinsics
    seed: int
    reference_m: float  # as calibrated

    def finders(self) -> tuple[PublishedRange, RobustRange]:
        """Published with the palm as a ruler gives it, robust with the calibrated anchor."""
        focal_px, centre_px = self.lens.fx_px, (self.lens.cx_px, self.lens.cy_px)
        return (
            PublishedRange(focal_px=focal_px, reference_m=self.person.shape.reference_m),
            RobustRange(focal_px=focal_px, reference_m=self.reference_m, centre_px=centre_px),
        )


def steps(hands: int, walks: int) -> int:
    """How many pieces of work `evaluate_table_5` has."""
    return hands * (2 + TILT_DIRECTIONS) + walks


def evaluate_table_5(pool: ProcessPoolExecutor, *, hands: int, walks: int, focal_px: float, step: Step) -> Table5:
    """That many hands, and that many seconds of random walk."""
    lens = lens_for(focal_px=focal_px)
    subjects = map_pool(pool, _calibrated, [_ruler(lens, FIRST_HAND + number) for number in range(hands)], step)
    facing = map_pool(pool, _facing, subjects, step)
    turned = [(one, number) for number in range(TILT_DIRECTIONS) for one in subjects]
    tilts = map_pool(pool, _tilt_errors, turned, step)
    walked = map_pool(pool, _walk, [_ruler(lens, FIRST_WALK + number) for number in range(walks)], step)
    return Table5(
        hands=hands,
        focal_px=focal_px,
        rows=tuple(_row(cm, [one[cm] for one in facing]) for cm in DISTANCES_CM),
        tilts=tuple(_tilt_row(at, tilts[at * hands : (at + 1) * hands]) for at in range(TILT_DIRECTIONS)),
        walk=_walk_figures(walked),
    )


def _ruler(lens: Intrinsics, seed: int) -> Subject:
    """A person whose palm is known by ruler."""
    person = person_of(seed)
    return Subject(person=person, lens=lens, seed=seed, reference_m=person.shape.reference_m)


def _measure(
    detector: PoolDetector, finders: Iterable[RangeFinder], moments: Iterable[Moment]
) -> list[list[Distance | None]]:
    """Each finder's distance in each moment: a list a finder."""
    finders = list(finders)
    measured: list[list[Distance | None]] = [[] for _ in finders]
    for index, moment in enumerate(moments):
        hands = detector.detect(take(moment, index)[0])
        for row, finder in zip(measured, finders, strict=True):
            row.append(finder.measure(hands[0], detector.now_ns) if hands else None)
    return measured


def _calibrated(detector: PoolDetector, subject: Subject) -> Subject:
    """The subject calibrated as `rleex profile calibrate` does it."""
    patient = Profile(identifier="digital", sex=Sex.MALE, stature_m=1.7, mass_kg=70.0)
    provisional_m, lens = REFERENCE_OF_PALM * PROVISIONAL_PALM_M, subject.lens
    finder = RobustRange(focal_px=lens.fx_px, reference_m=provisional_m, centre_px=(lens.cx_px, lens.cy_px))
    shown = held("5", person=subject.person, lens=lens, distance_m=CALIBRATED_AT_M, turn_rad=(0, 0),
                 seed=subject.seed, frames=CALIBRATION_FRAMES)  # fmt: skip
    (measured,) = _measure(detector, [finder], shown)
    made = calibrate(
        patient, camera="digital hand", focal_px=lens.fx_px, width_px=lens.width_px, distance_m=CALIBRATED_AT_M,
        measured_m=[one.shown_m for one in measured if one], provisional_reference_m=provisional_m,
        offset_m=HALF_PALM_M, at=datetime(2026, 1, 1, tzinfo=UTC),
    )  # fmt: skip
    return replace(subject, reference_m=made.reference_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Held:
    """Relative errors of one hand held at one distance."""

    mono: dict[str, FloatArray]
    depth: dict[str, FloatArray]
    zero: float | None  # None: the hand was found in no frame


def _facing(detector: PoolDetector, subject: Subject) -> dict[int, _Held]:
    """From far to near, so that the track is kept as long as it can be."""
    found = {}
    camera = DepthCamera(subject.seed)
    for cm in reversed(DISTANCES_CM):
        finders: tuple[RangeFinder, RangeFinder] = subject.finders()
        readers = {name: DepthRange(mode=name) for name in MODES}
        mono: dict[str, list[Distance | None]] = {name: [] for name in MODES}
        depth: dict[str, list[Distance | None]] = {name: [] for name in MODES}
        moments = list(held("5", person=subject.person, lens=subject.lens, distance_m=cm / 100, turn_rad=(0, 0),
                            seed=subject.seed, frames=HELD_FRAMES))  # fmt: skip
        for index, moment in enumerate(moments):
            image, depth_m = take(moment, index, camera)
            assert depth_m is not None
            hands = detector.detect(image)
            for name, finder in zip(MODES, finders, strict=True):
                mono[name].append(finder.measure(hands[0], detector.now_ns) if hands else None)
                depth[name].append(readers[name].measure(depth_m, hands[0], detector.now_ns) if hands else None)
        zeros = [one.shown_m == 0 for one in depth["published"] if one]
        found[cm] = _Held(
            mono={name: _errors(row, moments) for name, row in mono.items()},
            depth={name: _errors(row, moments) for name, row in depth.items()},
            zero=mean(zeros),
        )
    return found


def _tilt_errors(detector: PoolDetector, turned: tuple[Subject, int]) -> tuple[FloatArray, FloatArray]:
    """Shown and safe errors of the robust finder over the distances, the hand detected anew at each.

    turned: a subject, and towards which of TILT_DIRECTIONS.
    """
    subject, direction = turned
    turn = tilted(TILT_RAD, direction * 2 * math.pi / TILT_DIRECTIONS)
    shown, safe = [], []
    for cm in TILT_DISTANCES_CM:
        detector.reset()
        moments = list(held("5", person=subject.person, lens=subject.lens, distance_m=cm / 100, turn_rad=turn,
                            seed=subject.seed, frames=HELD_FRAMES))  # fmt: skip
        (row,) = _measure(detector, [subject.finders()[1]], moments)
        shown.append(_errors(row, moments))
        safe.append(_errors(row, moments, safe=True))
    return np.concatenate(shown), np.concatenate(safe)


_Walked = tuple[list[float], list[list[Distance | None]]]  # true distances, m, and a list a finder


def _walk(detector: PoolDetector, subject: Subject) -> _Walked:
    """A walk with one of the gestures, the palm known by ruler: the safety property."""
    gesture = GESTURE_NAMES[(subject.seed - FIRST_WALK) % 12]
    moments = list(walk(gesture, person=subject.person, lens=subject.lens, seed=subject.seed, frames=WALK_FRAMES))
    return [moment.true_m for moment in moments], _measure(detector, subject.finders(), moments)


def _walk_figures(walked: list[_Walked]) -> dict[str, DistanceFigures]:
    true_m = np.concatenate([distances for distances, _ in walked])
    found = {}
    for number, name in enumerate(MODES):
        row = [one for _, rows in walked for one in rows[number]]
        found[name] = figures(true_m, values(row, "shown_m"), values(row, "safe_m"))
    return found


def _row(cm: int, hands: list[_Held]) -> Table5Row:
    each = [_mean(one.mono["robust"]) for one in hands]
    return Table5Row(
        distance_cm=cm,
        mono_percent={name: _mean(np.concatenate([one.mono[name] for one in hands])) for name in MODES},
        worst_percent=max(each, key=lambda percent: -1.0 if math.isnan(percent) else abs(percent)),
        depth_percent={name: _mean(np.concatenate([one.depth[name] for one in hands])) for name in MODES},
        depth_zero=mean(one.zero for one in hands if one.zero is not None),
    )


def _tilt_row(number: int, pairs: list[tuple[FloatArray, FloatArray]]) -> TiltRow:
    shown = np.concatenate([pair[0] for pair in pairs])
    safe = np.concatenate([pair[1] for pair in pairs])
    measured = np.isfinite(shown)
    return TiltRow(
        direction_deg=number * 360 // TILT_DIRECTIONS,
        mean_percent=_mean(shown),
        median_percent=100 * float(np.median(np.abs(shown[measured]))) if measured.any() else math.nan,
        p95_percent=100 * float(np.percentile(np.abs(shown[measured]), 95)) if measured.any() else math.nan,
        near_3=float(np.mean(safe[measured] < -0.03)) if measured.any() else math.nan,
    )


def _errors(row: list[Distance | None], moments: list[Moment], *, safe: bool = False) -> FloatArray:
    true_m = np.array([moment.true_m for moment in moments])
    errors: FloatArray = values(row, "safe_m" if safe else "shown_m") / true_m - 1
    return errors


def _mean(errors: FloatArray) -> float:
    measured = errors[np.isfinite(errors)]
    return 100 * float(measured.mean()) if len(measured) else math.nan
