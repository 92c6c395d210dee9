"""A rehearsal as pictures: angles, torques and foot paths as PNG, a stick figure as a film."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import cos, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.evaluate.simulate import Norm, gait_cycle
from app.motion.rehearsal import TRUTH_TICKS, Rehearsal
from app.system.errors import AppError
from hal.joints.body import TRUNK_COM_OF_STATURE, Body
from hal.joints.protocol import TICK_HZ, Joint
from hal.joints.simulated.wearer import Truth

WIDTH_PX, HEIGHT_PX = 960, 640
PX_M = 260.0
FILM_FPS = TICK_HZ // TRUTH_TICKS // 4  # every fourth look
PAPER, FLOOR, TRUNK = (250, 248, 245), (120, 120, 120), (70, 60, 50)
LEGS = ((200, 120, 30), (30, 90, 220))  # left, right; blue, green, red
BLOCK = (190, 200, 205)


def plot(rehearsal: Rehearsal, file: Path, norm: Norm | None = None) -> None:
    """Angles against targets (with the normative band beside them), torques, paths of the ankles. Raises AppError."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 9), layout="constrained")
    FigureCanvasAgg(figure)
    angles, torques, paths = figure.subplots(3, 1)
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
        paths.plot(ankle[:, 0], ankle[:, 1], label=f"{name} ankle")
    paths.plot([t.hip_x_m for t in rehearsal.truths], [t.hip_z_m for t in rehearsal.truths], color="grey", label="hip")
    for axes, title in ((angles, "degrees (dotted: target)"), (torques, "Nm (grey: limit)"), (paths, "metres")):
        axes.set_ylabel(title)
        axes.legend(loc="upper right", fontsize=8)
        axes.grid(alpha=0.3)
    figure.suptitle(f"{rehearsal.verdict.action.value}: " + ("passed" if rehearsal.verdict.passed else "failed"))
    try:
        figure.savefig(file, dpi=110)
    except (OSError, ValueError) as error:
        raise AppError(f"The picture {file} can't be written: {error}; choose another place.") from error


def film(rehearsal: Rehearsal, body: Body, file: Path, watch: Callable[[], None] = lambda: None) -> None:
    """The wearer as a stick figure, in real time, MP4. Raises AppError when it can't be written."""
    import cv2

    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), FILM_FPS, (WIDTH_PX, HEIGHT_PX))
    if not writer.isOpened():
        raise AppError(f"The film {file} can't be written; choose a name that ends in .mp4 in a folder that exists.")
    first = rehearsal.truths[0]
    for truth in rehearsal.truths[:: TICK_HZ // TRUTH_TICKS // FILM_FPS]:
        writer.write(_frame(rehearsal, body, first, truth))
        watch()
    writer.release()


def _band(axes: object, rehearsal: Rehearsal, norm: Norm) -> None:
    cycle = gait_cycle(rehearsal, norm.percent)
    inset = axes.inset_axes((0.02, 0.05, 0.30, 0.55))  # type: ignore[attr-defined]
    for name, colour in (("hip", "C2"), ("knee", "C3")):
        mean, sd = norm.mean_deg[name], norm.sd_deg[name]
        inset.fill_between(norm.percent, mean - sd, mean + sd, color=colour, alpha=0.2)
        inset.plot(norm.percent, cycle[name], color=colour, label=name)
    inset.set_title("gait cycle and normative band", fontsize=8)
    inset.tick_params(labelsize=7)


def _frame(rehearsal: Rehearsal, body: Body, first: Truth, truth: Truth) -> NDArray[np.uint8]:
    import cv2

    picture = np.full((HEIGHT_PX, WIDTH_PX, 3), PAPER, dtype=np.uint8)
    view_x = truth.hip_x_m
    ground = float(first.ankle_m[:, 1].min()) - body.ankle_height_m

    def at(x: float, z: float) -> tuple[int, int]:
        return round(WIDTH_PX / 2 + (x - view_x) * PX_M), round(HEIGHT_PX - 110 - (z - ground) * PX_M)

    floor = ground + rehearsal.scene.floor_m
    cv2.line(picture, at(view_x - 3, floor), at(view_x + 3, floor), FLOOR, 2)
    here = float(first.ankle_m[:, 0].mean())
    for block in rehearsal.scene.blocks:
        low, high = at(here + block.from_x_m, floor), at(here + block.to_x_m, ground + block.top_m)
        cv2.rectangle(picture, low, high, BLOCK, -1)
        cv2.rectangle(picture, low, high, FLOOR, 1)
    for side in (0, 1):
        points = [at(*point) for point in _leg(body, truth, side)]
        for start, end in pairwise(points):
            cv2.line(picture, start, end, LEGS[side], 7, cv2.LINE_AA)
    hip = np.array([truth.hip_x_m, truth.hip_z_m])
    shoulder = hip + 1.6 * TRUNK_COM_OF_STATURE * body.stature_m * np.array([sin(truth.lean_rad), cos(truth.lean_rad)])
    cv2.line(picture, at(*hip), at(*shoulder), TRUNK, 9, cv2.LINE_AA)
    head = shoulder + 0.12 * body.stature_m * np.array([sin(truth.lean_rad), cos(truth.lean_rad)])
    cv2.circle(picture, at(*head), round(0.06 * body.stature_m * PX_M), TRUNK, -1, cv2.LINE_AA)
    caption = f"{rehearsal.verdict.action.value}  {truth.time_s:5.2f} s"
    cv2.putText(picture, caption, (20, 36), cv2.FONT_HERSHEY_SIMPLEX, 0.8, TRUNK, 2, cv2.LINE_AA)
    return picture


def _leg(body: Body, truth: Truth, side: int) -> list[tuple[float, float]]:
    """Hip, knee, ankle, heel, toe."""
    from app.motion import kinematics

    thigh = float(truth.joints_rad[2 * side]) - truth.lean_rad
    shank = thigh - float(truth.joints_rad[2 * side + 1])
    knee = (truth.hip_x_m + body.thigh_m * sin(thigh), truth.hip_z_m - body.thigh_m * cos(thigh))
    ankle = (float(truth.ankle_m[side][0]), float(truth.ankle_m[side][1]))
    heel, toe = kinematics.sole(body, np.array(shank + float(truth.ankle_rad[side])))
    sole = [(ankle[0] + float(point[0]), ankle[1] + float(point[1])) for point in (heel, toe)]
    return [(truth.hip_x_m, truth.hip_z_m), knee, ankle, *sole]
