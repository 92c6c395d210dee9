"""The four joints: angle against target within their range, torque, temperature, and their recent past."""

from __future__ import annotations

import math
from collections import deque
from functools import cache

from app.console.state import SessionState
from app.console.widgets.panel import Line, Lines, StatePanel, cells, plain
from app.ipc.messages import JointSnapshot
from app.text.catalogue import render, tr
from hal.joints.device import Joint, JointDevice, load_exoskeleton

_STALE_MS = 100.0
_SPARKS = "▁▂▃▄▅▆▇█"
_HISTORY = 40  # a quarter of a second each: ten seconds


def joint_lines(state: SessionState, width: int, past: tuple[tuple[float, ...], ...]) -> Lines:
    """One line a joint."""
    if state.snapshot is None:
        return (plain(tr("joints.waiting"), "$text-muted"),)
    return tuple(_line(joint, state.snapshot.joints[joint], _devices()[joint], width, past[joint]) for joint in Joint)


def _line(joint: Joint, now: JointSnapshot, device: JointDevice, width: int, past: tuple[float, ...]) -> Line:
    name, figures, tail = tr(f"joints.{joint.name.lower()}"), _figures(now), _tail(now, device)
    spark_width = 12 if width >= 96 else 0
    room = width - cells(name) - cells(figures) - cells(tail[0]) - spark_width - 4
    scale = range_bar(math.degrees(now.angle_rad), math.degrees(now.target_rad), device, min(40, room))
    spark = f" {sparkline(past, spark_width - 1)}" if spark_width else ""
    return ((f"{name} ", "bold"), (scale, "$primary"), (f" {figures}", ""), tail, (spark, "$text-muted"))


def _figures(now: JointSnapshot) -> str:
    return f"{math.degrees(now.angle_rad):6.1f}°→{math.degrees(now.target_rad):6.1f}° {now.torque_nm:+6.1f} Nm"


def _tail(now: JointSnapshot, device: JointDevice) -> tuple[str, str]:
    if now.faults:
        return (f" ‼ {tr('list.separator').join(render(each) for each in now.faults)}", "bold $error")
    if now.age_ms > _STALE_MS:
        return (f" ‼ {tr('joints.silent')}", "bold $error")
    if math.isnan(now.temperature_c):
        return ("   – °C", "$text-muted")
    mark, style = " ", ""
    if now.temperature_c >= device.warn_c:
        mark, style = "!", "bold $warning"
    return (f" {mark}{now.temperature_c:.0f} °C", style)


def range_bar(angle_deg: float, target_deg: float, device: JointDevice, width: int) -> str:
    """The joint's whole range: `│` target, `●` angle; empty where there is no room."""
    if width < 6:
        return ""

    def cell(degrees: float) -> int:
        share = (degrees - device.min_deg) / (device.max_deg - device.min_deg)
        return max(0, min(width - 3, round(share * (width - 3))))

    cells = ["─"] * (width - 2)
    cells[cell(target_deg)] = "│"
    cells[cell(angle_deg)] = "●"
    return "[" + "".join(cells) + "]"


def sparkline(values: tuple[float, ...], width: int) -> str:
    """The newest values, scaled to their own span (at least 5°, so that noise stays flat)."""
    shown = values[-width:]
    if not shown:
        return " " * width
    low = min(shown)
    span = max(max(shown) - low, math.radians(5.0))
    return "".join(_SPARKS[min(7, int((value - low) / span * 8))] for value in shown).rjust(width)


@cache
def _devices() -> tuple[JointDevice, ...]:
    return load_exoskeleton().joints


class JointsPanel(StatePanel):
    """Four lines, one a joint."""

    def __init__(self, id: str | None = None, title: str = "") -> None:  # noqa: A002 - Textual's own name
        super().__init__(id, title)
        self._past: tuple[deque[float], ...] = tuple(deque(maxlen=_HISTORY) for _ in Joint)
        self._noted_ns = 0

    def show(self, state: SessionState) -> None:
        """Draw the newest snapshot."""
        if state.snapshot is not None and state.now_ns - self._noted_ns >= 250_000_000:
            self._noted_ns = state.now_ns
            for joint in Joint:
                self._past[joint].append(state.snapshot.joints[joint].angle_rad)
        self.lines = joint_lines(state, self.content_size.width, tuple(tuple(p) for p in self._past))
