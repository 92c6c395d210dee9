"""The hand's surface and where the camera's rays meet it: a smooth union of rounded cones (capsules) between joints.

Radii are in millimetres for the reference palm of 82 mm and scale with it; finger breadths are near the adult medians
of ANSUR II (index finger about 19 mm at the PIP joint). Exact for each cone (a quadratic, three of them with the two
round ends), smooth where cones meet: depths are joined by a soft minimum, on a coarse grid over the hand's part of the
image only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.skeleton import FloatArray, HandShape

# (from, to, radius at from, radius at to), joints numbered as keypoints; 21 and up are the helpers below.
_FINGERS = (
    (5, 6, 11.4, 9.8), (6, 7, 9.7, 8.5), (7, 8, 8.5, 7.0),
    (9, 10, 11.4, 10.0), (10, 11, 9.9, 8.7), (11, 12, 8.7, 7.2),
    (13, 14, 11.0, 9.4), (14, 15, 9.3, 8.2), (15, 16, 8.2, 6.8),
    (17, 18, 10.2, 8.5), (18, 19, 8.4, 7.3), (19, 20, 7.3, 6.1),
)  # fmt: skip
_THUMB = ((1, 2, 15.0, 12.0), (2, 3, 11.4, 10.2), (3, 4, 10.2, 7.8))
_PALM = (
    (0, 5, 15.0, 12.4), (0, 9, 15.0, 12.6), (21, 13, 15.0, 12.2), (21, 17, 15.5, 11.6),
    (5, 9, 12.0, 12.2), (9, 13, 12.2, 11.8), (13, 17, 11.8, 10.8),
    (21, 23, 16.0, 14.5), (23, 17, 14.5, 11.0),
    (26, 22, 15.0, 10.0), (26, 2, 15.5, 12.0), (22, 2, 9.0, 9.5), (26, 0, 15.0, 15.0), (22, 5, 10.0, 11.0),
)  # fmt: skip
_FOREARM = ((26, 24, 15.5, 22.0), (21, 24, 16.0, 22.0), (0, 24, 18.0, 25.0), (24, 25, 26.0, 40.0))
CONES = (*_FINGERS, *_THUMB, *_PALM, *_FOREARM)
_FROM = np.array([cone[0] for cone in CONES])
_TO = np.array([cone[1] for cone in CONES])
_RADII_M = np.array([cone[2:] for cone in CONES]) / 1000
_ROUND_START = ~np.isin(_FROM, _TO)
_FOREARM_M = (0.045, 0.30)  # along the forearm from the wrist: where it has become round, and where we end it


@dataclass(frozen=True, slots=True)
class Capsules:
    """n rounded cones. a, b: (n, 3) axis ends; radius_a, radius_b: (n,), metres.

    round_start: (n,) whether end a needs a ball of its own; where another cone ends there, it has one already.
    """

    a: FloatArray
    b: FloatArray
    radius_a: FloatArray
    radius_b: FloatArray
    round_start: NDArray[np.bool_]


def capsules_of(joints: FloatArray, shape: HandShape) -> Capsules:
    """The cones around (21, 3) joints, in whichever frame the joints are."""
    points = np.vstack([joints, _helpers(joints, shape)])
    radii = _RADII_M * shape.scale
    return Capsules(points[_FROM], points[_TO], radii[:, 0], radii[:, 1], _ROUND_START)


def _helpers(joints: FloatArray, shape: HandShape) -> FloatArray:
    """21: heel below the pinky; 22: web of the thumb; 23: outer palm; 24, 25: forearm; 26: heel below the thumb."""
    wrist, middle, pinky = joints[0], joints[9], joints[17]
    across, along = joints[17] - joints[5], middle - wrist
    heel = wrist + 0.27 * across + 0.06 * along
    web = 0.40 * joints[2] + 0.30 * joints[5] + 0.30 * joints[1]
    outer = 0.50 * heel + 0.50 * pinky + 0.06 * across
    thenar = 0.60 * joints[1] + 0.40 * wrist - 0.08 * across
    near, far = (wrist - along / np.linalg.norm(along) * length * shape.scale for length in _FOREARM_M)
    return np.stack([heel, web, outer, near, far, thenar])


Float32Array = NDArray[np.float32]

SOFTNESS_M = 0.0022  # of the union: the fillet between neighbouring cones
NOTHING_M = np.float32(np.inf)
NEAREST_M = 0.03  # a hand nearer than this touches the lens


def project_px(points_m: FloatArray, lens: Intrinsics) -> FloatArray:
    """(n, 3) points in the camera's frame to (n, 2) pixels; they may lie outside the image."""
    z = np.maximum(points_m[:, 2:3], 1e-6)
    return points_m[:, :2] / z * (lens.fx_px, lens.fy_px) + (lens.cx_px, lens.cy_px)


