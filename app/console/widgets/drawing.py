"""The step that a profile makes, to scale, in braille. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable

from app.console.widgets.canvas import Canvas
from profiles.anthropometry import limb_lengths
from profiles.schema import GaitParameters, Profile

Point = tuple[float, float]
Stroke = Callable[[Point, Point], None]

# A step: points in metres, x forward, y up.
VIEW_M = 2.0  # across
FOOT_M = 0.16


def draw_step(profile: Profile, columns: int, rows: int) -> str:
    """The level step on the left; stair, obstacle and chair to scale on the right."""
    canvas = Canvas(columns, rows)
    limbs = limb_lengths(profile.stature_m)
    thigh_m, shank_m = profile.thigh_length_m or limbs.thigh_m, profile.shank_length_m or limbs.shank_m
    scale = min(canvas.width / VIEW_M, canvas.height / (1.12 * (thigh_m + shank_m)))

    def line(a: Point, b: Point) -> None:
        canvas.line(
            round(a[0] * scale),
            canvas.height - 1 - round(a[1] * scale),
            round(b[0] * scale),
            canvas.height - 1 - round(b[1] * scale),
        )

    gait = profile.gait
    line((0.0, 0.0), (canvas.width / scale, 0.0))
    _legs(line, gait, thigh_m, shank_m)
    x = 0.95
    _box(line, x, gait.stair_rise_m, gait.stair_tread_m)
    _box(line, x + gait.stair_tread_m, 2 * gait.stair_rise_m, gait.stair_tread_m)
    x += 2 * gait.stair_tread_m + 0.12
    _box(line, x, gait.obstacle_height_m, gait.obstacle_depth_m)
    return canvas.plain()


def _legs(line: Stroke, gait: GaitParameters, thigh: float, shank: float) -> None:
    step = gait.step_length_m
    back, front = 0.08, 0.08 + step
    hip = ((back + front) / 2, math.sqrt(max(0.05, (0.99 * (thigh + shank)) ** 2 - (step / 2) ** 2)))
    for foot in (back, front):
        knee = _knee(hip, (foot, 0.0), thigh, shank)
        line(hip, knee)
        line(knee, (foot, 0.0))
        line((foot, 0.01), (foot + FOOT_M * 0.6, 0.01))
    previous = (back, 0.0)
    for index in range(1, 17):
        share = index / 16
        here = (back + step * share, gait.swing_clearance_m * math.sin(math.pi * share))
        if index % 2:
            line(previous, here)
        previous = here


def _knee(hip: Point, ankle: Point, thigh: float, shank: float) -> Point:
    dx, dy = ankle[0] - hip[0], ankle[1] - hip[1]
    reach = min(math.hypot(dx, dy), 0.999 * (thigh + shank))
    along = (thigh**2 - shank**2 + reach**2) / (2 * reach)
    out = math.sqrt(max(0.0, thigh**2 - along**2))
    ux, uy = dx / reach, dy / reach
    return hip[0] + ux * along - uy * out, hip[1] + uy * along + ux * out


def _box(line: Stroke, x: float, height: float, depth: float) -> None:
    line((x, 0.0), (x, height))
    line((x, height), (x + depth, height))
    line((x + depth, height), (x + depth, 0.0))
