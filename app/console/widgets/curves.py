"""Each joint's curve of the last step over its plan: angle against how much of the plan is done. Pure."""

from __future__ import annotations

from itertools import pairwise
from math import degrees, isfinite, isnan

from app.console.widgets.canvas import Canvas
from app.console.widgets.panel import Line, Lines, cells, fitted, plain
from app.ipc.snapshot import ControlSnapshot, JointSnapshot
from app.text.catalogue import render, tr
from hal.joints.device import Joint, JointDevice

SILENT_MS = 100.0  # a joint without feedback for so long is marked
LEAST_SPAN_DEG = 30.0  # of the scale, so that noise stays flat
MARGIN_DEG = 4.0
STEP = 0.01  # of a plan, between two points
RESTART = 0.2  # of a plan: from so much less than before, another plan runs

Point = tuple[float, tuple[float, ...], tuple[float, ...]]  # share of the plan, angles and targets in degrees


class Curves:
    """What was measured and what was planned since the newest plan began."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self._ended = False

    def take(self, snapshot: ControlSnapshot) -> None:
        """A snapshot; while nothing runs, the last plan's curve stays."""
        if snapshot.action is None:
            self._ended = True
            return
        if not all(isfinite(joint.angle_rad) and isfinite(joint.target_rad) for joint in snapshot.joints):
            return
        if self._ended or (self.points and snapshot.progress < self.points[-1][0] - RESTART):
            self.points = []
        self._ended = False
        if not self.points or snapshot.progress >= self.points[-1][0] + STEP:
            angles = tuple(degrees(joint.angle_rad) for joint in snapshot.joints)
            targets = tuple(degrees(joint.target_rad) for joint in snapshot.joints)
            self.points.append((snapshot.progress, angles, targets))


def draw_joints(
    snapshot: ControlSnapshot, curves: Curves, devices: tuple[JointDevice, ...], width: int, height: int
) -> Lines:
    """The four joints one above the other: their figures, and the curve where there are two rows for it."""
    rows = height // len(Joint)
    lines: list[Line] = []
    for joint in Joint:
        lines.append(joint_line(joint, snapshot.joints[joint], devices[joint], width))
        if rows > 2 and width >= 12:
            lines.extend(_curve(curves.points, joint, devices[joint], width, rows - 1))
    return tuple(lines[:height])


def joint_fault(now: JointSnapshot) -> str:
    """What is wrong with a joint; empty: nothing."""
    if now.faults:
        return tr("list.separator").join(render(each) for each in now.faults)
    return tr("joints.silent") if now.age_ms > SILENT_MS else ""


def joint_line(joint: Joint, now: JointSnapshot, device: JointDevice, width: int) -> Line:
    """Angle, target, torque, temperature, as far as the joint has ever answered; what is wrong before them."""
    parts = [(f"{tr(f'joints.{joint.name.lower()}')} ", "bold")]
    if wrong := joint_fault(now):
        parts.append((f"‼ {wrong} ", "bold $error"))
    if not isnan(now.angle_rad):
        parts += [
            (f"{degrees(now.angle_rad):5.1f}°", "bold"),
            (f" → {_target(now)}", "$foreground-muted"),
            (f" {now.torque_nm:+5.1f} Nm", ""),
            _temperature(now, device),
        ]
    return fitted(parts, width)


def _target(now: JointSnapshot) -> str:
    """A recording may have none."""
    return "    –" if isnan(now.target_rad) else f"{degrees(now.target_rad):5.1f}°"


def _temperature(now: JointSnapshot, device: JointDevice) -> tuple[str, str]:
    if isnan(now.temperature_c):
        return ("   – °C", "$foreground-muted")
    if now.temperature_c >= device.warn_c:
        return (f" !{now.temperature_c:.0f} °C", "bold $warning")
    return (f"  {now.temperature_c:.0f} °C", "")


def _curve(points: list[Point], joint: Joint, device: JointDevice, width: int, rows: int) -> Lines:
    """Dotted the plan, solid what was measured, wide dots at an end of the range that comes into sight."""
    if len(points) < 2:
        return (plain(""),) * rows
    values = [value for _, angles, targets in points for value in (angles[joint], targets[joint])]
    middle, span = (min(values) + max(values)) / 2, max(LEAST_SPAN_DEG, max(values) - min(values) + 2 * MARGIN_DEG)
    low_deg, high_deg = middle - span / 2, middle + span / 2
    labels = (f"{high_deg:.0f}°", f"{low_deg:.0f}°")
    axis = max(map(cells, labels)) + 1
    canvas = Canvas(width, rows)

    def at(share: float, angle_deg: float) -> tuple[float, float]:
        x = 2 * axis + share * (canvas.width - 1 - 2 * axis)
        return x, (high_deg - angle_deg) / span * (canvas.height - 1)

    for limit_deg in (device.min_deg, device.max_deg):
        if low_deg <= limit_deg <= high_deg:
            canvas.pen = "$error"
            canvas.line(*at(0.0, limit_deg), *at(1.0, limit_deg), every=6)
    plan = [at(share, targets[joint]) for share, _, targets in points]
    measured = [at(share, angles[joint]) for share, angles, _ in points]
    for places, pen, every in ((plan, "$accent", 2), (measured, "bold $primary", 1)):
        canvas.pen = pen
        for a, b in pairwise(places):
            canvas.line(*a, *b, every=every)
    canvas.text(0, 0, labels[0], "$foreground-muted")
    canvas.text(0, rows - 1, labels[1], "$foreground-muted")
    return canvas.lines()
