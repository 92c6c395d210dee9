"""Drives as tables and lines on the terminal."""

from __future__ import annotations

import time
from math import degrees, isnan

from rich.table import Table

from app.text.catalogue import render, tr
from hal.errors import CanFault
from hal.joints.can.candump import Decoded, FrameKind, LogSummary
from hal.joints.can.scan import BusMonitor
from hal.joints.codecs.wire import Order, Reply, SetPoint
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.protocol import DriveFault, Joint

NOTHING = "–"


def fault_names(faults: DriveFault) -> str:
    """The faults by name; a dash for none."""
    return tr("list.separator").join(tr(fault) for fault in faults) or NOTHING


def _table(*columns: str) -> Table:
    """A table with these columns, named by their keys."""
    table = Table(box=None, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(tr(f"drives.{column}"), justify="left" if number == 0 else "right")
    return table


def emulated_drives_table(emulator: DriveEmulator) -> Table:
    """What the emulated firmware does."""
    table = _table(
        "joint", "id", "motor", "mode", "angle", "speed", "torque", "temperature", "stiffness", "damping"
    )  # fmt: skip
    now_ns = time.monotonic_ns()
    for joint, drive in zip(Joint, emulator.drives, strict=True):
        effective, state = drive.effective(now_ns), drive.state
        table.add_row(
            tr(joint),
            str(drive.device.can_id),
            drive.model.label,
            _mode(drive),
            f"{degrees(state.position_rad):.1f}",
            f"{degrees(state.velocity_rad_s):.0f}",
            f"{state.torque_nm:.1f}",
            f"{state.temperature_c:.0f}",
            f"{effective.stiffness_nm_rad:.0f}",
            f"{effective.damping_nm_s_rad:.1f}",
        )
    table.caption = tr("drives.emulated", frames=emulator.received, lost_ticks=emulator.lost_ticks)
    return table


def _mode(drive: EmulatedDrive) -> str:
    if drive.silent:
        return tr("drives.silent")
    if drive.error_code:
        return tr("drives.error", code=drive.error_code)
    return tr("drives.motor_mode" if drive.motor_mode else "drives.rest")


def monitor_table(monitor: BusMonitor) -> Table:
    """What each drive reported last, and its last command; fits 80 columns."""
    table = _table(
        "joint", "id", "angle", "speed", "torque", "temperature", "replies",
        "target", "stiffness", "damping", "sent", "faults",
    )  # fmt: skip
    for drive in monitor.drives:
        joint = drive.joint
        commands = monitor.counts[joint, FrameKind.COMMAND] + monitor.counts[joint, FrameKind.ORDER]
        table.add_row(
            tr(joint),
            str(drive.device.can_id),
            *_reported(monitor.newest.get((joint, FrameKind.REPLY))),
            str(monitor.counts[joint, FrameKind.REPLY]),
            *_commanded(monitor.newest.get((joint, FrameKind.COMMAND))),
            str(commands),
            _faults(monitor.newest.get((joint, FrameKind.REPLY))),
        )
    newest = monitor.newest.get((None, FrameKind.UNKNOWN))
    table.caption = tr(
        "drives.caption",
        state=render(monitor.detail) if monitor.detail else tr("drives.bus_ok"),
        unknown=monitor.counts[None, FrameKind.UNKNOWN],
        newest=newest.content if newest else NOTHING,
        errors=monitor.counts[None, FrameKind.ERROR],
    )
    return table


def _reported(newest: Decoded | None) -> tuple[str, str, str, str]:
    if newest is None or not isinstance(newest.content, Reply):
        return ("?",) * 4
    reply = newest.content
    return (
        f"{degrees(reply.position_rad):.1f}",
        f"{degrees(reply.velocity_rad_s):.0f}",
        f"{reply.torque_nm:.1f}",
        NOTHING if isnan(reply.temperature_c) else f"{reply.temperature_c:.0f}",
    )


def _commanded(newest: Decoded | None) -> tuple[str, str, str]:
    if newest is None or not isinstance(newest.content, SetPoint):
        return (NOTHING,) * 3
    target = newest.content
    angle = f"{degrees(target.position_rad):.1f}"
    return angle, f"{target.stiffness_nm_rad:.0f}", f"{target.damping_nm_s_rad:.1f}"


def _faults(newest: Decoded | None) -> str:
    return fault_names(newest.content.faults) if newest and isinstance(newest.content, Reply) else "?"


def decoded_line(decoded: Decoded) -> str:
    """One frame of a log as a line."""
    joint = "" if decoded.joint is None else tr(decoded.joint)
    return f"{decoded.at_s:.6f}  {joint:<10}  {tr(decoded.kind):<8}  {_content(decoded.content)}"


def _content(content: SetPoint | Order | Reply | CanFault | str) -> str:
    if isinstance(content, SetPoint):
        return (
            f"{degrees(content.position_rad):8.2f}° {degrees(content.velocity_rad_s):8.1f}°/s "
            f"kp {content.stiffness_nm_rad:6.1f} kd {content.damping_nm_s_rad:5.2f} {content.torque_nm:7.2f} Nm"
        )
    if isinstance(content, Reply):
        numbers = (
            f"{degrees(content.position_rad):8.2f}° {degrees(content.velocity_rad_s):8.1f}°/s "
            f"{content.torque_nm:7.2f} Nm"
        )
        temperature = "" if isnan(content.temperature_c) else f" {content.temperature_c:.0f} °C"
        return numbers + temperature + (f"  {fault_names(content.faults)}" if content.faults else "")
    return content if isinstance(content, str) else tr(content, bus="")


def summary_table(summary: LogSummary) -> Table:
    """What a log held."""
    table = _table("joint", "commands", "orders", "replies", "longest_gap", "faults")
    for joint in sorted({joint for joint, _ in summary.counts if joint is not None}):
        gap_s = summary.longest_gap_s.get(joint)
        table.add_row(
            tr(joint),
            str(summary.counts[joint, FrameKind.COMMAND]),
            str(summary.counts[joint, FrameKind.ORDER]),
            str(summary.counts[joint, FrameKind.REPLY]),
            NOTHING if gap_s is None else f"{gap_s * 1000:.1f}",
            fault_names(summary.faults.get(joint, DriveFault.NONE)),
        )
    table.caption = tr(
        "drives.log",
        duration_s=summary.last_s - summary.first_s,
        frames=sum(summary.counts.values()),
        unknown=summary.counts[None, FrameKind.UNKNOWN],
        errors=summary.counts[None, FrameKind.ERROR],
        broken=summary.broken_lines,
    )
    return table
