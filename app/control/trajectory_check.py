"""A whole path against the patient and the device: reach, ranges, speed, torque, clearance; refusals with numbers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from app.control.patient import Patient
from app.control.plan import PlanCheck
from app.control.trajectory_curves import Array
from app.control.trajectory_outline import LEFT, RIGHT, Path, clearances
from app.messages import Quad
from hal.joints.joints import Joint

LEAST_CLEARANCE_M = 0.02
NOT_SWINGING_M = 1.0  # clearance that is told of a movement without a swing


def check_path(patient: Patient, path: Path, velocity_rad_s: Array, torque_nm: Array) -> PlanCheck:
    """Everything about a path; (n, 4) velocity and torque. `reason` holds the first thing that is wrong."""
    if np.isnan(path.joints_rad).any():
        return refusal(_reach(path))
    clearance = mid_swing_clearance(patient, path)
    speed, torque = np.abs(velocity_rad_s).max(axis=0), np.abs(torque_nm).max(axis=0)
    reason = next(_objections(patient, path, speed, torque, clearance), "")
    return PlanCheck(
        ok=not reason,
        reason=reason,
        peak_speed_rad_s=_quad(speed),
        peak_torque_nm=_quad(torque),
        min_clearance_m=clearance,
    )


def refusal(reason: str) -> PlanCheck:
    """A check that failed before there was a path."""
    nothing = (0.0, 0.0, 0.0, 0.0)
    return PlanCheck(ok=False, reason=reason, peak_speed_rad_s=nothing, peak_torque_nm=nothing, min_clearance_m=0.0)


def mid_swing_clearance(patient: Patient, path: Path) -> float:
    """The least distance of a foot in mid-swing from floor and scene, metres."""
    least = NOT_SWINGING_M
    for side in (LEFT, RIGHT):
        over = path.feet[side].mid_swing
        if over.any():
            least = min(least, float(clearances(patient.body, path, side)[over].min()))
    return least


def _objections(patient: Patient, path: Path, speed: Array, torque: Array, clearance: float) -> Iterator[str]:
    lowest, highest = path.joints_rad.min(axis=0), path.joints_rad.max(axis=0)
    for joint in Joint:
        name = joint.name.lower().replace("_", " ")
        if highest[joint] > patient.high_rad[joint]:
            yield _degrees(f"The {name} would have to bend to", highest[joint], patient.high_rad[joint])
        if lowest[joint] < patient.low_rad[joint]:
            yield _degrees(f"The {name} would have to stretch to", lowest[joint], patient.low_rad[joint])
        if speed[joint] > patient.speed_rad_s[joint]:
            yield _degrees(f"The {name} would turn at", speed[joint], patient.speed_rad_s[joint], "°/s")
        if torque[joint] > patient.torque_nm[joint]:
            yield (
                f"The {name} would need {torque[joint]:.0f} Nm, its limit is {patient.torque_nm[joint]:.0f} Nm; "
                "more body-weight support or a smaller movement lowers it."
            )
    if clearance < LEAST_CLEARANCE_M:
        yield f"A foot would pass at {100 * clearance:.1f} cm, at least {100 * LEAST_CLEARANCE_M:.0f} cm are needed."


def _degrees(what: str, value: float, limit: float, unit: str = "°") -> str:
    return f"{what} {np.degrees(value):.0f}{unit}, its limit is {np.degrees(limit):.0f}{unit}."


def _reach(path: Path) -> str:
    lost = np.isnan(path.joints_rad)
    side = "left" if lost[:, 1].any() else "right"
    share = np.argmax(lost.any(axis=1)) / len(lost)
    return f"The {side} leg is too short for this movement ({100 * share:.0f} % into it); shorten the step or lower it."


def _quad(values: Array) -> Quad:
    return (float(values[0]), float(values[1]), float(values[2]), float(values[3]))
