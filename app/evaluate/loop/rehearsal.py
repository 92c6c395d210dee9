"""Rehearsed actions in figures: a patient, or the corners of stature and mass; walking beside the norm; plot, film."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from math import cos, sin
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from app.evaluate.harness import EvaluateFault, Step, figure, table
from app.ipc.states import Action
from app.motion import kinematics
from app.motion.plan import patient_of
from app.motion.rehearsal import TRUTH_TICKS, Rehearsal, rehearse
from app.motion.rehearsal_checks import RehearsalVerdict
from app.playback.film import write_film
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render, tr
from hal.joints.body import TRUNK_COM_OF_STATURE, Body
from hal.joints.device import Exoskeleton
from hal.joints.protocol import TICK_HZ, Joint
from hal.joints.simulated.wearer import GroundTruth
from logs.reading.arrays import check_finite
from logs.reading.errors import cause_of
from logs.reading.regular import read_text
from profiles.schema import GaitParameters, Profile, Sex

STATURES_M = (1.45, 1.95)
MASSES_KG = (45.0, 110.0)
NORM_FILE = "schwartz2008_hip_knee_ankle_sagittal.csv"
NORM_SPEED = "VerySlow"
WIDTH_PX, HEIGHT_PX = 960, 640
PX_M = 260.0
FILM_FPS = TICK_HZ // TRUTH_TICKS // 4  # every fourth sample
BACKGROUND, FLOOR, TRUNK = (250, 248, 245), (120, 120, 120), (70, 60, 50)
LEGS = ((200, 120, 30), (30, 90, 220))  # left, right; BGR
BLOCK = (190, 200, 205)

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


def corners(device: Exoskeleton, step: Step) -> list[tuple[Profile, RehearsalVerdict]]:
    """Every action at every corner."""
    found = []
    for profile in corner_profiles():
        patient = patient_of(profile, device)
        for action in Action:
            found.append((profile, rehearse(patient, device, action).verdict))
            step()
    return found


def verdict_table(rows: list[tuple[Profile, RehearsalVerdict]]) -> Table:
    """A row an action."""
    cells = [
        (
            profile.identifier,
            tr(verdict.action),
            tr("evaluate.rehearsal.passed") if verdict.passed else " ".join(map(render, verdict.reasons)),
            f"{max(verdict.tracking_rms_deg):.1f}",
            f"{max(verdict.peak_torque_nm):.0f} / {max(verdict.torque_limit_nm):.0f}",
            f"{max(verdict.peak_speed_deg_s):.0f}",
            "–" if verdict.clearance_m is None else f"{100 * verdict.clearance_m:.1f}",
            f"{100 * verdict.slide_m:.1f}",
            f"{verdict.contact_peak_n:.0f}",
            f"{verdict.temperature_c:.1f}",
        )
        for profile, verdict in rows
    ]
    columns = "patient action outcome rms_deg peak_nm peak_deg_s clearance_cm slide_cm load_n celsius"
    return table("rehearsal", columns, cells, left=10)


def read_norm(folder: Path) -> Norm:
    """The very slow band of a folder of normative curves. Raises AppError naming the file and what is wrong."""
    path = folder / NORM_FILE
    try:
        file = io.StringIO(read_text(path), newline="")
        rows = [row for row in csv.DictReader(file) if row["speed"] == NORM_SPEED]
        column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "speed"}
        check_finite(column)
        return Norm(
            percent=column["gait_pct"],
            mean_deg={"hip": column["hip_mean"], "knee": column["knee_mean"]},
            sd_deg={"hip": column["hip_sd"], "knee": column["knee_sd"]},
        )
    except (OSError, KeyError, ValueError, IndexError, TypeError, csv.Error) as error:
        detail = cause_of(error) if isinstance(error, OSError) else repr(error)
        raise AppError(EvaluateFault.NORM_UNREADABLE, file=path, detail=detail) from error


def gait_cycle(walk: Rehearsal, percent: Array) -> dict[str, Array]:
    """Measured right hip and knee over one cycle of a rehearsed walk, from landing to landing, degrees at `percent`."""
    first, last = walk.starts[2], walk.starts[4]  # the second step brings the right foot down, so does the fourth
    cycle = np.linspace(0, 100, last - first)
    angle = np.degrees(walk.angle_rad[first:last])
    return {
        "hip": np.interp(percent, cycle, angle[:, Joint.RIGHT_HIP]),
        "knee": np.interp(percent, cycle, angle[:, Joint.RIGHT_KNEE]),
    }


def correlation(walk: Rehearsal, norm: Norm) -> dict[str, float]:
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
        raise AppError(EvaluateFault.ACTION_UNKNOWN, name=name, names=names)
    return (Action[wanted],)


def profile_named(home: Home, name: str) -> Profile:
    """A patient of this home by identifier, the demo patient, or a profile file. Raises ProfileError."""
    from profiles.files import decode
    from profiles.files import read_text as read_profile
    from profiles.store import ProfileStore

    if name.endswith(".toml"):
        path = Path(name)
        return decode(read_profile(path), str(path))
    return ProfileStore(home.profiles).load(name)


def plot(rehearsal: Rehearsal, file: Path, norm: Norm | None = None) -> None:
    """Angles against targets (with the normative band beside them), torques, paths of the ankles. Raises AppError."""
    with figure(file, 3, size=(11, 9)) as (drawn, (angles, torques, paths)):
        time = np.arange(len(rehearsal.angle_rad)) / TICK_HZ
        for joint in Joint:
            name = joint.name.lower().replace("_", " ")
            (line,) = angles.plot(time, np.degrees(rehearsal.angle_rad[:, joint]), label=name)
            angles.plot(time, np.degrees(rehearsal.target_rad[:, joint]), ":", color=line.get_color())
            torques.plot(time, rehearsal.torque_nm[:, joint], color=line.get_color(), label=name)
        if norm is not None and len(rehearsal.starts) > 4:
            _band(angles, rehearsal, norm)
        limit = max(rehearsal.verdict.torque_limit_nm)
        torques.axhline(limit, color="grey", lw=0.8)
        torques.axhline(-limit, color="grey", lw=0.8)
        for side, name in enumerate(("left", "right")):
            ankle = np.array([truth.ankle_m[side] for truth in rehearsal.truths])
            paths.plot(ankle[:, 0], ankle[:, 1], label=tr(f"evaluate.plot.ankle_{name}"))
        hips = np.array([(truth.hip_x_m, truth.hip_z_m) for truth in rehearsal.truths])
        paths.plot(hips[:, 0], hips[:, 1], color="grey", label=tr("evaluate.plot.hip"))
        for axes, title in ((angles, "degrees"), (torques, "torque"), (paths, "metres")):
            axes.set_ylabel(tr(f"evaluate.plot.{title}"))
            axes.legend(loc="upper right", fontsize=8)
            axes.grid(alpha=0.3)
        outcome = tr("evaluate.rehearsal.passed" if rehearsal.verdict.passed else "evaluate.rehearsal.failed")
        drawn.suptitle(f"{rehearsal.verdict.action.value}: {outcome}")


def film(rehearsal: Rehearsal, body: Body, file: Path) -> None:
    """The wearer as a stick figure, in real time, MP4. Raises AppError when it can't be written."""
    first, shown = rehearsal.truths[0], rehearsal.truths[:: TICK_HZ // TRUTH_TICKS // FILM_FPS]
    images = (_frame(rehearsal, body, first, truth) for truth in shown)
    write_film(file, images, frames=len(shown), fps=FILM_FPS, size_px=(WIDTH_PX, HEIGHT_PX))


def _band(axes: Any, rehearsal: Rehearsal, norm: Norm) -> None:
    cycle = gait_cycle(rehearsal, norm.percent)
    inset = axes.inset_axes((0.02, 0.05, 0.30, 0.55))
    for name, colour in (("hip", "C2"), ("knee", "C3")):
        mean, sd = norm.mean_deg[name], norm.sd_deg[name]
        inset.fill_between(norm.percent, mean - sd, mean + sd, color=colour, alpha=0.2)
        inset.plot(norm.percent, cycle[name], color=colour, label=name)
    inset.set_title(tr("evaluate.plot.band"), fontsize=8)
    inset.tick_params(labelsize=7)


def _frame(rehearsal: Rehearsal, body: Body, first: GroundTruth, truth: GroundTruth) -> NDArray[np.uint8]:
    image = np.full((HEIGHT_PX, WIDTH_PX, 3), BACKGROUND, dtype=np.uint8)
    view_x = truth.hip_x_m
    ground = float(first.ankle_m[:, 1].min()) - body.ankle_height_m

    def at(x: float, z: float) -> tuple[int, int]:
        return round(WIDTH_PX / 2 + (x - view_x) * PX_M), round(HEIGHT_PX - 110 - (z - ground) * PX_M)

    floor = ground + rehearsal.scene.floor_m
    cv2.line(image, at(view_x - 3, floor), at(view_x + 3, floor), FLOOR, 2)
    here = float(first.ankle_m[:, 0].mean())
    for block in rehearsal.scene.blocks:
        low, high = at(here + block.from_x_m, floor), at(here + block.to_x_m, ground + block.top_m)
        cv2.rectangle(image, low, high, BLOCK, -1)
        cv2.rectangle(image, low, high, FLOOR, 1)
    for side in (0, 1):
        points = [at(*point) for point in _leg(body, truth, side)]
        for start, end in pairwise(points):
            cv2.line(image, start, end, LEGS[side], 7, cv2.LINE_AA)
    hip = np.array([truth.hip_x_m, truth.hip_z_m])
    shoulder = hip + 1.6 * TRUNK_COM_OF_STATURE * body.stature_m * np.array([sin(truth.lean_rad), cos(truth.lean_rad)])
    cv2.line(image, at(*hip), at(*shoulder), TRUNK, 9, cv2.LINE_AA)
    head = shoulder + 0.12 * body.stature_m * np.array([sin(truth.lean_rad), cos(truth.lean_rad)])
    cv2.circle(image, at(*head), round(0.06 * body.stature_m * PX_M), TRUNK, -1, cv2.LINE_AA)
    caption = f"{rehearsal.verdict.action.value}  {truth.time_s:5.2f} s"
    cv2.putText(image, caption, (20, 36), cv2.FONT_HERSHEY_SIMPLEX, 0.8, TRUNK, 2, cv2.LINE_AA)
    return image


def _leg(body: Body, truth: GroundTruth, side: int) -> list[tuple[float, float]]:
    """Hip, knee, ankle, heel, toe."""
    thigh = float(truth.joints_rad[2 * side]) - truth.lean_rad
    shank = thigh - float(truth.joints_rad[2 * side + 1])
    knee = (truth.hip_x_m + body.thigh_m * sin(thigh), truth.hip_z_m - body.thigh_m * cos(thigh))
    ankle = (float(truth.ankle_m[side][0]), float(truth.ankle_m[side][1]))
    heel, toe = kinematics.sole(body, np.array(shank + float(truth.ankle_rad[side])))
    sole = [(ankle[0] + float(point[0]), ankle[1] + float(point[1])) for point in (heel, toe)]
    return [(truth.hip_x_m, truth.hip_z_m), knee, ankle, *sole]
