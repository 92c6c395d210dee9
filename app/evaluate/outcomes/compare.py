"""Outcome measures of simulated patients beside MuJoCo's truth: errors by case and measure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from msgspec import to_builtins
from rich.table import Table

from app.evaluate.harness import Step, table
from app.evaluate.outcomes.truth import true_measures
from app.evaluate.outcomes.walks import RecordedWalk, Walk
from app.motion.plan import patient_of
from app.outcomes.measures import Measures, measure
from app.outcomes.recorded import history_of, read_legs
from app.text.catalogue import tr
from hal.joints.device import Exoskeleton
from profiles.schema import GaitParameters, Profile, Sex

LIMIT = 1.0  # per cent, and percentage points of an asymmetry, which is itself a share
RELATIVE = (
    "distance_m",
    "walking_time_s",
    "up_time_s",
    "speed_m_s",
    "cadence_steps_min",
    "step_length_left_m",
    "step_length_right_m",
    "step_time_left_s",
    "step_time_right_s",
)
IN_POINTS = ("step_length_asymmetry_percent", "step_time_asymmetry_percent")
RANGE = "range_of_motion"  # of the joint that is worst


@dataclass(frozen=True, slots=True)
class Case:
    """One simulated patient on one walk."""

    name: str
    profile: Profile
    walk: Walk


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """What was measured, what was true, and the errors: per cent, of asymmetries percentage points."""

    case: Case
    measured: Measures
    true: Measures
    errors: dict[str, float]

    @property
    def passed(self) -> bool:
        """Every measure within LIMIT, and no step too many or too few."""
        return self.measured.steps == self.true.steps and max(map(abs, self.errors.values())) <= LIMIT

    def as_json(self) -> dict[str, Any]:
        """Case, both sets of measures, errors."""
        return {
            "case": self.case.name,
            "measured": to_builtins(self.measured),
            "true": to_builtins(self.true),
            "errors": self.errors,
            "passed": self.passed,
        }


def _patient(stature_m: float, mass_kg: float, **more: Any) -> Profile:
    return Profile(identifier="simulated", sex=Sex.FEMALE, stature_m=stature_m, mass_kg=mass_kg, **more)


_SHORT_LEFT = Walk(steps=7, length_m=(0.22, 0.34), time_s=(2.6, 2.0))
_LONG_LEFT = Walk(steps=7, length_m=(0.30, 0.20), time_s=(2.2, 2.6))
CASES = (
    Case("1.70 m", _patient(1.70, 65.0), Walk(strides=4)),
    Case("1.50 m", _patient(1.50, 48.0, gait=GaitParameters(step_length_m=0.22)), Walk(strides=4)),
    Case("1.90 m", _patient(1.90, 95.0, gait=GaitParameters(step_length_m=0.36)), Walk(strides=3)),
    Case("long thighs", _patient(1.75, 70.0, thigh_length_m=0.46, shank_length_m=0.40), Walk(strides=3)),
    Case("slow", _patient(1.65, 60.0, gait=GaitParameters(step_time_s=3.0)), Walk(strides=2)),
    Case("sits, rises, walks", _patient(1.70, 65.0), Walk(strides=2, sits=True)),
    Case("short left steps", _patient(1.70, 65.0), _SHORT_LEFT),
    Case("long left steps", _patient(1.60, 58.0), _LONG_LEFT),
)
_SHOWN = {
    "long thighs": "evaluate.case.long-thighs",
    "slow": "evaluate.case.slow",
    "sits, rises, walks": "evaluate.case.sits-and-walks",
    "short left steps": "evaluate.case.short-left-steps",
    "long left steps": "evaluate.case.long-left-steps",
}


def compare(cases: Iterable[Case], device: Exoskeleton, step: Step = lambda: None) -> list[Compared]:
    """Each case simulated, recorded, read and measured. Raises AppError for one that can't be walked."""
    found = []
    for case in cases:
        patient = patient_of(case.profile, device)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "walk.mcap"
            true = true_measures(RecordedWalk(patient, device, path).perform(case.walk))
            history = history_of(read_legs(path), patient.body)
        assert history is not None
        measured = measure(history)
        found.append(Compared(case=case, measured=measured, true=true, errors=errors_of(measured, true)))
        step()
    return found


def errors_table(found: Sequence[Compared]) -> Table:
    """Per cent, case by case."""
    rows = [
        [
            _shown(one.case),
            f"{one.measured.steps}/{one.true.steps}",
            *(f"{one.errors[name]:+.2f}" for name in (*RELATIVE, *IN_POINTS, RANGE)),
        ]
        for one in found
    ]
    columns = (
        "outcomes.case outcomes.steps outcomes.distance outcomes.walking outcomes.up outcomes.speed outcomes.cadence "
        "outcomes.length-l outcomes.length-r outcomes.time-l outcomes.time-r outcomes.length-sym outcomes.time-sym "
        "outcomes.range"
    )
    return table("outcomes.title", columns, rows, caption="outcomes.caption")


def _shown(case: Case) -> str:
    """Of one who differs in more than stature; the others' are a figure."""
    key = _SHOWN.get(case.name)
    return case.name if key is None else tr(key)


def errors_of(measured: Measures, true: Measures) -> dict[str, float]:
    """By measure, per cent, of asymmetries percentage points; endless, beyond any limit, where only one side has it."""
    errors = {name: _percent(getattr(measured, name), getattr(true, name)) for name in RELATIVE}
    errors |= {name: _difference(getattr(measured, name), getattr(true, name)) for name in IN_POINTS}
    ranges = [_percent(_range_deg(measured, joint), known.range_deg) for joint, known in true.range_of_motion.items()]
    return errors | {RANGE: max(ranges, key=abs, default=inf)}


def _percent(measured: float | None, true: float | None) -> float:
    if measured is None or not true:
        return 0.0 if measured == true else inf
    return 100 * (measured / true - 1)


def _difference(measured: float | None, true: float | None) -> float:
    if measured is None or true is None:
        return 0.0 if measured == true else inf
    return measured - true


def _range_deg(measures: Measures, joint: str) -> float | None:
    found = measures.range_of_motion.get(joint)
    return None if found is None else found.range_deg
