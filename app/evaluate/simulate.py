"""Simulated actions as tables: one patient, all actions; the corners of stature and mass; level walking's likeness."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from app.ipc.states import Action
from app.motion.patient import patient_of
from app.motion.rehearsal import Rehearsal, rehearse
from app.motion.rehearsal_checks import RehearsalVerdict
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render
from hal.joints.device import Exoskeleton
from hal.joints.protocol import Joint
from profiles.schema import GaitParameters, Profile, Sex

STATURES_M = (1.45, 1.95)
MASSES_KG = (45.0, 110.0)
NORM_FILE = "schwartz2008_hip_knee_ankle_sagittal.csv"
NORM_SPEED = "VerySlow"

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Norm:
    """A normative band over the gait cycle: (n,) per cent and degrees, flexion positive."""

    percent: Array
    mean_deg: dict[str, Array]  # hip, knee
    sd_deg: dict[str, Array]


def corner_profiles() -> Iterator[Profile]:
    """The smallest and tallest, lightest and heaviest wearers, with the default gait."""
    for stature, mass in product(STATURES_M, MASSES_KG):
        yield Profile(
            identifier=f"corner-{100 * stature:.0f}-{mass:.0f}",
            sex=Sex.MALE,
            stature_m=stature,
            mass_kg=mass,
            gait=GaitParameters(),
        )


def corners(device: Exoskeleton, watch: Callable[[str], None]) -> list[tuple[Profile, RehearsalVerdict]]:
    """Every action at every corner."""
    found = []
    for profile in corner_profiles():
        patient = patient_of(profile, device)
        for action in Action:
            watch(f"{profile.identifier}: {action.value}")
            found.append((profile, rehearse(patient, device, action).verdict))
    return found


def verdict_table(rows: list[tuple[Profile, RehearsalVerdict]]) -> Table:
    """Figures for people."""
    table = Table("patient", "action", "", "rms °", "peak Nm", "peak °/s", "clearance cm", "slide cm", "load N", "°C")
    for profile, verdict in rows:
        table.add_row(
            profile.identifier,
            verdict.action.value,
            "passed" if verdict.passed else " ".join(map(render, verdict.reasons)),
            f"{max(verdict.tracking_rms_deg):.1f}",
            f"{max(verdict.peak_torque_nm):.0f} of {max(verdict.torque_limit_nm):.0f}",
            f"{max(verdict.peak_speed_deg_s):.0f}",
            "–" if verdict.clearance_m is None else f"{100 * verdict.clearance_m:.1f}",
            f"{100 * verdict.slide_m:.1f}",
            f"{verdict.contact_peak_n:.0f}",
            f"{verdict.temperature_c:.1f}",
        )
    return table


def read_norm(folder: Path) -> Norm:
    """The very slow band of a folder of normative curves. Raises AppError naming the file and what is wrong."""
    path = folder / NORM_FILE
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [row for row in csv.DictReader(file) if row["speed"] == NORM_SPEED]
        column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "speed"}
        return Norm(
            percent=column["gait_pct"],
            mean_deg={"hip": column["hip_mean"], "knee": column["knee_mean"]},
            sd_deg={"hip": column["hip_sd"], "knee": column["knee_sd"]},
        )
    except (OSError, KeyError, ValueError, IndexError) as error:
        raise AppError(
            f"No normative gait curves in {path}: {error!r}; give the folder that holds the file."
        ) from error


def gait_cycle(walk: Rehearsal, percent: Array) -> dict[str, Array]:
    """Measured right hip and knee over one cycle of a rehearsed walk, from landing to landing, degrees at `percent`."""
    first, last = walk.starts[2], walk.starts[4]  # the second step brings the right foot down, so does the fourth
    cycle = np.linspace(0, 100, last - first)
    angle = np.degrees(walk.angle_rad[first:last])
    return {
        "hip": np.interp(percent, cycle, angle[:, Joint.RIGHT_HIP]),
        "knee": np.interp(percent, cycle, angle[:, Joint.RIGHT_KNEE]),
    }


def likeness(walk: Rehearsal, norm: Norm) -> dict[str, float]:
    """Correlation of hip and knee with the band's mean over the gait cycle."""
    cycle = gait_cycle(walk, norm.percent)
    return {name: float(np.corrcoef(cycle[name], norm.mean_deg[name])[0, 1]) for name in ("hip", "knee")}


def actions_named(name: str) -> tuple[Action, ...]:
    """`all`, or the one action of that name. Raises AppError listing the names."""
    if name == "all":
        return tuple(Action)
    wanted = name.upper().replace("-", "_")
    if wanted not in Action.__members__:
        names = ", ".join(action.name.lower().replace("_", "-") for action in Action)
        raise AppError(f"There is no action {name}: choose all, corners, {names}.")
    return (Action[wanted],)


def profile_named(home: Home, name: str) -> Profile:
    """A patient of this home by identifier, the demo patient, or a profile file. Raises ProfileError."""
    from profiles.files import decode, read_text
    from profiles.schema import DEMO_PATIENT
    from profiles.store import ProfileStore

    if name.endswith(".toml"):
        path = Path(name)
        return decode(read_text(path), str(path))
    store = ProfileStore(home.profiles)
    if name == DEMO_PATIENT.identifier and not (home.profiles / f"{name}.toml").exists():
        return DEMO_PATIENT
    return store.load(name)
