"""The wearer from the side, drawn from the measured joints: legs, trunk, floor, and what stands around. Pure.

Metres, x forward, z up from the floor under the feet where the action began (app/motion/wearer.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, isfinite, radians, sin
from typing import TYPE_CHECKING

from app.console.widgets.canvas import Canvas
from app.console.widgets.panel import Lines, cells
from app.motion.wearer import HIPS, LEFT, RIGHT, Point, Pose, sole_point, surface_m
from app.text.catalogue import tr
from hal.joints.device import Joint
from hal.joints.scene import LEVEL_FLOOR, BlockKind, Scene

if TYPE_CHECKING:
    from hal.joints.body import Body

TRUNK, HEAD = 0.29, 0.065  # shares of the stature: hip to shoulder, and the head's radius
TICK_M = 0.25  # of the floor
DEEP_DOTS = 64  # with fewer rows of dots the trunk is cut short, so that the legs stay large
LIVE, SWINGING, GHOST, GROUND = "bold $primary", "$foreground", "$foreground-muted", "$secondary"
# Share of the joint's greatest torque: shape and colour.
TORQUES = ((0.7, "●", "bold $error"), (0.35, "◐", "bold $warning"), (0.0, "○", "$success"))


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What is to be drawn."""

    body: Body
    pose: Pose
    ghost: Pose | None = None
    scene: Scene = LEVEL_FLOOR
    torque: tuple[float, ...] = (0.0,) * 4  # shares of each joint's greatest
    alarm: tuple[bool, ...] = (False,) * 4  # joints that report a fault, or nothing


def draw(view: View, columns: int, rows: int) -> Lines:
    """The figure in so many cells; the last row names the feet, strong where they carry."""
    if columns < 8 or rows < 4:
        return ()
    canvas = Canvas(columns, rows)
    drawing = _Drawing(canvas, view)
    drawing.ground()
    if view.ghost is not None:
        drawing.legs(view.ghost, ghost=True)
    drawing.trunk()
    drawing.legs(view.pose, ghost=False)
    drawing.joints()
    drawing.feet()
    return canvas.lines()