@dataclass(frozen=True, slots=True)
class Grid:
    """A coarse raster over the rectangle (left, top) - (left + width, top + height) of the image, pixels."""

    left: int
    top: int
    width: int
    height: int
    columns: int
    rows: int

    def rays(self, lens: Intrinsics) -> tuple[Float32Array, Float32Array]:
        """x (1, columns) and y (rows, 1) of the rays through the cells' centres; z is 1."""
        u = self.left + (np.arange(self.columns) + 0.5) * (self.width / self.columns) - 0.5
        v = self.top + (np.arange(self.rows) + 0.5) * (self.height / self.rows) - 0.5
        x = ((u - lens.cx_px) / lens.fx_px).astype(np.float32)
        y = ((v - lens.cy_px) / lens.fy_px).astype(np.float32)
        return x[None, :], y[:, None]

    def cells(self, points_m: FloatArray, lens: Intrinsics) -> FloatArray:
        """(n, 2) column and row, with fractions, of (n, 3) points in the camera's frame; they may lie outside."""
        inside_px = project_px(points_m, lens) - (self.left, self.top)
        return inside_px * (self.columns / self.width, self.rows / self.height)


_Cone = tuple[FloatArray, FloatArray, float, float, bool]  # of `Capsules`


def grid_over(capsules: Capsules, lens: Intrinsics, cells_per_m: float, distance_m: float) -> Grid | None:
    """The grid over all capsules that the image shows; None when it shows none of it."""
    low, high = _extent_px(capsules, lens)
    left, top = max(0, int(low[0])), max(0, int(low[1]))
    right, bottom = min(lens.width_px, int(high[0]) + 1), min(lens.height_px, int(high[1]) + 1)
    if right - left < 2 or bottom - top < 2:
        return None
    step_px = max(1.0, lens.fx_px / distance_m / cells_per_m)
    columns, rows = (max(2, round(size / step_px)) for size in (right - left, bottom - top))
    return Grid(left, top, right - left, bottom - top, columns, rows)