class _Drawing:
    """Metres to dots, and the parts of the picture."""

    def __init__(self, canvas: Canvas, view: View) -> None:
        self._canvas = canvas
        self._view = view
        stature_m = view.body.stature_m
        self._whole = canvas.height >= DEEP_DOTS
        tall_m = stature_m * (1.02 if self._whole else 0.72) + 0.10
        ground = canvas.height - 6  # the row of names, and the floor's line over it
        self._scale = min(ground / tall_m, canvas.width / 1.3)
        low_m = min(0.0, view.scene.floor_m)
        self._bottom = ground + low_m * self._scale
        self._left_m = view.pose.hip[0] - canvas.width / self._scale / 2

    def ground(self) -> None:
        """Floor with its marks, stair, obstacle, chair."""
        canvas, scene = self._canvas, self._view.scene
        canvas.pen = GROUND
        if any(block.kind is not BlockKind.CHAIR for block in scene.blocks):
            heights_m = (surface_m(scene, self._left_m + x / self._scale) for x in range(canvas.width))
            tops = [round(self._at((0.0, height_m))[1]) for height_m in heights_m]
            for x, y in enumerate(tops):
                canvas.line(x, y, x, tops[max(0, x - 1)])
        else:
            self._line((self._left_m, 0.0), (self._left_m + canvas.width / self._scale, 0.0))
        first = int(self._left_m / TICK_M) - 1
        for count in range(first, first + int(canvas.width / self._scale / TICK_M) + 3):
            mark_x, mark_y = self._at((count * TICK_M, surface_m(scene, count * TICK_M)))
            canvas.line(mark_x, mark_y, mark_x - 1, mark_y + 2)
        for block in scene.blocks:
            if block.kind is BlockKind.CHAIR:
                self._line((block.from_x_m, block.top_m), (block.to_x_m, block.top_m))
                self._line((block.to_x_m, block.top_m), (block.to_x_m, 0.0))
                self._line((block.from_x_m, 2 * block.top_m), (block.from_x_m, 0.0))

    def legs(self, pose: Pose, *, ghost: bool) -> None:
        """Both legs; a ghost dotted and dim, a leg that carries three dots thick."""
        canvas, body = self._canvas, self._view.body
        for side in sorted((LEFT, RIGHT), key=lambda side: pose.carries[side]):
            knee, ankle, pitch = pose.knees[side], pose.ankles[side], pose.pitch_rad[side]
            heel, toe = (sole_point(ankle, along, body.ankle_height_m, pitch) for along in (-body.heel_m, body.toe_m))
            canvas.pen = GHOST if ghost else LIVE if pose.carries[side] else SWINGING
            for a, b in ((pose.hip, knee), (knee, ankle)):
                self._line(a, b, bold=pose.carries[side] and not ghost, every=3 if ghost else 1)
            for a, b in ((ankle, heel), (heel, toe), (toe, ankle)):
                self._line(a, b, every=2 if ghost else 1)

    def trunk(self) -> None:
        """From the hip up; with a head where there is room."""
        pose, stature_m = self._view.pose, self._view.body.stature_m
        along = (sin(pose.lean_rad), cos(pose.lean_rad))
        self._canvas.pen = SWINGING
        top = TRUNK if self._whole else 0.5 * TRUNK
        shoulder = (pose.hip[0] + top * stature_m * along[0], pose.hip[1] + top * stature_m * along[1])
        self._line(pose.hip, shoulder, bold=True)
        if self._whole:
            radius = HEAD * stature_m
            up = top * stature_m + 1.5 * radius
            centre = (pose.hip[0] + up * along[0], pose.hip[1] + up * along[1])
            for step in range(24):
                turn = radians(15 * step)
                x, y = self._at((centre[0] + radius * cos(turn), centre[1] + radius * sin(turn)))
                self._canvas.dot(round(x), round(y))

    def joints(self) -> None:
        """A mark at each joint: its torque by shape and colour; `!` where a joint reports a fault or nothing."""
        pose = self._view.pose
        shown: dict[tuple[int, int], tuple[float, str, str]] = {}
        for joint in Joint:
            share = self._view.torque[joint] if isfinite(self._view.torque[joint]) else 0.0
            side = joint // 2
            place = pose.hip if joint in HIPS else pose.knees[side]
            x, y = self._at(place)
            cell = (round(x) // 2, round(y) // 4)
            level = next(level for level in TORQUES if share >= level[0])
            if self._view.alarm[joint]:
                level = (2.0, "!", "bold reverse $error")
            if cell not in shown or level[0] > shown[cell][0]:  # the stronger of two in one place
                shown[cell] = level
        for (column, row), (_, mark, style) in shown.items():
            self._canvas.text(column, row, mark, style)

    def feet(self) -> None:
        """`L` and `R` under the feet: reversed where a foot carries."""
        pose, body = self._view.pose, self._view.body
        names = (tr("figure.left"), tr("figure.right"))
        columns = [round(self._at((ankle[0] + body.toe_m / 2, 0.0))[0]) // 2 for ankle in pose.ankles]
        first, second = sorted((LEFT, RIGHT), key=lambda side: columns[side])
        wide = cells(names[first]) + 2
        columns[second] = max(columns[second], columns[first] + wide)
        for side in (LEFT, RIGHT):
            style = "bold reverse $primary" if pose.carries[side] else "$foreground-muted"
            self._canvas.text(columns[side], self._canvas.rows - 1, f" {names[side]} ", style)

    def _at(self, point: Point) -> tuple[float, float]:
        return (point[0] - self._left_m) * self._scale, self._bottom - point[1] * self._scale

    def _line(self, a: Point, b: Point, *, bold: bool = False, every: int = 1) -> None:
        (x0, y0), (x1, y1) = self._at(a), self._at(b)
        if bold:
            self._canvas.bold_line(x0, y0, x1, y1)
        else:
            self._canvas.line(x0, y0, x1, y1, every=every)