def cast(capsules: Capsules, grid: Grid, lens: Intrinsics) -> Float32Array:
    """Depth z of the surface, metres, (rows, columns) float32; infinite where the ray misses."""
    x, y = grid.rays(lens)
    weight = np.zeros((grid.rows, grid.columns), np.float32)
    reference = np.float32(np.min(np.minimum(capsules.a[:, 2], capsules.b[:, 2])))
    softness = np.float32(SOFTNESS_M)
    cones = zip(
        capsules.a,
        capsules.b,
        capsules.radius_a.tolist(),
        capsules.radius_b.tolist(),
        capsules.round_start.tolist(),
        strict=True,
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # rays that miss end as infinities
        for cone, (left, right, top, bottom) in zip(cones, _windows(capsules, x[0], y[:, 0]), strict=True):
            if right > left and bottom > top:
                depth = _meet(cone, x[:, left:right], y[top:bottom])
                weight[top:bottom, left:right] += np.exp((reference - depth) / softness)
        joined: Float32Array = reference - softness * np.log(weight)
    return joined


def _extent_px(capsules: Capsules, lens: Intrinsics) -> tuple[FloatArray, FloatArray]:
    centres = np.vstack([capsules.a, capsules.b])
    radii = np.concatenate([capsules.radius_a, capsules.radius_b])
    z = np.maximum(centres[:, 2], NEAREST_M)
    nearest = np.maximum(z - radii, NEAREST_M)
    focal = np.array([lens.fx_px, lens.fy_px])
    middle = centres[:, :2] / z[:, None] * focal + (lens.cx_px, lens.cy_px)
    reach = (radii / nearest)[:, None] * focal * 1.2
    return (middle - reach).min(axis=0), (middle + reach).max(axis=0)


def _windows(capsules: Capsules, x: Float32Array, y: Float32Array) -> list[tuple[int, int, int, int]]:
    """For each cone the cells that it can cover: left, right, top, bottom, between its ends and wider by its radii."""
    bounds = []
    for axis, rays in ((0, x), (1, y)):
        spans = [_span(capsules.a, capsules.radius_a, axis), _span(capsules.b, capsules.radius_b, axis)]
        bounds.append(np.searchsorted(rays, np.minimum(spans[0][0], spans[1][0])).tolist())
        bounds.append(np.searchsorted(rays, np.maximum(spans[0][1], spans[1][1])).tolist())
    return list(zip(*bounds, strict=True))


def _span(ends: FloatArray, radii: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    z = np.maximum(ends[:, 2], NEAREST_M)
    centre, reach = ends[:, axis] / z, 1.2 * radii / np.maximum(z - radii, NEAREST_M)
    return centre - reach, centre + reach


def _meet(cone: _Cone, x: Float32Array, y: Float32Array) -> Float32Array:
    """Depth of one rounded cone along rays (x, y, 1); infinite where they miss.

    A point p at height s along the axis lies on the slant where |p - a|² m0 - s² - (slant terms) vanishes, with
    m0 = |ba|² and the radius shrinking from a to b; that is a quadratic in depth. Beyond the slant's ends the
    surface is one of the two spheres.
    """
    a, b, radius_a, radius_b, round_start = cone
    axis = b - a
    shrink = radius_a - radius_b
    slant = np.float32(axis @ axis - shrink * shrink)
    if slant <= 0:  # one ball swallows the other
        inner = a if radius_a > radius_b else b
        return _meet_ball(inner, max(radius_a, radius_b), x, y)
    # float32 in the hand's metres keeps 0.01 mm at half a metre.
    along = np.float32(-(axis @ a) - radius_a * shrink)
    ray_axis = x * np.float32(axis[0]) + y * np.float32(axis[1]) + np.float32(axis[2])
    ray_a = -(x * np.float32(a[0]) + y * np.float32(a[1]) + np.float32(a[2]))
    ray_ray = x * x + y * y + np.float32(1.0)
    axis_a = float(-(axis @ a))
    k2 = slant * ray_ray - ray_axis * ray_axis
    k1 = slant * ray_a - along * ray_axis
    across = axis_a * axis_a - 2 * axis_a * shrink * radius_a + float(axis @ axis) * radius_a**2
    k0 = np.float32(float(slant) * float(a @ a) - across)
    inside = k1 * k1 - k0 * k2
    depth = (-np.sqrt(inside) - k1) / k2
    height = along + depth * ray_axis
    on_slant = (height > 0) & (height < slant)
    balls = _meet_ball(b, radius_b, x, y)
    if round_start:
        balls = np.minimum(balls, _meet_ball(a, radius_a, x, y))
    return np.where(on_slant, depth, balls)


def _meet_ball(centre: FloatArray, radius: float, x: Float32Array, y: Float32Array) -> Float32Array:
    ray_ray = x * x + y * y + np.float32(1.0)
    ray_centre = x * np.float32(centre[0]) + y * np.float32(centre[1]) + np.float32(centre[2])
    inside = ray_centre * ray_centre - ray_ray * np.float32(centre @ centre - radius * radius)
    depth = (ray_centre - np.sqrt(inside)) / ray_ray
    return np.where(inside >= 0, depth, NOTHING_M)
